"""Aircraft: the published interface, air data, actuators, rigid body; one file per airframe."""

from anser.aircraft.actuators import Actuators
from anser.aircraft.air_data import AirData, air_data
from anser.aircraft.f16 import F16, F16Coefficients, f16_from_data
from anser.aircraft.f16_engine import F16Engine
from anser.aircraft.interface import AbstractAirframe, AircraftState, Controls, MassProperties, Wrench
from anser.aircraft.rigid_body import (
    Condition,
    angular_acceleration,
    condition,
    moment_for_acceleration,
    state_derivative,
)

__all__ = [
    "F16",
    "AbstractAirframe",
    "Actuators",
    "AirData",
    "AircraftState",
    "Condition",
    "Controls",
    "F16Coefficients",
    "F16Engine",
    "MassProperties",
    "Wrench",
    "air_data",
    "angular_acceleration",
    "condition",
    "f16_from_data",
    "moment_for_acceleration",
    "state_derivative",
]
