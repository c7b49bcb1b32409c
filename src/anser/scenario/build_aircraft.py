"""From a table [[aircraft]] to its airframe, as known and as it is flown."""

from anser.aircraft import (
    F16_COEFFICIENTS,
    AbstractAirframe,
    AbstractF16,
    DaveMlAircraft,
    DerivativeAircraft,
    F16Dispersion,
    dispersed_f16,
)
from anser.numerics import as_array
from anser.scenario.airframe_file.build import dispersed_airframe
from anser.scenario.library import airframe_of_table
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_deviation import Deviation


def build_airframe_of(aircraft: Aircraft) -> AbstractAirframe:
    """Airframe of one aircraft as its autopilot and planner know it."""
    return airframe_of_table(aircraft.type, aircraft.variant, aircraft.x_cg_over_c, aircraft.airframe)


def dispersed(known: AbstractAirframe, deviation: Deviation) -> AbstractAirframe:
    """Airframe that differs from the known one as a scenario says; TypeError where no coefficients are known."""
    if isinstance(known, AbstractF16):
        return dispersed_f16(known, _dispersion(deviation))
    if isinstance(known, DerivativeAircraft | DaveMlAircraft):
        return dispersed_airframe(known, deviation)
    raise TypeError(f"a deviation of {type(known).__name__}, of which no coefficients are known")


def _dispersion(deviation: Deviation) -> F16Dispersion:
    d = deviation
    return F16Dispersion(
        coefficients=as_array([getattr(d.coefficients, name) for name in F16_COEFFICIENTS]),
        thrust=as_array(d.thrust),
        mass=as_array(d.mass),
        second_moments=as_array(d.second_moments),
        actuator_bandwidth=as_array(d.actuator_bandwidth),
        cg_shift=as_array(d.cg_shift),
    )
