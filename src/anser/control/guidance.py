"""Guidance: velocity commands for the autopilot, from the planned path or from a hold around the goal."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.control.feedback import wrap_angle
from anser.environment.earth import FlatEarth
from anser.environment.environment import Environment
from anser.parts.controllers import AbstractGuidance
from anser.parts.paths import PathCommand, PathPoint, polar, rescale_command
from anser.parts.perception import Belief, Instant, velocity_over_ground_n
from anser.parts.planners import AircraftPlan
from anser.shapes import Flag, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_hypot

_CLIMB_GAIN = 0.2  # 1/s: altitude errors in the hold fade within about 15 s
_PULL_MAX_M_S2 = 6.0  # m/s^2: limits the additional pull of a level-off
_COSINE_MIN = 0.2  # of the path angle: bounds the airspeed command of a steep hold
_STRAIGHT_FRACTION = 0.1  # fraction of the hold radius flown straight on after the arrival


class GuidanceSettings(eqx.Module):
    """Settings of the guidance functions `follow` (along the plan) and `hold` (around the goal)."""

    position_gain: Scalar  #: Correction speed per metre of position error, 1/s; 0 flies the planned velocity only.
    correction_max: Scalar  #: Greatest correction speed, m/s.
    hold_radius: Scalar  #: Radius of the hold around the goal, m.
    hold_turn: Scalar  #: +1: clockwise seen from above (right turns); -1: anticlockwise.
    climb_rate_max: Scalar  #: Greatest vertical speed in the hold, m/s.


class FollowPlan(AbstractGuidance):
    """Guidance that follows the aircraft's plan by velocity feed-forward and position feedback (`follow`)."""

    settings: GuidanceSettings

    def command(
        self, guidance_state: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[PathCommand, Vector3, None]:
        """Return the velocity command, the planned position (NED, m), and None for the state of the guidance.

        Raises ValueError if the aircraft has no plan.
        """
        if plan is None:
            raise ValueError("FollowPlan follows a plan: fly it in a flight with a planner")
        velocity_n, wind_n = chart_velocities(belief)
        planned = plan.trajectory.at(instant.time)
        command = follow(planned, belief.state.position_n, velocity_n, wind_n, self.settings)
        return command_from_chart(command, belief, instant.environment), planned.position_n, None


def chart_velocities(belief: Belief) -> tuple[Vector3, Vector3]:
    """Return the velocity over the ground and the wind as rates in the Earth's local map (chart), NED, m/s."""
    scale = belief.condition.earth.chart_scale
    return scale * velocity_over_ground_n(belief.condition, belief.state), scale * belief.condition.wind_n


def command_from_chart(command: PathCommand, belief: Belief, environment: Environment) -> PathCommand:
    """Convert a command from rates in the Earth's local map (chart) to velocities through the air, m/s and rad."""
    if isinstance(environment.earth, FlatEarth):  # chart rates are velocities
        return command
    return rescale_command(command, 1.0 / belief.condition.earth.chart_scale)


def follow(
    planned: PathPoint,  # present motion along the plan
    position_n: Vector3,  # position of the aircraft, NED, m
    velocity_n: Vector3,  # velocity over ground, NED, m/s
    wind_n: Vector3,  # wind measured by the aircraft (ground velocity minus air velocity), NED, m/s
    settings: GuidanceSettings,
) -> PathCommand:
    """Compute the command (through the air) that flies a trajectory: velocity feed-forward plus position feedback.

    The commanded velocity over the ground is v_planned + k (p_planned - p), with the rate a_planned + k (v_planned - v)
    and the gain k = `position_gain`. The correction is limited smoothly to the speed `correction_max`. The wind is
    subtracted.
    """

    def correction(offset_n: Vector3) -> Vector3:
        correction_n = settings.position_gain * offset_n
        return correction_n / jnp.sqrt(1 + jnp.sum(correction_n**2) / settings.correction_max**2)

    offset_n, slip_n = planned.position_n - position_n, planned.velocity_n - velocity_n
    added_n, added_dot_n = jax.jvp(correction, (offset_n,), (slip_n,))
    return polar(planned.velocity_n + added_n - wind_n, planned.acceleration_n + added_dot_n)


def hold(
    relative_n: Vector3,  # position of the aircraft relative to the goal, NED, m
    velocity_n: Vector3,  # velocity of the aircraft over ground, NED, m/s
    goal_velocity_n: Vector3,  # velocity of the goal over ground, NED, m/s
    wind_n: Vector3,  # measured wind, NED, m/s
    # velocity relative to the goal at the arrival, of any length; used only near the goal (`crosses_centre`)
    arrival_direction_n: Vector3,
    height: ScalarLike,  # commanded height above the goal, m
    speed: ScalarLike,  # commanded airspeed, m/s
    settings: GuidanceSettings,
) -> PathCommand:
    """Compute the command (through the air) that flies on after the arrival and joins a circle around the goal.

    The command is a vector field around the goal: the outward radial, turned by an angle theta. With the ratio x of
    distance to radius, theta is pi/2 x^2 (2.5 - 1.5 x) inside the circle, pi/2 on the circle, and greater outside. At
    the goal, the paths of the field have no curvature, and an arriving aircraft flies straight on. Inside the circle,
    the curvature stays below 3 / radius.
    """
    drift_n = (goal_velocity_n - wind_n).at[2].set(0.0)
    arrival_axis = arrival_direction_n[:2] / jnp.maximum(
        safe_hypot(arrival_direction_n[0], arrival_direction_n[1]), 1e-6
    )

    def air_velocity(relative: Vector3) -> Vector3:
        distance = safe_hypot(relative[0], relative[1])
        x = distance / settings.hold_radius
        radial = relative[:2] / jnp.maximum(distance, 1.0)
        radial_weight = _smoothstep(x / _STRAIGHT_FRACTION)
        outward = radial_weight * radial + (1 - radial_weight) * arrival_axis
        outward = outward / jnp.maximum(safe_hypot(outward[0], outward[1]), 1e-3)
        y = jnp.minimum(x, 1.0)
        inside = 0.5 * jnp.pi * y * y * (2.5 - 1.5 * y)
        outside = 0.5 * jnp.pi + jnp.arctan(1.5 * jnp.maximum(x - 1.0, 0.0))
        theta = jnp.where(x < 1.0, inside, outside)
        across = settings.hold_turn * jnp.stack([-outward[1], outward[0]])
        direction = jnp.cos(theta) * outward + jnp.sin(theta) * across
        drift_along = jnp.sum(direction * drift_n[:2])
        speed_square = jnp.maximum(speed**2 - jnp.sum(drift_n[:2] ** 2) + drift_along**2, (0.1 * speed) ** 2)
        level_velocity = (jnp.sqrt(speed_square) - drift_along) * direction + drift_n[:2]
        climb = jnp.clip(_CLIMB_GAIN * (height + relative[2]), -settings.climb_rate_max, settings.climb_rate_max)
        return jnp.concatenate([level_velocity, (goal_velocity_n[2] - climb - wind_n[2])[None]])

    velocity, acceleration = jax.jvp(air_velocity, (relative_n,), (velocity_n - goal_velocity_n,))
    air_velocity_n = velocity_n - wind_n
    present = polar(air_velocity_n, jnp.zeros_like(air_velocity_n))
    return _limit_turn(_limit_pull(polar(velocity, acceleration), present), present, settings.hold_turn)


def _limit_pull(command: PathCommand, present: PathCommand) -> PathCommand:
    """Limit the path angle relative to `present` to a pull or push of 6 m/s^2, and keep the horizontal speed."""
    # the path-angle loop turns an error e into an acceleration V e / (1 s) normal to the path
    change_max = _PULL_MAX_M_S2 / jnp.maximum(present.V, 1.0)
    change = command.gamma - present.gamma
    gamma = jnp.where(
        jnp.abs(change) <= change_max, command.gamma, present.gamma + jnp.clip(change, -change_max, change_max)
    )
    gamma_dot = jnp.where(jnp.abs(change) <= change_max, command.gamma_dot, 0.0)
    level = command.V * jnp.cos(command.gamma)
    level_dot = command.V_dot * jnp.cos(command.gamma) - command.V * jnp.sin(command.gamma) * command.gamma_dot
    cosine = jnp.maximum(jnp.cos(gamma), _COSINE_MIN)
    V = level / cosine
    V_dot = (level_dot + V * jnp.sin(gamma) * gamma_dot) / cosine
    return eqx.tree_at(lambda c: (c.V, c.gamma, c.V_dot, c.gamma_dot), command, (V, gamma, V_dot, gamma_dot))


def _limit_turn(command: PathCommand, present: PathCommand, turn: ScalarLike) -> PathCommand:
    """Limit the course to 45 deg from the `present` course; `turn` is +1 for a hold to the right, -1 to the left."""
    change = wrap_angle(command.chi - present.chi)
    # a change of more than 120 deg against the hold is flown the long way round: the turn never reverses
    change = jnp.where(turn * change < -2 * jnp.pi / 3, change + turn * 2 * jnp.pi, change)
    limited_change = jnp.clip(change, -jnp.pi / 4, jnp.pi / 4)
    is_large = jnp.abs(change) > jnp.pi / 4
    chi = jnp.where(is_large, present.chi + limited_change, command.chi)
    # no feed-forward: the rate of the vector field is not the rate of the limited turn
    chi_dot = jnp.where(is_large, 0.0, command.chi_dot)
    return eqx.tree_at(lambda c: (c.chi, c.chi_dot), command, (chi, chi_dot))


def crosses_centre(relative_n: Vector3, settings: GuidanceSettings) -> Flag:
    """Whether an aircraft is horizontally within a tenth of the hold radius of the goal, where `hold` flies straight.

    `relative_n` is the position relative to the goal, NED, m.
    """
    return safe_hypot(relative_n[0], relative_n[1]) < _STRAIGHT_FRACTION * settings.hold_radius


def hold_point(
    relative_n: Vector3, goal_position_n: Vector3, height: ScalarLike, settings: GuidanceSettings
) -> Vector3:
    """Return the point of the hold's circle nearest to an aircraft, NED, m.

    `relative_n` is the position of the aircraft relative to the goal, NED, m; `height` is the height of the circle
    above the goal, m.
    """
    radial = relative_n[:2] / jnp.maximum(safe_hypot(relative_n[0], relative_n[1]), 1.0)
    return goal_position_n + jnp.concatenate([settings.hold_radius * radial, -jnp.asarray(height)[None]])


def _smoothstep(x: Scalar) -> Scalar:
    x = jnp.clip(x, 0.0, 1.0)
    return x * x * (3 - 2 * x)
