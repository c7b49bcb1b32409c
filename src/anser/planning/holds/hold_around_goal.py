"""What an aircraft flies after its arrival, or after it has broken off: a hold around its goal."""

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

_BANK_MOST = 1.2  # rad: what a level turn asks for beyond has no bound


class HoldAroundGoal(eqx.Module):
    """A circle around the moving goal, at the rendezvous's height, or the planner's own hold where it made one.

    Attributes
    ----------
    settings
        Of the guidance: radius, sense, climb rate.
    limits
        The least altitude that the hold keeps, and what the aircraft can give to keep it.
    gains
        With which the controller follows (V, gamma, chi).
    speed
        Airspeed, m/s.
    """

    settings: GuidanceSettings
    limits: FlightLimits
    gains: LoopGains
    speed: Scalar

    def clearance(self, belief: Belief) -> GroundClearance:
        """Whether the aircraft can still stay above its least altitude."""
        return ground_clearance(belief, self.limits)

    def lateral_acceleration_max(self, clearance: GroundClearance, gravity: Scalar) -> Scalar:
        """With which the aircraft can turn in level flight, m/s^2: by its bank limit, its lift and its load factor."""
        by_bank = gravity * jnp.tan(jnp.minimum(self.limits.bank_max, _BANK_MOST))
        by_lift = jnp.sqrt(jnp.maximum(clearance.normal_acceleration_max**2 - gravity**2, 1e-6))
        return jnp.minimum(by_bank, by_lift)

    def command(
        self,
        belief: Belief,
        clearance: GroundClearance,
        rendezvous: Rendezvous,
        distance_min: Scalar,
        plan: AircraftPlan,
        is_breakaway: Flag,
        instant: Instant,
    ) -> tuple[PathCommand, Vector3]:
        """Command, and the point of the hold (NED, m) that the aircraft is to be at.

        Parameters
        ----------
        belief
            What the aircraft believes; of its goal too.
        clearance
            As of now.
        rendezvous
            Its stand-off's height is the hold's.
        distance_min
            Least distance from the goal, m.
        plan
            Whose arrival is flown on from.
        broke_off
            Whether the aircraft is not where its plan has it, and must not follow the planner's hold.
        instant
            Now.
        """
        if belief.goal is None:
            raise ValueError("a hold is flown around a goal: the aircraft has none")
        time, goal_n, goal_velocity_n = instant.time, belief.goal.position_n, belief.goal.velocity_n
        position_n, settings = belief.state.position_n, self.settings
        velocity_n, wind_n = chart_velocities(belief)
        relative_n = position_n - goal_n
        # where the rendezvous lies below the least altitude the hold does not
        height = jnp.maximum(-rendezvous.stand_off_n[2], self.limits.altitude_min + goal_n[2])
        if plan.hold is not None:
            circle = plan.hold.circles
            height = circle.height
            settings = eqx.tree_at(lambda s: (s.hold_radius, s.hold_turn), settings, (circle.radius, circle.turn))
        # a circle narrower than the least distance keeps it by its height
        short = jnp.maximum(distance_min**2 - settings.hold_radius**2, 0.0)
        height = jnp.maximum(height, jnp.where(short > 0.0, jnp.sqrt(jnp.where(short > 0.0, short, 1.0)), -jnp.inf))
        circle_n = hold_point(relative_n, goal_n, height, settings)
        direction_n = select_if_any(  # of the arrival: it counts near the goal only
            crosses_centre(relative_n, settings),
            lambda: plan.trajectory.velocity_n(plan.arrival_time) - goal_velocity_n,
            velocity_n - goal_velocity_n,
        )
        held = hold(relative_n, velocity_n, goal_velocity_n, wind_n, direction_n, height, self.speed, settings)
        if plan.hold is not None:
            ahead, foreseen = hold_reference(plan.hold, time, goal_n, goal_velocity_n, self.speed, plan.hold_reach)
            point = ahead.at(time)
            planned = follow(point, position_n, velocity_n, wind_n, settings), point.position_n
            on_it = foreseen & ~is_breakaway
            held, circle_n = jax.tree.map(lambda a, b: jnp.where(on_it, a, b), planned, (held, circle_n))
        command = command_from_chart(held, belief, instant.environment)
        return level_off_command(command, clearance, self.gains, belief.condition.earth.gravity), circle_n
