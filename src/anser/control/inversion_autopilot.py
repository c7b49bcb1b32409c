"""The autopilot by dynamic inversion as a controller of the closed loop; any of its three loops can be commanded."""

from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from anser.aircraft.airframe import AircraftState, Controls
from anser.control.autopilot import (
    AutopilotSignals,
    attitude_control,
    rate_control,
    rates_at_limit,
    velocity_control,
)
from anser.control.autopilot_state import AutopilotState, initial_autopilot_state
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.control.onboard_model import onboard_model
from anser.parts.controllers import AbstractController
from anser.parts.perception import Belief
from anser.shapes import Flag, ScalarLike, Vector3

Loop = Literal["rates", "attitude", "velocity"]


class LoopCommand(eqx.Module):
    """Command to the attitude loop or the rate loop, and the throttle, which these loops do not control."""

    value: Vector3  #: (P, Q, R) rad/s or (mu, alpha, beta) rad.
    rate: Vector3  #: Time derivative of `value`, for the feed-forward, rad/s^2 or rad/s.
    throttle: ScalarLike  #: Constant throttle, 0..1.


class RateSignals(eqx.Module):
    """Signals of one sample for recording, if the velocity loop is open."""

    rates_b: Vector3  # commanded (P, Q, R), rad/s
    rates_limited: Flag  # whether the attitude loop commands a body rate at its limit
    surfaces_limited: Flag  # whether the demanded moment needs a deflection beyond a stop

    def variables(self) -> dict[str, Array]:
        """Return the recorded variables by their keys in `anser.variables.CATALOGUE`; SI units and radians."""
        return {
            **dict(zip(("roll_rate_command", "pitch_rate_command", "yaw_rate_command"), self.rates_b, strict=True)),
            "rates_limited": self.rates_limited,
            "surfaces_limited": self.surfaces_limited,
        }


class InversionAutopilot(AbstractController):
    """Autopilot by nonlinear dynamic inversion in three loops (theory section 5).

    The inversion is model-based if `gains.sensor_bandwidth` is 0, and incremental if this bandwidth is above 0.
    """

    gains: AutopilotGains
    limits: FlightLimits
    #: The commanded loop: "velocity" takes a `PathCommand`, "attitude" and "rates" a `LoopCommand`. Loops inside the
    #: commanded loop are closed.
    loop: Loop = eqx.field(static=True, default="velocity")

    def init(self, state: AircraftState, attitude: Vector3) -> AutopilotState:
        """Return the autopilot's state after a long time in steady flight; `attitude` is (mu, alpha, beta), rad."""
        return initial_autopilot_state(attitude, state.rates_b, state.surfaces, self.limits)

    def control(
        self, controller_state: AutopilotState, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, AutopilotSignals | RateSignals, AutopilotState]:
        """Compute the controls for a command to the loop `loop`; `step` is the sampling period, s.

        Returns surfaces and throttle, the signals to record, and the new state of the autopilot. The signals are
        `AutopilotSignals` for the velocity loop, and `RateSignals` for the other loops.
        """
        model = onboard_model(belief, self.limits, self.gains, controller_state, step)
        if self.loop == "velocity":
            return velocity_control(model, self.gains, controller_state, command)
        if self.loop == "attitude":
            rates_b, demand, controller_state = attitude_control(
                model, self.gains, controller_state, command.value, command.rate
            )
            rates_limited = rates_at_limit(rates_b, self.limits.rates_max)
        else:
            rates_b, rates_limited = command.value, jnp.asarray(False)
            demand, controller_state = rate_control(model, self.gains, controller_state, rates_b, command.rate)
        signals = RateSignals(rates_b, rates_limited, jnp.any(demand.saturated))
        return Controls(demand.surfaces, jnp.asarray(command.throttle)), signals, controller_state
