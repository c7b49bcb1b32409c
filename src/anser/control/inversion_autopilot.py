"""Autopilot by nonlinear dynamic inversion as a part of the closed loop: commands to any of its three loops."""

from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.airframe import AircraftState, Controls
from anser.control.autopilot import AutopilotSignals, attitude_control, rate_control, velocity_control
from anser.control.autopilot_state import AutopilotState, initial_autopilot_state
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.control.onboard_model import onboard_model
from anser.parts.controllers import AbstractController
from anser.parts.perception import Belief
from anser.shapes import ScalarLike, Vector3

Loop = Literal["rates", "attitude", "velocity"]


class LoopCommand(eqx.Module):
    """What an inner loop is asked for.

    Attributes
    ----------
    value
        (P, Q, R) rad/s or (mu, alpha, beta) rad.
    rate
        Its rate of change, for the feed-forward.
    throttle
        That is held, 0..1.
    """

    value: Vector3
    rate: Vector3
    throttle: ScalarLike


class InversionAutopilot(AbstractController):
    """Nonlinear dynamic inversion in three loops (theory section 5), of the model or incremental by its gains.

    Attributes
    ----------
    gains, limits
        Of the loops.
    loop
        Which is commanded: "velocity" by a `PathCommand`, an inner one by a `LoopCommand`. Those inside it are closed.
    """

    gains: AutopilotGains
    limits: FlightLimits
    loop: Loop = eqx.field(static=True, default="velocity")

    def init(self, state: AircraftState, attitude: Vector3) -> AutopilotState:
        """Memory of an autopilot that has been holding steady flight."""
        return initial_autopilot_state(attitude, state.rates_b, state.surfaces, self.limits)

    def control(
        self, controller_state: AutopilotState, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, AutopilotSignals | None, AutopilotState]:
        """See `velocity_control`, `attitude_control`, `rate_control`; signals are those of the velocity loop."""
        model = onboard_model(belief, self.limits, self.gains, controller_state, step)
        if self.loop == "velocity":
            return velocity_control(model, self.gains, controller_state, command)
        if self.loop == "attitude":
            _, demand, controller_state = attitude_control(
                model, self.gains, controller_state, command.value, command.rate
            )
        else:
            demand, controller_state = rate_control(model, self.gains, controller_state, command.value, command.rate)
        return Controls(demand.surfaces, jnp.asarray(command.throttle)), None, controller_state
