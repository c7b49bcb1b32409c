"""Interfaces of guidance (from the belief to a command) and controller (from the command to controls)."""

import abc
from typing import Any

from jaxtyping import Array

from anser.aircraft.airframe import AircraftState, Controls
from anser.parts.part import AbstractPart
from anser.parts.perception import Belief, Instant
from anser.parts.planners import AircraftPlan
from anser.shapes import ScalarLike, Vector3


class AbstractGuidance(AbstractPart):
    """Interface of guidance, which commands one aircraft. Subclass this class directly, not a concrete guidance."""

    def init(self, belief: Belief, instant: Instant) -> Any:
        """Return the guidance's state before the first sample; by default None (no state)."""
        return None

    @abc.abstractmethod
    def command(
        self, guidance_state: Any, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[Any, Vector3, Any]:
        """Return the command for the controller, the position to follow (NED, m), and the new guidance state.

        `plan` is None if the flight has no planner. The command must have the type that the aircraft's controller
        expects, and for an aircraft with a goal the type must be `PathCommand`.
        """


class AbstractController(AbstractPart):
    """Interface of controllers (commands to controls). Subclass this class directly, not a concrete controller."""

    def init(self, state: AircraftState, attitude: Vector3) -> Any:
        """Return the controller's state after a long time in steady flight; by default None (no state).

        `attitude` is (mu, alpha, beta), rad.
        """
        return None

    @abc.abstractmethod
    def control(
        self, controller_state: Any, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, Any, Any]:
        """Return surfaces and throttle for the coming sampling period, signals to record, and the new controller state.

        `step` is the sampling period, s; `command` has the type that the aircraft's guidance returns. The signals are
        None, or an object with a method `variables()` that returns a dictionary from keys of
        `anser.variables.CATALOGUE` to values.
        """


def signal_variables(signals: Any) -> dict[str, Array]:
    """Return the recorded variables of a controller's signals by key; an empty dictionary for signals None."""
    return {} if signals is None else signals.variables()
