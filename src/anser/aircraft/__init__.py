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
from anser.aircraft.disturbance import Disturbance, no_disturbance
from anser.aircraft.engine import AbstractEngine, EnginePower, NoEngine, along_body_x
from anser.aircraft.f16 import F16, F16Coefficients, f16_from_data
from anser.aircraft.f16_dispersed import (
    F16_COEFFICIENTS,
    F16Dispersion,
    dispersed_f16,
    no_dispersion,
)
from anser.aircraft.interface import AbstractAirframe, AircraftState, Controls, MassProperties
from anser.aircraft.motion import MotionState, Moving, motion_derivative, moving_state, seen_state
from anser.aircraft.rigid_body import (
    Condition,
    angular_acceleration,
    condition,
    moment_for_acceleration,
    state_derivative,
)
from anser.aircraft.round_earth import EarthFixedState, earth_fixed_derivative, earth_fixed_state, local_state
from anser.aircraft.simple_body import SimpleBody, body_from_data
from anser.aircraft.wrench import Wrench

__all__ = [
    "F16",
    "F16_COEFFICIENTS",
    "STANDARD_SURFACES",
    "AbstractActuators",
    "AbstractAirframe",
    "AbstractEngine",
    "AirData",
    "AircraftState",
    "Condition",
    "Controls",
    "Deflections",
    "Disturbance",
    "EarthFixedState",
    "EnginePower",
    "F16Coefficients",
    "F16Dispersion",
    "FirstOrderActuators",
    "MassProperties",
    "MotionState",
    "Moving",
    "MovingDeflections",
    "NoEngine",
    "SecondOrderActuators",
    "SimpleBody",
    "Wrench",
    "air_data",
    "along_body_x",
    "angular_acceleration",
    "body_from_data",
    "condition",
    "dispersed_f16",
    "earth_fixed_derivative",
    "earth_fixed_state",
    "f16_from_data",
    "local_state",
    "moment_for_acceleration",
    "motion_derivative",
    "moving_state",
    "no_dispersion",
    "no_disturbance",
    "seen_state",
    "state_derivative",
]
