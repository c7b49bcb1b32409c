from .dynamic_models import DynamicModel, Manoeuvre, make_manoeuvre
from .estimates import Estimate
from .filter_error import estimate_filter_error
from .frequency_regression import regress_spectra
from .input_design import PlannedManoeuvre, plan_manoeuvre
from .output_error import estimate_output_error
from .records import FlightRecord, flight_record
from .regression import regress

__all__ = [
    "DynamicModel",
    "Estimate",
    "FlightRecord",
    "Manoeuvre",
    "PlannedManoeuvre",
    "estimate_filter_error",
    "estimate_output_error",
    "flight_record",
    "make_manoeuvre",
    "plan_manoeuvre",
    "regress",
    "regress_spectra",
]
