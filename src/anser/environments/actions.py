"""Levels of action: surfaces and throttle, body rates, or velocity commands, all normalized to -1..1."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.airframe import AbstractAirframe, Controls
from anser.control.feedback import wrap_angle
from anser.control.inversion_autopilot import InversionAutopilot, LoopCommand
from anser.environments.spaces import Entry, catalogue_entry
from anser.parts.controllers import AbstractController
from anser.parts.paths import PathCommand, polar
from anser.parts.perception import Belief
from anser.shapes import ScalarLike
from anser.spatial.rotations import rotate_back
from anser.units import DEG_RAD, RAD_DEG
from anser.variables import Variable, surface_variables

Action = Float[Array, " action"]


class DirectControls(AbstractController):
    """Controller whose command is the controls themselves."""

    def control(
        self, controller_state: None, belief: Belief, command: Controls, step: ScalarLike
    ) -> tuple[Controls, None, None]:
        """Return the commanded controls."""
        return command, None, None


class AutopilotStep(NamedTuple):
    """Command to the autopilot, and its result: controls and signals."""

    command: Any
    controls: Controls
    signals: Any


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
    def command(self, action: Action, autopilot: InversionAutopilot, belief: Belief) -> Any:
        """Convert an action, clipped to -1..1, to the command of the controller; at the start of a decision."""

    @abc.abstractmethod
    def action(self, step: AutopilotStep, autopilot: InversionAutopilot, belief: Belief) -> Action:
        """Return the action that corresponds to one step of the autopilot."""


def _from_unit(action: Array, low: ScalarLike, high: ScalarLike) -> Array:
    return low + 0.5 * (action + 1.0) * (high - low)


def _to_unit(value: ScalarLike, low: ScalarLike, high: ScalarLike) -> Array:
    return jnp.clip(2.0 * (value - low) / (high - low) - 1.0, -1.0, 1.0)


def _command(variable: str | Variable, low: ScalarLike, high: ScalarLike) -> Entry:
    """Return the entry of a commanded variable between two values in its unit."""
    centre, half_range = 0.5 * (float(low) + float(high)), 0.5 * (float(high) - float(low))
    return catalogue_entry(variable, centre, half_range, "_command", "Commanded")


_THROTTLE = Entry("throttle", "1", 0.5, 0.5, "Throttle")


class SurfaceLevel(AbstractActionLevel):
    """Action: deflections of the commanded surfaces between their stops, and the throttle."""

    decision_s: float = eqx.field(static=True, default=0.01)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return the table of an action's entries: commanded surfaces and throttle."""
        index, low, high = _commanded(airframe.actuators)
        stops = zip(index, np.asarray(low) * RAD_DEG, np.asarray(high) * RAD_DEG, strict=True)
        positions = surface_variables(airframe.actuators.names)
        return (*(_command(positions[k], low, high) for k, low, high in stops), _THROTTLE)

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return a controller whose command is surfaces and throttle themselves."""
        return DirectControls()

    def command(self, action: Action, autopilot: InversionAutopilot, belief: Belief) -> Controls:
        """Convert an action to surfaces (rad) and throttle; a surface that follows a schedule has the command 0."""
        index, low, high = _commanded(belief.airframe.actuators)
        deflections = _from_unit(action[:-1], low, high)
        surfaces = jnp.zeros(len(belief.airframe.actuators.names), deflections.dtype).at[index].set(deflections)
        return Controls(surfaces, 0.5 * (action[-1] + 1.0))

    def action(self, step: AutopilotStep, autopilot: InversionAutopilot, belief: Belief) -> Action:
        """Return the autopilot's surfaces and throttle as an action, each scaled to -1..1 over its range."""
        index, low, high = _commanded(belief.airframe.actuators)
        surfaces = _to_unit(step.controls.surfaces[index], low, high)
        return jnp.append(surfaces, _to_unit(step.controls.throttle, 0.0, 1.0))


def _commanded(actuators: AbstractActuators) -> tuple[np.ndarray, Array, Array]:
    """Return the indices and stops of the surfaces that are commanded, not scheduled."""
    index = np.flatnonzero(actuators.is_commanded)
    return index, actuators.lower[index], actuators.upper[index]


class RateLevel(AbstractActionLevel):
    """Action: body rates up to the limits of the autopilot, whose rate loop follows them, and the throttle."""

    decision_s: float = eqx.field(static=True, default=0.05)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return the table of an action's entries: three body rates and throttle."""
        axes, limits = ("roll", "pitch", "yaw"), np.asarray(autopilot.limits.rates_max) * RAD_DEG
        rates = zip(axes, limits, strict=True)
        return (*(_command(f"{axis}_rate_deg_s", -limit, limit) for axis, limit in rates), _THROTTLE)

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return the rate loop of the autopilot."""
        return InversionAutopilot(autopilot.gains, autopilot.limits, loop="rates")

    def command(self, action: Action, autopilot: InversionAutopilot, belief: Belief) -> LoopCommand:
        """Convert an action to body rates (rad/s) without feed-forward, and the throttle (0..1)."""
        rates_b = action[:3] * autopilot.limits.rates_max
        return LoopCommand(rates_b, jnp.zeros_like(rates_b), 0.5 * (action[3] + 1.0))

    def action(self, step: AutopilotStep, autopilot: InversionAutopilot, belief: Belief) -> Action:
        """Return the body rates of the autopilot's attitude loop and its throttle as an action, scaled to -1..1."""
        rates = _to_unit(step.signals.rates_b, -autopilot.limits.rates_max, autopilot.limits.rates_max)
        return jnp.append(rates, _to_unit(step.controls.throttle, 0.0, 1.0))


class VelocityLevel(AbstractActionLevel):
    """Action: airspeed within the limits of the autopilot, path angle, and change of the course.

    The course is relative to that at the start of the decision, so that no value of the action is a discontinuity.
    """

    decision_s: float = eqx.field(static=True, default=0.1)
    #: Greatest commanded path angle, and greatest commanded change of the course, rad.
    path_angle_max: float = eqx.field(static=True, default=20.0 * DEG_RAD)
    course_change_max: float = eqx.field(static=True, default=90.0 * DEG_RAD)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return the table of an action's entries: airspeed, path angle and change of the course."""
        path_angle, course = self.path_angle_max * RAD_DEG, self.course_change_max * RAD_DEG
        return (
            _command("airspeed_m_s", autopilot.limits.speed_min, autopilot.limits.speed_max),
            _command("path_angle_deg", -path_angle, path_angle),
            Entry("course_change_command_deg", "degree", 0.0, course, "Commanded change of the course"),
        )

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return the autopilot with all loops, which follows the commanded velocity."""
        return autopilot

    def command(self, action: Action, autopilot: InversionAutopilot, belief: Belief) -> PathCommand:
        """Convert an action to a path command without rates (m/s, rad)."""
        zero = jnp.zeros_like(action[0])
        V = _from_unit(action[0], autopilot.limits.speed_min, autopilot.limits.speed_max)
        chi = _course(belief) + self.course_change_max * action[2]
        return PathCommand(V, self.path_angle_max * action[1], chi, zero, zero, zero)

    def action(self, step: AutopilotStep, autopilot: InversionAutopilot, belief: Belief) -> Action:
        """Return the action whose command without rates has the effect of the autopilot's command with rates."""
        command, gains = step.command, autopilot.gains.velocity
        lead = gains.feed_forward / gains.proportional
        change = wrap_angle(command.chi - _course(belief)) + lead[2] * command.chi_dot
        V, gamma = command.V + lead[0] * command.V_dot, command.gamma + lead[1] * command.gamma_dot
        angles = jnp.stack([gamma / self.path_angle_max, change / self.course_change_max])
        speed = _to_unit(V, autopilot.limits.speed_min, autopilot.limits.speed_max)
        return jnp.append(speed, jnp.clip(angles, -1.0, 1.0))


def _course(belief: Belief) -> Array:
    """Return the course (rad) through the air of a belief."""
    velocity_air_n = rotate_back(belief.condition.R_bn, belief.state.velocity_b) - belief.condition.wind_n
    return polar(velocity_air_n, jnp.zeros_like(velocity_air_n)).chi


LEVELS: dict[str, AbstractActionLevel] = {"surfaces": SurfaceLevel(), "rates": RateLevel(), "velocity": VelocityLevel()}
"""Levels of action by name."""
