"""One arrival time for a fleet, and a trajectory for each aircraft that meets it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Real

from anser.numerics.newton import bracketed_newton
from anser.planning.arc_length import arc_length
from anser.planning.rendezvous import Rendezvous, final_air_velocity, time_to_go
from anser.planning.shape import solve_lateral_bend
from anser.planning.trajectory import Trajectory, bend_trajectory, fit_trajectory
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3

PLANNED, GOAL_OUTRUNS, NO_COMMON_TIME, NO_BEND, DIRECTION_UNATTAINABLE = range(5)
PLAN_MESSAGES = (
    "planned",
    "the goal outruns the aircraft: no path meets it at this airspeed in this wind; the others are planned without it",
    "no arrival time was found at which the longest path of the fleet takes just that time",
    "no lateral bend gives the path the length of the fleet's longest",
    "the prescribed direction of arrival cannot be flown in this wind; it was left free",
)

# Arrival times tried for a first change of sign, in units of the fleet's longest time to go. That is a lower bound:
# no path is shorter than the straight line. Goals at rest need at most 2.2 (the slope terms of the cubic have length
# 0.53 T V at most); of 20,000 random tasks with goals at up to 60 percent of the airspeed none needed more than 1.7.
_TIME_RATIOS = (0.999, 1.001, 1.05, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)
# The same tasks took 8 steps at most.
ARRIVAL_STEPS = 12
# The fixed point is met when the longest path takes the arrival time to within this, s.
ARRIVAL_TOLERANCE_S = 1e-9
# Least horizon, s: keeps a fleet that is already there from dividing by zero.
_SHORTEST_S = 1e-3


class FleetPlan(eqx.Module):
    """One trajectory per aircraft, all of one arrival time."""

    trajectories: Trajectory
    """Stacked, leading axis aircraft."""
    arrival_time: Scalar
    """Common time of arrival, s."""
    nominal_lengths: Float[Array, " aircraft"]
    """Lengths of the unbent air paths, m."""
    reference_length: Scalar
    """The longest of them among aircraft that can reach their goal, m; the length all fly."""
    lateral_bends: Float[Array, " aircraft"]
    """m, positive to the right; exactly 0 for the farthest."""
    farthest: Count
    """Index of the aircraft that flies its nominal path."""
    converged: Bool[Array, " aircraft"]
    """Whether this aircraft's trajectory has the reference length and arrival time."""
    goal_reachable: Bool[Array, " aircraft"]
    status: Int[Array, " aircraft"]
    """Index into PLAN_MESSAGES."""


class _Task(eqx.Module):
    """What one aircraft knows when it plans."""

    position_n: Vector3
    air_velocity_n: Vector3
    goal_position_n: Vector3
    goal_velocity_n: Vector3
    rendezvous: Rendezvous
    wind_n: Vector3


def _nominal(task: _Task, start_time: Scalar, duration: Scalar, speed: Scalar) -> tuple[Trajectory, Flag]:
    """Unbent trajectory to where the rendezvous will be, and whether the prescribed arrival direction is flown."""
    drift = task.goal_velocity_n - task.wind_n
    end = task.goal_position_n + drift * duration + task.rendezvous.stand_off_n
    final, attainable = final_air_velocity(task.rendezvous, end - task.position_n, speed, task.wind_n)
    fit = fit_trajectory(start_time, duration, task.position_n, task.air_velocity_n, end, final, wind_n=task.wind_n)
    return fit, attainable


def _lengths(tasks: _Task, duration: Scalar, speed: Scalar) -> Float[Array, " aircraft"]:
    return jax.vmap(lambda task: arc_length(_nominal(task, jnp.zeros(()), duration, speed)[0]))(tasks)


def _shortfall(duration: Scalar, data: tuple[_Task, Scalar, Bool[Array, " aircraft"]]) -> tuple[Scalar, Scalar]:
    """Arrival time minus what the longest path takes at the airspeed, and its slope."""
    tasks, speed, counted = data

    def value(duration: Scalar) -> Scalar:
        return duration - jnp.max(jnp.where(counted, _lengths(tasks, duration, speed), 0.0)) / speed

    return jax.jvp(value, (duration,), (jnp.ones_like(duration),))


def _common_duration(tasks: _Task, speed: Scalar) -> tuple[Scalar, Flag, Bool[Array, " aircraft"]]:
    """Least time that the longest path just takes; whether it was found; which goals can be reached."""

    def to_go(task: _Task) -> tuple[Scalar, Flag]:
        line = task.goal_position_n + task.rendezvous.stand_off_n - task.position_n
        return time_to_go(line, task.goal_velocity_n - task.wind_n, speed)

    straight, exists = jax.vmap(to_go)(tasks)
    # Only where the search begins: the result does not depend on it, and its gradient is the implicit one.
    straight = jax.lax.stop_gradient(straight)
    least = jnp.where(jnp.any(exists), jnp.max(jnp.where(exists, straight, 0.0)), jnp.max(straight))
    trials = jnp.maximum(least, _SHORTEST_S) * jnp.array(_TIME_RATIOS)
    taken = jax.vmap(lambda trial: _lengths(tasks, trial, speed))(trials) / speed
    in_time = taken <= trials[:, None]
    reachable = exists & jnp.any(in_time, axis=0)
    all_in_time = jnp.all(in_time | ~reachable[None, :], axis=1)
    # The first trial in time; its predecessor is not (or is the first of all, which no path beats).
    index = jnp.maximum(jnp.argmax(all_in_time), 1)
    low, high = trials[index - 1], trials[index]
    root = bracketed_newton(_shortfall, (tasks, speed, reachable), low, high, high, ARRIVAL_STEPS)
    found = jnp.any(all_in_time) & (jnp.abs(root.residual) <= ARRIVAL_TOLERANCE_S)
    return root.x, found, reachable


def coordinate(
    time: ScalarLike,
    positions_n: Float[Array, "aircraft 3"],
    air_velocities_n: Float[Array, "aircraft 3"],
    goal_positions_n: Float[Array, "aircraft 3"],
    goal_velocities_n: Float[Array, "aircraft 3"],
    rendezvous: Rendezvous,
    speed: ScalarLike,
    wind_n: Float[Array, "aircraft 3"],
    sides: Real[Array, " aircraft"],
) -> FleetPlan:
    """Plan a fleet's simultaneous arrival from its present state.

    Parameters
    ----------
    time
        Now, s.
    positions_n
        Aircraft, NED, m.
    air_velocities_n
        Their velocities relative to the air, NED, m/s.
    goal_positions_n, goal_velocities_n
        Each aircraft's goal as sensed now, NED, m and m/s over the ground; predicted at steady velocity.
    rendezvous
        Stacked, one per aircraft.
    speed
        Mean airspeed of all, m/s.
    wind_n
        Wind as measured by each aircraft, NED, m/s.
    sides
        Positive or zero: detour to the right; negative: to the left.

    Returns
    -------
    The plan. Failures stand in `status` per aircraft, see PLAN_MESSAGES; the numbers stay finite.

    Notes
    -----
    Theory section 8. The fixed point T = max_i L_i(T)/V is solved as a root, Newton in a bracket, because plain
    iteration contracts slowly: to 1e-9 s it takes up to 40 rounds with goals at 20 percent of the airspeed and up to
    160 at 60 percent. The longest time to go along straight lines is a lower bound of it.
    """
    start, speed = jnp.asarray(time, dtype=float), jnp.asarray(speed, dtype=float)
    tasks = _Task(positions_n, air_velocities_n, goal_positions_n, goal_velocities_n, rendezvous, wind_n)
    duration, found, reachable = _common_duration(tasks, speed)

    nominal, attainable = jax.vmap(lambda task: _nominal(task, start, duration, speed))(tasks)
    lengths = jax.vmap(arc_length)(nominal)
    counted = jnp.where(reachable | ~jnp.any(reachable), lengths, 0.0)
    farthest, reference = jnp.argmax(counted), jnp.max(counted)

    bends = jax.vmap(lambda path, side: solve_lateral_bend(path, reference, side))(nominal, sides)
    kappa = jnp.where(jnp.arange(lengths.shape[0]) == farthest, 0.0, bends.kappa)
    trajectories = jax.vmap(bend_trajectory)(nominal, kappa)
    status = jnp.where(attainable, PLANNED, DIRECTION_UNATTAINABLE)
    status = jnp.where(bends.converged, status, NO_BEND)
    status = jnp.where(found, status, NO_COMMON_TIME)
    status = jnp.where(reachable, status, GOAL_OUTRUNS)
    return FleetPlan(
        trajectories=trajectories,
        arrival_time=start + duration,
        nominal_lengths=lengths,
        reference_length=reference,
        lateral_bends=kappa,
        farthest=farthest,
        converged=bends.converged & found & reachable,
        goal_reachable=reachable,
        status=status,
    )
