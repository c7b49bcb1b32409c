"""Guidance of the hold around the goal, flown after the arrival or after a breakaway from the plan."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.control.gains import LoopGains
from anser.control.ground_clearance import GroundClearance, ground_clearance, level_off_command
from anser.control.guidance import (
    GuidanceSettings,
    chart_velocities,
    command_from_chart,
    crosses_centre,
    follow,
    hold,
    hold_point,
)
from anser.control.limits import FlightLimits
from anser.numerics.arrays import select_if_any
from anser.parts.paths import PathCommand
from anser.parts.perception import Belief, Instant
from anser.parts.planners import AircraftPlan, Rendezvous
from anser.planning.holds.hold_paths import hold_reference
from anser.shapes import Flag, Scalar, Vector3

_BANK_MAX = 1.2  # rad: keeps the tangent, the lateral acceleration, bounded


class HoldAroundGoal(eqx.Module):
    """Guidance of the hold: along the planned hold, or in a circle around the moving goal at the rendezvous' height."""

    settings: GuidanceSettings  # guidance settings: radius, turn direction, greatest vertical speed
    limits: FlightLimits  # least altitude of the hold, and limits of the aircraft
    gains: LoopGains  # gains of the controller's velocity loop (V, gamma, chi)
    speed: Scalar  # airspeed, m/s

    def clearance(self, belief: Belief) -> GroundClearance:
        """Return the ground clearance of the aircraft's estimated present motion, with the limits of the hold."""
        return ground_clearance(belief, self.limits)

    def lateral_acceleration_max(self, clearance: GroundClearance, gravity: Scalar) -> Scalar:
        """Return the greatest lateral acceleration, m/s^2, of a level turn within the limits of the hold.

        `clearance` must be the result of `HoldAroundGoal.clearance`.
        """
        by_bank = gravity * jnp.tan(jnp.minimum(self.limits.bank_max, _BANK_MAX))
        by_lift = jnp.sqrt(jnp.maximum(clearance.normal_acceleration_max**2 - gravity**2, 1e-6))
        return jnp.minimum(by_bank, by_lift)

    def command(
        self,
        belief: Belief,  # the aircraft's own estimates of its state and of its goal's state
        clearance: GroundClearance,
        rendezvous: Rendezvous,  # rendezvous; the height of the stand-off is the height of the hold
        distance_min: Scalar,  # least distance from the goal, m
        plan: AircraftPlan,  # plan with the arrival before the hold
        is_breakaway: Flag,  # whether the aircraft has left its plan, and must not follow the planned hold
        instant: Instant,
    ) -> tuple[PathCommand, Vector3]:
        """Return the command through the air (V, gamma, chi with rates), and the reference point of the hold, NED, m.

        The planned hold is followed if it is still valid (`hold_reference`) and the aircraft has not broken away; the
        reference point is the planned position. In the other cases the aircraft flies a circle, with radius, turn
        direction and height of the planned hold if there is one; the reference point is the circle's nearest point.
        Near the ground, the command is changed to level off. Raises ValueError if the aircraft has no goal.
        """
        if belief.goal is None:
            raise ValueError("a hold is flown around a goal: the aircraft has none")
        time, goal_n, goal_velocity_n = instant.time, belief.goal.position_n, belief.goal.velocity_n
        position_n, settings = belief.state.position_n, self.settings
        velocity_n, wind_n = chart_velocities(belief)
        relative_n = position_n - goal_n
        # the hold stays above the least altitude, even for a lower rendezvous
        height = jnp.maximum(-rendezvous.stand_off_n[2], self.limits.altitude_min + goal_n[2])
        if plan.hold is not None:
            circle = plan.hold.circles
            height = circle.height
            settings = eqx.tree_at(lambda s: (s.hold_radius, s.hold_turn), settings, (circle.radius, circle.turn))
        # a circle narrower than the least distance is flown high enough to keep the distance
        height_square = jnp.maximum(distance_min**2 - settings.hold_radius**2, 0.0)
        height = jnp.maximum(
            height,
            jnp.where(height_square > 0.0, jnp.sqrt(jnp.where(height_square > 0.0, height_square, 1.0)), -jnp.inf),
        )
        circle_n = hold_point(relative_n, goal_n, height, settings)
        direction_n = select_if_any(  # arrival direction, used only near the goal
            crosses_centre(relative_n, settings),
            lambda: plan.trajectory.velocity_n(plan.arrival_time) - goal_velocity_n,
            velocity_n - goal_velocity_n,
        )
        hold_command = hold(relative_n, velocity_n, goal_velocity_n, wind_n, direction_n, height, self.speed, settings)
        if plan.hold is not None:
            planned_hold, is_valid = hold_reference(
                plan.hold, time, goal_n, goal_velocity_n, self.speed, plan.hold_reach
            )
            point = planned_hold.at(time)
            planned = follow(point, position_n, velocity_n, wind_n, settings), point.position_n
            follows_plan = is_valid & ~is_breakaway
            hold_command, circle_n = jax.tree.map(
                lambda a, b: jnp.where(follows_plan, a, b), planned, (hold_command, circle_n)
            )
        command = command_from_chart(hold_command, belief, instant.environment)
        return level_off_command(command, clearance, self.gains, belief.condition.earth.gravity), circle_n
