"""Interfaces of guidance (from the belief to a command) and controller (from the command to controls)."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array

from anser.aircraft.airframe import AircraftState, Controls
from anser.parts.perception import Belief, Instant
from anser.parts.planners import AircraftPlan
from anser.shapes import ScalarLike, Vector3


class AbstractGuidance(eqx.Module):
    """Source of the commands of one aircraft; concrete subclasses are final."""

    @abc.abstractmethod
    def init(self, belief: Belief, instant: Instant) -> Any:
        """State of the guidance before the first sample."""

    @abc.abstractmethod
    def command(
        self, guidance_state: Any, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[Any, Vector3, Any]:
        """Command for the controller, the planned position (NED, m), and the guidance state after this sample.

        Parameters
        ----------
        guidance_state
            State of the guidance.
        belief
            The aircraft's own estimate of its state and its goal's.
        plan
            The aircraft's plan; None without a planner.
        instant
            Time, step and random numbers of this sample.

        Returns
        -------
        The command has the type expected by the aircraft's controller; for an aircraft with a goal, also during the
        hold, a `PathCommand`.
        """


class AbstractController(eqx.Module):
    """Controller of one aircraft; concrete subclasses are final."""

    @abc.abstractmethod
    def init(self, state: AircraftState, attitude: Vector3) -> Any:
        """State of a controller after a long time in steady flight at the given (mu, alpha, beta), rad."""

    @abc.abstractmethod
    def control(
        self, controller_state: Any, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, Any, Any]:
        """Controls held over a sampling period (s), signals for the record, and the controller state after this sample.

        The signals are None, or have a method `variables()` that returns values of `anser.variables.CATALOGUE` by key.
        """


def signal_variables(signals: Any) -> dict[str, Array]:
    """Variables of a controller's signals for the record; empty for a controller without signals."""
    return {} if signals is None else signals.variables()
