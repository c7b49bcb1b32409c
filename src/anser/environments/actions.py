"""Levels at which an action enters the closed loop: surfaces and throttle, body rates, or velocity commands.

The entries of an action are normalized to -1..1.
"""

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
    """Controller that passes commanded surfaces and throttle on unchanged."""

    def control(
        self, controller_state: None, belief: Belief, command: Controls, step: ScalarLike
    ) -> tuple[Controls, None, None]:
        """Return the commanded surfaces (rad) and throttle, and None for the controller's state and its signals."""
        return command, None, None


class AutopilotStep(NamedTuple):
    """One step of the autopilot with which the scripted expert flies; see `AbstractActionLevel.action`."""

    command: Any  # command to the autopilot: `PathCommand` or `LoopCommand`
    controls: Controls  # resulting surfaces (rad) and throttle
    signals: Any  # resulting signals between the loops, such as the commanded body rates


class AbstractActionLevel(eqx.Module):
    """Interface of the levels at which an action enters the closed loop."""

    #: Duration of a decision, s. The action is constant within a decision.
    decision_s: eqx.AbstractVar[float]

    @abc.abstractmethod
    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return name, unit and scale of each entry of an action, in the order of the action.

        The arrays of `autopilot` and `airframe` must be concrete, not traced by JAX.
        """

    @abc.abstractmethod
    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return the controller that computes surfaces and throttle from the command of this level."""

    @abc.abstractmethod
    def command(self, action: Action, autopilot: InversionAutopilot, belief: Belief) -> Any:
        """Return the command to the level's controller for an action with entries in -1..1.

        `belief` must hold the aircraft's estimates at the start of the decision.
        """

    @abc.abstractmethod
    def action(self, step: AutopilotStep, autopilot: InversionAutopilot, belief: Belief) -> Action:
        """Return the action (entries in -1..1) that has the same effect as one step of the expert's autopilot."""


def _from_unit(action: Array, low: ScalarLike, high: ScalarLike) -> Array:
    return low + 0.5 * (action + 1.0) * (high - low)


def _to_unit(value: ScalarLike, low: ScalarLike, high: ScalarLike) -> Array:
    return jnp.clip(2.0 * (value - low) / (high - low) - 1.0, -1.0, 1.0)


def _command(variable: str | Variable, low: ScalarLike, high: ScalarLike) -> Entry:
    """Return the table entry of a command from `low` (action -1) to `high` (action 1), in the variable's unit."""
    centre, half_range = 0.5 * (float(low) + float(high)), 0.5 * (float(high) - float(low))
    return catalogue_entry(variable, centre, half_range, "_command", "Commanded")


_THROTTLE = Entry("throttle", "1", 0.5, 0.5, "Throttle")


class SurfaceLevel(AbstractActionLevel):
    """Action level that commands the throttle and the surfaces' deflections between their stops."""

    decision_s: float = eqx.field(static=True, default=0.01)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return name, unit and scale of the commanded surfaces and the throttle, which are an action's entries."""
        index, low, high = _commanded(airframe.actuators)
        stops = zip(index, np.asarray(low) * RAD_DEG, np.asarray(high) * RAD_DEG, strict=True)
        positions = surface_variables(airframe.actuators.names)
        return (*(_command(positions[k], low, high) for k, low, high in stops), _THROTTLE)

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return a controller that passes commanded surfaces and throttle on unchanged."""
        return DirectControls()

    def command(self, action: Action, autopilot: InversionAutopilot, belief: Belief) -> Controls:
        """Convert an action to surfaces (rad) and throttle (0..1); surfaces that follow a schedule get 0."""
        index, low, high = _commanded(belief.airframe.actuators)
        deflections = _from_unit(action[:-1], low, high)
        surfaces = jnp.zeros(len(belief.airframe.actuators.names), deflections.dtype).at[index].set(deflections)
        return Controls(surfaces, 0.5 * (action[-1] + 1.0))

    def action(self, step: AutopilotStep, autopilot: InversionAutopilot, belief: Belief) -> Action:
        """Return the autopilot's surfaces and throttle as an action, each scaled from its range to -1..1."""
        index, low, high = _commanded(belief.airframe.actuators)
        surfaces = _to_unit(step.controls.surfaces[index], low, high)
        return jnp.append(surfaces, _to_unit(step.controls.throttle, 0.0, 1.0))


def _commanded(actuators: AbstractActuators) -> tuple[np.ndarray, Array, Array]:
    """Return indices, lower stops and upper stops (rad) of the surfaces that do not follow a schedule."""
    index = np.flatnonzero(actuators.is_commanded)
    return index, actuators.lower[index], actuators.upper[index]


class RateLevel(AbstractActionLevel):
    """Action level that commands the throttle and the body rates, up to the autopilot's limits."""

    decision_s: float = eqx.field(static=True, default=0.05)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return name, unit and scale of three body rates and the throttle, which are an action's entries."""
        axes, limits = ("roll", "pitch", "yaw"), np.asarray(autopilot.limits.rates_max) * RAD_DEG
        rates = zip(axes, limits, strict=True)
        return (*(_command(f"{axis}_rate_deg_s", -limit, limit) for axis, limit in rates), _THROTTLE)

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return the rate loop of the autopilot, which follows commanded body rates and throttle."""
        return InversionAutopilot(autopilot.gains, autopilot.limits, loop="rates")

    def command(self, action: Action, autopilot: InversionAutopilot, belief: Belief) -> LoopCommand:
        """Convert an action to commanded body rates (rad/s), with time derivatives of 0, and throttle (0..1)."""
        rates_b = action[:3] * autopilot.limits.rates_max
        return LoopCommand(rates_b, jnp.zeros_like(rates_b), 0.5 * (action[3] + 1.0))

    def action(self, step: AutopilotStep, autopilot: InversionAutopilot, belief: Belief) -> Action:
        """Return the body rates that the autopilot's attitude loop commands, and the throttle, scaled to -1..1."""
        rates = _to_unit(step.signals.rates_b, -autopilot.limits.rates_max, autopilot.limits.rates_max)
        return jnp.append(rates, _to_unit(step.controls.throttle, 0.0, 1.0))


class VelocityLevel(AbstractActionLevel):
    """Action level that commands airspeed, path angle, and a change of the course.

    The airspeed ranges over the autopilot's limits. The change adds to the course at the start of the decision.
    """

    decision_s: float = eqx.field(static=True, default=0.1)
    path_angle_max: float = eqx.field(static=True, default=20.0 * DEG_RAD)  #: Greatest path angle up or down, rad.
    #: Greatest change of the course to either side, rad. Unlike the course, a change has no jump at +-180 deg.
    course_change_max: float = eqx.field(static=True, default=90.0 * DEG_RAD)

    def entries(self, autopilot: InversionAutopilot, airframe: AbstractAirframe) -> tuple[Entry, ...]:
        """Return name, unit and scale of airspeed, path angle and change of the course, the entries of an action."""
        path_angle, course = self.path_angle_max * RAD_DEG, self.course_change_max * RAD_DEG
        return (
            _command("airspeed_m_s", autopilot.limits.speed_min, autopilot.limits.speed_max),
            _command("path_angle_deg", -path_angle, path_angle),
            Entry("course_change_command_deg", "degree", 0.0, course, "Commanded change of the course"),
        )

    def controller(self, autopilot: InversionAutopilot) -> AbstractController:
        """Return the whole autopilot, which follows commanded airspeed, path angle and course."""
        return autopilot

    def command(self, action: Action, autopilot: InversionAutopilot, belief: Belief) -> PathCommand:
        """Convert an action to a path through the air: airspeed (m/s), path angle and course (rad), and rates of 0."""
        zero = jnp.zeros_like(action[0])
        V = _from_unit(action[0], autopilot.limits.speed_min, autopilot.limits.speed_max)
        chi = wrap_angle(_course(belief) + self.course_change_max * action[2])
        return PathCommand(V, self.path_angle_max * action[1], chi, zero, zero, zero)

    def action(self, step: AutopilotStep, autopilot: InversionAutopilot, belief: Belief) -> Action:
        """Return the action with nearly the same effect as the expert's path command, clipped to -1..1."""
        command, gains = step.command, autopilot.gains.velocity
        # An action has no rates: value + lead * rate has the same effect in the velocity loop.
        lead = gains.feed_forward / gains.proportional
        change = wrap_angle(command.chi - _course(belief)) + lead[2] * command.chi_dot
        V, gamma = command.V + lead[0] * command.V_dot, command.gamma + lead[1] * command.gamma_dot
        angles = jnp.stack([gamma / self.path_angle_max, change / self.course_change_max])
        speed = _to_unit(V, autopilot.limits.speed_min, autopilot.limits.speed_max)
        return jnp.append(speed, jnp.clip(angles, -1.0, 1.0))


def _course(belief: Belief) -> Array:
    """Return the course (rad) of the estimated velocity relative to the air."""
    velocity_air_n = rotate_back(belief.condition.R_bn, belief.state.velocity_b) - belief.condition.wind_n
    return polar(velocity_air_n, jnp.zeros_like(velocity_air_n)).chi


LEVELS: dict[str, AbstractActionLevel] = {"surfaces": SurfaceLevel(), "rates": RateLevel(), "velocity": VelocityLevel()}
"""Levels of action by name, with their default settings."""
