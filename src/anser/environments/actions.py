"""Levels of action: surfaces and throttle, body rates, or velocity commands, all normalized to -1..1."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe, Controls
from anser.control.feedback import wrap_angle
from anser.control.inversion_autopilot import InversionAutopilot, LoopCommand
from anser.environments.spaces import Entry
from anser.parts.controllers import AbstractController, AbstractGuidance
from anser.parts.paths import PathCommand, polar
from anser.parts.perception import Belief, Instant
from anser.parts.planners import AircraftPlan
from anser.shapes import ScalarLike, Vector3
from anser.spatial.rotations import rotate_back
from anser.units import DEG_RAD, RAD_DEG


class HeldCommand(AbstractGuidance):
    """Guidance that repeats one command, which an environment holds during a decision.

    Attributes
    ----------
    held
        The command.
    """

    held: Any

    def command(
        self, guidance_state: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[Any, Vector3, None]:
        """Return the held command; the reference position is the aircraft's own."""
        return self.held, belief.state.position_n, None


class DirectControls(AbstractController):
    """Controller whose command is the controls themselves."""

    def control(
        self, controller_state: None, belief: Belief, command: Controls, step: ScalarLike
    ) -> tuple[Controls, None, None]:
        """Return the commanded controls."""
        return command, None, None


def air_path(belief: Belief) -> PathCommand:
    """Return airspeed (m/s), path angle and course (rad) through the air of a belief, without rates."""
    velocity_air_n = rotate_back(belief.condition.R_bn, belief.state.velocity_b) - belief.condition.wind_n
    return polar(velocity_air_n, jnp.zeros_like(velocity_air_n))


class AbstractActionLevel(eqx.Module):
    """Interface of the levels at which an action enters the closed loop."""

    #: Duration of a decision, s.
    decision_s: eqx.AbstractVar[float]

    @abc.abstractmethod
    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return the table that describes each entry of an action (name, unit, scale) for an untraced aircraft."""

    @abc.abstractmethod
    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return the controller that turns the command of this level into controls."""

    @abc.abstractmethod
    def command(self, action: Float[Array, " action"], autopilot: InversionAutopilot, belief: Belief) -> Any:
        """Convert an action, clipped to -1..1, to the command of the controller; at the start of a decision."""

    @abc.abstractmethod
    def action(
        self, controls: Controls, signals: Any, command: Any, autopilot: InversionAutopilot, belief: Belief
    ) -> Float[Array, " action"]:
        """Return the action that corresponds to one step of the autopilot: its controls, signals and command.

        Parameters
        ----------
        controls, signals
            Result of the autopilot.
        command
            Command to the autopilot.
        """


def _from_unit(action: Array, low: ScalarLike, high: ScalarLike) -> Array:
    return low + 0.5 * (action + 1.0) * (high - low)


def _to_unit(value: ScalarLike, low: ScalarLike, high: ScalarLike) -> Array:
    return jnp.clip(2.0 * (value - low) / (high - low) - 1.0, -1.0, 1.0)


def _entry(name: str, unit: str, low: float, high: float, meaning: str) -> Entry:
    return Entry(name, unit, 0.5 * (low + high), 0.5 * (high - low), meaning)


_THROTTLE = _entry("throttle", "1", 0.0, 1.0, "Throttle")


class SurfaceLevel(AbstractActionLevel):
    """Action: deflections of the commanded surfaces between their stops, and the throttle."""

    decision_s: float = eqx.field(static=True, default=0.01)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return the table of an action's entries: commanded surfaces and throttle."""
        actuators = airframe.actuators
        stops = zip(actuators.names, actuators.is_commanded, actuators.lower, actuators.upper, strict=True)
        surfaces = [
            _entry(f"{name}_command_deg", "degree", float(low) * RAD_DEG, float(high) * RAD_DEG, f"Commanded {name}")
            for name, is_commanded, low, high in stops
            if is_commanded
        ]
        return (*surfaces, _THROTTLE)

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return a controller whose command is surfaces and throttle themselves."""
        return DirectControls()

    def command(self, action: Float[Array, " action"], autopilot: InversionAutopilot, belief: Belief) -> Controls:
        """Convert an action to surfaces (rad) and throttle; a surface that follows a schedule has the command 0."""
        actuators = belief.airframe.actuators
        index = np.flatnonzero(actuators.is_commanded)
        deflections = _from_unit(action[:-1], actuators.lower[index], actuators.upper[index])
        surfaces = jnp.zeros(len(actuators.names), deflections.dtype).at[index].set(deflections)
        return Controls(surfaces, 0.5 * (action[-1] + 1.0))

    def action(
        self, controls: Controls, signals: Any, command: Any, autopilot: InversionAutopilot, belief: Belief
    ) -> Float[Array, " action"]:
        """Return the autopilot's surfaces and throttle as an action, each scaled to -1..1 over its range."""
        actuators = belief.airframe.actuators
        index = np.flatnonzero(actuators.is_commanded)
        surfaces = _to_unit(controls.surfaces[index], actuators.lower[index], actuators.upper[index])
        return jnp.append(surfaces, _to_unit(controls.throttle, 0.0, 1.0))


class RateLevel(AbstractActionLevel):
    """Action: body rates up to the limits of the autopilot, whose rate loop follows them, and the throttle."""

    decision_s: float = eqx.field(static=True, default=0.05)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return the table of an action's entries: three body rates and throttle."""
        limits = np.asarray(autopilot.limits.rates_max) * RAD_DEG
        rates = zip(("roll", "pitch", "yaw"), limits, strict=True)
        commands = [
            _entry(f"{axis}_rate_command_deg_s", "degree s-1", -float(limit), float(limit), f"Commanded {axis} rate")
            for axis, limit in rates
        ]
        return (*commands, _THROTTLE)

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return the rate loop of the autopilot."""
        return InversionAutopilot(autopilot.gains, autopilot.limits, loop="rates")

    def command(self, action: Float[Array, " action"], autopilot: InversionAutopilot, belief: Belief) -> LoopCommand:
        """Convert an action to body rates (rad/s) without feed-forward, and the throttle (0..1)."""
        rates_b = action[:3] * autopilot.limits.rates_max
        return LoopCommand(rates_b, jnp.zeros_like(rates_b), 0.5 * (action[3] + 1.0))

    def action(
        self, controls: Controls, signals: Any, command: Any, autopilot: InversionAutopilot, belief: Belief
    ) -> Float[Array, " action"]:
        """Return the body rates of the autopilot's attitude loop and its throttle as an action, scaled to -1..1."""
        rates = _to_unit(signals.rates_b, -autopilot.limits.rates_max, autopilot.limits.rates_max)
        return jnp.append(rates, _to_unit(controls.throttle, 0.0, 1.0))


class VelocityLevel(AbstractActionLevel):
    """Action: airspeed within the limits of the autopilot, path angle, and change of the course.

    The course is relative to that at the start of the decision, so that no value of the action is a discontinuity.

    Attributes
    ----------
    path_angle_max, course_change_max
        Greatest commanded path angle, and greatest commanded change of the course, rad.
    """

    decision_s: float = eqx.field(static=True, default=0.1)
    path_angle_max: float = eqx.field(static=True, default=20.0 * DEG_RAD)
    course_change_max: float = eqx.field(static=True, default=90.0 * DEG_RAD)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return the table of an action's entries: airspeed, path angle and change of the course."""
        limits = autopilot.limits
        path_angle, course = self.path_angle_max * RAD_DEG, self.course_change_max * RAD_DEG
        return (
            _entry(
                "airspeed_command_m_s", "m s-1", float(limits.speed_min), float(limits.speed_max), "Commanded airspeed"
            ),
            _entry("path_angle_command_deg", "degree", -path_angle, path_angle, "Commanded path angle"),
            _entry("course_change_command_deg", "degree", -course, course, "Commanded change of the course"),
        )

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return the autopilot with all loops, which follows the commanded velocity."""
        return autopilot

    def command(self, action: Float[Array, " action"], autopilot: InversionAutopilot, belief: Belief) -> PathCommand:
        """Convert an action to a path command without rates (m/s, rad)."""
        zero = jnp.zeros_like(action[0])
        V = _from_unit(action[0], autopilot.limits.speed_min, autopilot.limits.speed_max)
        chi = air_path(belief).chi + self.course_change_max * action[2]
        return PathCommand(V, self.path_angle_max * action[1], chi, zero, zero, zero)

    def action(
        self, controls: Controls, signals: Any, command: PathCommand, autopilot: InversionAutopilot, belief: Belief
    ) -> Float[Array, " action"]:
        """Return the action whose command without rates has the effect of the autopilot's command with rates."""
        gains = autopilot.gains.velocity
        lead = gains.feed_forward / gains.proportional
        change = wrap_angle(command.chi - air_path(belief).chi) + lead[2] * command.chi_dot
        V, gamma = command.V + lead[0] * command.V_dot, command.gamma + lead[1] * command.gamma_dot
        return jnp.stack(
            [
                _to_unit(V, autopilot.limits.speed_min, autopilot.limits.speed_max),
                jnp.clip(gamma / self.path_angle_max, -1.0, 1.0),
                jnp.clip(change / self.course_change_max, -1.0, 1.0),
            ]
        )


LEVELS: dict[str, AbstractActionLevel] = {
    "surfaces": SurfaceLevel(),
    "rates": RateLevel(),
    "velocity": VelocityLevel(),
}
"""Levels of action by name."""
