from .actuators import AbstractActuators, FirstOrderActuators, SecondOrderActuators
from .air_data import AirData, Validity, Wrench
from .airframe import AbstractAirframe, AircraftState, Controls, MassProperties
from .dave_ml_aircraft import DaveMlAircraft, dave_ml_airframe
from .derivative_aircraft import DerivativeAircraft
from .engines import AbstractEngine, JetEngine, NoEngine
from .f16 import F16
from .motion import AirDataAndForces, air_data_and_forces, motion_derivative
from .propellers import ElectricPropeller, PistonPropeller
from .table_checks import suspect_points
from .tp1538 import F16TP1538

__all__ = [
    "F16",
    "F16TP1538",
    "AbstractActuators",
    "AbstractAirframe",
    "AbstractEngine",
    "AirData",
    "AirDataAndForces",
    "AircraftState",
    "Controls",
    "DaveMlAircraft",
    "DerivativeAircraft",
    "ElectricPropeller",
    "FirstOrderActuators",
    "JetEngine",
    "MassProperties",
    "NoEngine",
    "PistonPropeller",
    "SecondOrderActuators",
    "Validity",
    "Wrench",
    "air_data_and_forces",
    "dave_ml_airframe",
    "motion_derivative",
    "suspect_points",
]
