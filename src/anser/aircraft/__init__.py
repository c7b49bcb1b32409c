"""Aircraft: the published interface, air data, actuators, rigid body; one file per airframe."""

from anser.aircraft.actuators import (
    STANDARD_SURFACES,
    AbstractActuators,
    Deflections,
    FirstOrderActuators,
    MovingDeflections,
    SecondOrderActuators,
)
from anser.aircraft.air_data import AirData, air_data
from anser.aircraft.body_dispersed import BodyDispersion
from anser.aircraft.dave_ml_aircraft import (
    AERO_LENGTHS,
    AERO_OUTPUTS,
    INERTIA_OUTPUTS,
    KNOWN_INPUTS,
    DaveMlAircraft,
    body_faults_of,
    dave_ml_airframe,
)
from anser.aircraft.dave_ml_dispersed import dispersed_dave_ml_aircraft
from anser.aircraft.dave_ml_engine import ENGINE_OUTPUTS, ENGINE_POWER, DaveMlEngine
from anser.aircraft.derivative_aircraft import NEVER, DerivativeAircraft
from anser.aircraft.derivative_dispersed import DerivativeDispersion, dispersed_derivative_aircraft
from anser.aircraft.disturbance import Disturbance, no_disturbance
from anser.aircraft.electric_propeller import ElectricPropeller
from anser.aircraft.engine import AbstractEngine, EnginePower, NoEngine, along_body_x
from anser.aircraft.f16 import F16, F16_COEFFICIENTS, engine_from_data, f16_from_data, tables_of_variant
from anser.aircraft.f16_dispersed import F16Dispersion, dispersed_f16, no_dispersion
from anser.aircraft.f16_interface import AbstractF16, F16Coefficients
from anser.aircraft.interface import AbstractAirframe, AircraftState, Controls, MassProperties
from anser.aircraft.jet_engine import JetEngine
from anser.aircraft.motion import MotionState, Moving, motion_derivative, moving_state, seen_state
from anser.aircraft.piston_propeller import PistonPropeller
from anser.aircraft.possible_body import refuse_impossible_body
from anser.aircraft.rigid_body import (
    Condition,
    angular_acceleration,
    condition,
    moment_for_acceleration,
    state_derivative,
)
from anser.aircraft.round_earth import EarthFixedState, earth_fixed_derivative, earth_fixed_state, local_state
from anser.aircraft.scheduled_flap import ScheduledFlap, ScheduledFlapActuators
from anser.aircraft.simple_body import SimpleBody, body_from_data
from anser.aircraft.table_checks import GriddedTable, SuspectPoint, suspect_points
from anser.aircraft.tp1538 import F16TP1538, tp1538_from_data
from anser.aircraft.validity import Validity, everywhere
from anser.aircraft.wrench import Wrench

__all__ = [
    "AERO_LENGTHS",
    "AERO_OUTPUTS",
    "ENGINE_OUTPUTS",
    "ENGINE_POWER",
    "F16",
    "F16TP1538",
    "F16_COEFFICIENTS",
    "INERTIA_OUTPUTS",
    "KNOWN_INPUTS",
    "NEVER",
    "STANDARD_SURFACES",
    "AbstractActuators",
    "AbstractAirframe",
    "AbstractEngine",
    "AbstractF16",
    "AirData",
    "AircraftState",
    "BodyDispersion",
    "Condition",
    "Controls",
    "DaveMlAircraft",
    "DaveMlEngine",
    "Deflections",
    "DerivativeAircraft",
    "DerivativeDispersion",
    "Disturbance",
    "EarthFixedState",
    "ElectricPropeller",
    "EnginePower",
    "F16Coefficients",
    "F16Dispersion",
    "FirstOrderActuators",
    "GriddedTable",
    "JetEngine",
    "MassProperties",
    "MotionState",
    "Moving",
    "MovingDeflections",
    "NoEngine",
    "PistonPropeller",
    "ScheduledFlap",
    "ScheduledFlapActuators",
    "SecondOrderActuators",
    "SimpleBody",
    "SuspectPoint",
    "Validity",
    "Wrench",
    "air_data",
    "along_body_x",
    "angular_acceleration",
    "body_faults_of",
    "body_from_data",
    "condition",
    "dave_ml_airframe",
    "dispersed_dave_ml_aircraft",
    "dispersed_derivative_aircraft",
    "dispersed_f16",
    "earth_fixed_derivative",
    "earth_fixed_state",
    "engine_from_data",
    "everywhere",
    "f16_from_data",
    "local_state",
    "moment_for_acceleration",
    "motion_derivative",
    "moving_state",
    "no_dispersion",
    "no_disturbance",
    "refuse_impossible_body",
    "seen_state",
    "state_derivative",
    "suspect_points",
    "tables_of_variant",
    "tp1538_from_data",
]
