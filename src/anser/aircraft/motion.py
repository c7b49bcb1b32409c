"""The motion of an aircraft over whichever Earth its environment has: what is integrated, and what is seen of it."""

from typing import TypeVar, cast

from anser.aircraft.disturbance import Disturbance
from anser.aircraft.interface import AbstractAirframe, AircraftState, Controls
from anser.aircraft.rigid_body import state_derivative
from anser.aircraft.round_earth import (
    EarthFixedState,
    earth_fixed_derivative,
    earth_fixed_state,
    local_state,
    round_earth_of,
)
from anser.environment import Environment, RotatingEarth
from anser.shapes import ScalarLike

MotionState = AircraftState | EarthFixedState
"""What is integrated: the local state over a flat Earth, the Earth-fixed one over a round Earth."""

Moving = TypeVar("Moving", bound=MotionState)


def moving_state(environment: Environment, state: AircraftState) -> MotionState:
    """State to integrate, from what is seen in local axes."""
    earth = environment.earth
    return earth_fixed_state(earth, state) if isinstance(earth, RotatingEarth) else state


def seen_state(environment: Environment, state: MotionState) -> AircraftState:
    """What is seen in local axes of a state that is integrated."""
    if isinstance(state, AircraftState):
        return state
    return local_state(round_earth_of(environment), state)


def motion_derivative(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: Moving,
    controls: Controls,
    disturbance: Disturbance | None = None,
) -> Moving:
    """Time derivative of a state that is integrated, of the same kind."""
    if isinstance(state, AircraftState):
        return cast(Moving, state_derivative(airframe, environment, time, state, controls, disturbance))
    return cast(Moving, earth_fixed_derivative(airframe, environment, time, state, controls, disturbance))
