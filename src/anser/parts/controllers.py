"""Interfaces of guidance and controller: from what an aircraft believes to a command, from the command to controls."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array

from anser.aircraft.airframe import AircraftState, Controls
from anser.parts.perception import Belief, Instant
from anser.parts.planners import AircraftPlan
from anser.shapes import ScalarLike, Vector3


class AbstractGuidance(eqx.Module):
    """Source of the commands of one aircraft; concrete ones are final."""

    @abc.abstractmethod
    def init(self, belief: Belief, instant: Instant) -> Any:
        """State of the guidance before the first sample."""

    @abc.abstractmethod
    def command(
        self, guidance_state: Any, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[Any, Vector3, Any]:
        """Command for the controller, the point (NED, m) that it is to be at, and the guidance's state after that.

        Parameters
        ----------
        guidance_state
            State of the guidance.
        belief
            What the aircraft believes.
        plan
            Its own; None where nobody plans for it.
        instant
            Now.

        Returns
        -------
        The command is of the kind that the aircraft's controller takes; with a goal, a `PathCommand` (its hold gives
        one too).
        """


class AbstractController(eqx.Module):
    """Controller of one aircraft; concrete ones are final."""

    @abc.abstractmethod
    def init(self, state: AircraftState, attitude: Vector3) -> Any:
        """State of a controller that has been holding steady flight with the given (mu, alpha, beta), rad."""

    @abc.abstractmethod
    def control(
        self, controller_state: Any, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, Any, Any]:
        """Controls to hold over a sampling period (s), signals for the record, the controller's state after that.

        The signals are None, or have a method `variables()` that gives some of `anser.variables.CATALOGUE` by key.
        """


def signal_variables(signals: Any) -> dict[str, Array]:
    """Variables of a controller's signals for the record; none where it has no signals."""
    return {} if signals is None else signals.variables()
