"""Guidance: from the planned path, or from a hold around the goal, to the velocity that the autopilot flies."""

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
_PULL_MAX = 6.0  # m/s^2: levelling off after a steep arrival asks for an additional half g at most
_COSINE_MIN = 0.2  # of the path angle: a steeper hold is not asked for a higher airspeed
_STRAIGHT_ON = 0.1  # fraction of the hold radius flown straight on after the arrival


class GuidanceSettings(eqx.Module):
    """Numbers of the guidance.

    Attributes
    ----------
    position_gain
        Speed per metre of position error that is added to the planned velocity, 1/s; 0 flies velocity commands alone.
    correction_max
        Greatest such added speed, m/s.
    hold_radius
        Radius of the hold around the goal, m.
    hold_turn
        +1: clockwise seen from above (right turns); -1: the other way.
    climb_rate_max
        Greatest vertical speed in the hold, m/s.
    """

    position_gain: Scalar
    correction_max: Scalar
    hold_radius: Scalar
    hold_turn: Scalar
    climb_rate_max: Scalar


class FollowPlan(AbstractGuidance):
    """Follow the aircraft's own plan, see `follow`."""

    settings: GuidanceSettings

    def init(self, belief: Belief, instant: Instant) -> None:
        """Nothing is kept."""

    def command(
        self, guidance_state: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[PathCommand, Vector3, None]:
        """Command along the plan's trajectory.

        Raises
        ------
        ValueError
            Nobody plans for this aircraft.
        """
        if plan is None:
            raise ValueError("FollowPlan follows a plan: fly it in a flight with a planner")
        velocity_n, wind_n = chart_velocities(belief)
        planned = plan.trajectory.at(instant.time)
        command = follow(planned, belief.state.position_n, velocity_n, wind_n, self.settings)
        return command_from_chart(command, belief, instant.environment), planned.position_n, None


def chart_velocities(belief: Belief) -> tuple[Vector3, Vector3]:
    """Own velocity over the ground and the wind as rates of the Earth's chart, in which plans live, NED, m/s."""
    scale = belief.condition.earth.chart_scale
    return scale * velocity_over_ground_n(belief.condition, belief.state), scale * belief.condition.wind_n


def command_from_chart(command: PathCommand, belief: Belief, environment: Environment) -> PathCommand:
    """Command in velocities through the air, from one in rates of the Earth's chart."""
    if isinstance(environment.earth, FlatEarth):  # there both are the same
        return command
    return rescale_command(command, 1.0 / belief.condition.earth.chart_scale)


def follow(
    planned: PathPoint,
    position_n: Vector3,
    velocity_n: Vector3,
    wind_n: Vector3,
    settings: GuidanceSettings,
) -> PathCommand:
    """Command (through the air) that flies a trajectory: velocity feed-forward plus position feedback.

    v = v_planned + k (p_planned - p), its rate a_planned + k (v_planned - v); the added speed is limited smoothly.

    Parameters
    ----------
    planned
        Motion along the plan, now.
    position_n, velocity_n
        Own position (m) and velocity over ground (m/s).
    wind_n
        Wind as the aircraft measures it (ground velocity minus air velocity), m/s.
    settings
        See `GuidanceSettings`.
    """

    def correction(offset_n: Vector3) -> Vector3:
        wanted_n = settings.position_gain * offset_n
        return wanted_n / jnp.sqrt(1 + jnp.sum(wanted_n**2) / settings.correction_max**2)

    offset_n, slip_n = planned.position_n - position_n, planned.velocity_n - velocity_n
    added_n, added_dot_n = jax.jvp(correction, (offset_n,), (slip_n,))
    return polar(planned.velocity_n + added_n - wind_n, planned.acceleration_n + added_dot_n)


def hold(
    relative_n: Vector3,
    velocity_n: Vector3,
    goal_velocity_n: Vector3,
    wind_n: Vector3,
    arrival_direction_n: Vector3,
    height: ScalarLike,
    speed: ScalarLike,
    settings: GuidanceSettings,
) -> PathCommand:
    """Command (through the air) that flies on after the arrival and joins a circle around the moving goal.

    A vector field: seen from the goal, the velocity is turned from the outward radial by theta = pi/2 at the radius,
    less inside (pi/2 times x^2 (2.5 - 1.5 x), x = distance/radius), more outside. Inside, the path's curvature stays
    below 3 / radius and starts from 0, so that the arrival itself is flown straight through.

    Parameters
    ----------
    relative_n
        Own position relative to the goal, NED, m.
    velocity_n, goal_velocity_n
        Over ground, m/s.
    wind_n
        As measured, m/s.
    arrival_direction_n
        Direction of the arrival; flown on to a tenth of the radius, where the radial is not yet well defined, and of no
        account elsewhere (`crosses_centre`).
    height
        Wanted height above the goal, m.
    speed
        Airspeed, m/s.
    settings
        See `GuidanceSettings`.
    """
    drift_n = (goal_velocity_n - wind_n).at[2].set(0.0)
    ahead = arrival_direction_n[:2] / jnp.maximum(safe_hypot(arrival_direction_n[0], arrival_direction_n[1]), 1e-6)

    def air_velocity(relative: Vector3) -> Vector3:
        distance = safe_hypot(relative[0], relative[1])
        x = distance / settings.hold_radius
        radial = relative[:2] / jnp.maximum(distance, 1.0)
        trust = _smoothstep(x / _STRAIGHT_ON)
        outward = trust * radial + (1 - trust) * ahead
        outward = outward / jnp.maximum(safe_hypot(outward[0], outward[1]), 1e-3)
        y = jnp.minimum(x, 1.0)
        inside = 0.5 * jnp.pi * y * y * (2.5 - 1.5 * y)
        outside = 0.5 * jnp.pi + jnp.arctan(1.5 * jnp.maximum(x - 1.0, 0.0))
        theta = jnp.where(x < 1.0, inside, outside)
        across = settings.hold_turn * jnp.stack([-outward[1], outward[0]])
        direction = jnp.cos(theta) * outward + jnp.sin(theta) * across
        along = jnp.sum(direction * drift_n[:2])
        spare = jnp.maximum(speed**2 - jnp.sum(drift_n[:2] ** 2) + along**2, (0.1 * speed) ** 2)
        level = (jnp.sqrt(spare) - along) * direction + drift_n[:2]
        climb = jnp.clip(_CLIMB_GAIN * (height + relative[2]), -settings.climb_rate_max, settings.climb_rate_max)
        return jnp.concatenate([level, (goal_velocity_n[2] - climb - wind_n[2])[None]])

    velocity, acceleration = jax.jvp(air_velocity, (relative_n,), (velocity_n - goal_velocity_n,))
    own_air_n = velocity_n - wind_n
    return _turned_one_way(_eased(polar(velocity, acceleration), own_air_n), own_air_n, settings.hold_turn)


def _eased(command: PathCommand, velocity_air_n: Vector3) -> PathCommand:
    """Command whose path angle asks for no more than half a g of pull or push at once; its level speed stays.

    The path angle loop turns an error e into an acceleration V e / (1 s) normal to the path, at the present airspeed:
    an arrival that is faster than its hold must not be asked for a steeper descent where it is to level off.
    """
    present = polar(velocity_air_n, jnp.zeros_like(velocity_air_n))
    most = _PULL_MAX / jnp.maximum(present.V, 1.0)
    change = command.gamma - present.gamma
    gamma = jnp.where(jnp.abs(change) <= most, command.gamma, present.gamma + jnp.clip(change, -most, most))
    gamma_dot = jnp.where(jnp.abs(change) <= most, command.gamma_dot, 0.0)
    level = command.V * jnp.cos(command.gamma)
    level_dot = command.V_dot * jnp.cos(command.gamma) - command.V * jnp.sin(command.gamma) * command.gamma_dot
    cosine = jnp.maximum(jnp.cos(gamma), _COSINE_MIN)
    V = level / cosine
    V_dot = (level_dot + V * jnp.sin(gamma) * gamma_dot) / cosine
    return eqx.tree_at(lambda c: (c.V, c.gamma, c.V_dot, c.gamma_dot), command, (V, gamma, V_dot, gamma_dot))


def _turned_one_way(command: PathCommand, velocity_air_n: Vector3, turn: ScalarLike) -> PathCommand:
    """Keep a large change of course on one side: an arrival that heads for the goal must not waver about the far side.

    A course more than 120 deg against the hold's turn is reached by turning with it; what is asked at once is at most
    45 deg, and then without feed-forward, because the field's own rate is not that of such a turn.
    """
    course = polar(velocity_air_n, jnp.zeros_like(velocity_air_n)).chi
    change = wrap_angle(command.chi - course)
    change = jnp.where(turn * change < -2 * jnp.pi / 3, change + turn * 2 * jnp.pi, change)
    asked = jnp.clip(change, -jnp.pi / 4, jnp.pi / 4)
    large = jnp.abs(change) > jnp.pi / 4
    chi = jnp.where(large, course + asked, command.chi)
    chi_dot = jnp.where(large, 0.0, command.chi_dot)
    return eqx.tree_at(lambda c: (c.chi, c.chi_dot), command, (chi, chi_dot))


def crosses_centre(relative_n: Vector3, settings: GuidanceSettings) -> Flag:
    """Whether an aircraft (seen from the goal, NED, m) is where its hold flies on along the arrival's direction."""
    return safe_hypot(relative_n[0], relative_n[1]) < _STRAIGHT_ON * settings.hold_radius


def hold_point(
    relative_n: Vector3, goal_position_n: Vector3, height: ScalarLike, settings: GuidanceSettings
) -> Vector3:
    """Point of the hold's circle nearest to an aircraft, NED, m; `relative_n` is its position seen from the goal."""
    radial = relative_n[:2] / jnp.maximum(safe_hypot(relative_n[0], relative_n[1]), 1.0)
    return goal_position_n + jnp.concatenate([settings.hold_radius * radial, -jnp.asarray(height)[None]])


def _smoothstep(x: Scalar) -> Scalar:
    x = jnp.clip(x, 0.0, 1.0)
    return x * x * (3 - 2 * x)
