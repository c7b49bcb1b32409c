"""Aircraft: the published interface, air data, actuators, rigid body; one file per airframe."""

from anser.aircraft.actuators import Actuators
from anser.aircraft.air_data import AirData, air_data
from anser.aircraft.disturbance import Disturbance, no_disturbance
from anser.aircraft.f16 import F16, F16Coefficients, f16_from_data
from anser.aircraft.f16_dispersed import (
    F16_COEFFICIENTS,
    F16Dispersion,
    dispersed_f16,
    no_dispersion,
)
from anser.aircraft.interface import AbstractAirframe, AircraftState, Controls, MassProperties, Wrench
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

__all__ = [
    "F16",
    "F16_COEFFICIENTS",
    "AbstractAirframe",
    "Actuators",
    "AirData",
    "AircraftState",
    "Condition",
    "Controls",
    "Disturbance",
    "EarthFixedState",
    "F16Coefficients",
    "F16Dispersion",
    "MassProperties",
    "MotionState",
    "Moving",
    "SimpleBody",
    "Wrench",
    "air_data",
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
