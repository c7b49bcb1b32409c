"""Interface of planners, which make a plan for every aircraft from reports and performance of all aircraft."""

import abc
from collections.abc import Iterator
from types import ModuleType
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.compiling.program import PreparedProgram
from anser.numerics.arrays import as_array, namespace
from anser.numerics.randomness import AbstractRandomness
from anser.parts.part import AbstractPart
from anser.parts.paths import AbstractReference, StraightPath, polar
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm, safe_sqrt, unit_vector


class Rendezvous(eqx.Module):
    """Rendezvous point relative to the goal, and the prescribed directions of arrival."""

    stand_off_n: Vector3  #: Position of the point relative to the goal, NED, m; (0, 0, -300) is 300 m above the goal.
    course: Scalar  #: Prescribed course over the ground at arrival, rad.
    course_prescribed: Flag  #: Whether `course` is prescribed; False: free.
    path_angle: Scalar  #: Prescribed path angle over the ground at arrival, up positive, rad.
    path_angle_prescribed: Flag  #: Whether `path_angle` is prescribed; False: free.


def make_rendezvous(
    stand_off_n: Vector3, course: ScalarLike | None = None, path_angle: ScalarLike | None = None
) -> Rendezvous:
    """Build a rendezvous at `stand_off_n` (NED, m) from the goal.

    Course and path angle over the ground at arrival (rad) are free if None.
    """
    return Rendezvous(
        stand_off_n,
        as_array(0.0 if course is None else course),
        as_array(course is not None, bool),
        as_array(0.0 if path_angle is None else path_angle),
        as_array(path_angle is not None, bool),
    )


def time_to_go(relative_position: Vector3, relative_velocity: Vector3, speed: ScalarLike) -> tuple[Scalar, Flag]:
    """Compute the least time, s, in which an aircraft on a straight line at constant airspeed meets a moving point.

    Parameters
    ----------
    relative_position, relative_velocity
        Position of the point relative to the aircraft, m, and its velocity relative to the air, m/s, NED.

    Returns
    -------
    Time to go (s), and whether the aircraft can meet the point. If the point outruns the aircraft, the time is a
    finite placeholder: range / (sum of both speeds).

    Notes
    -----
    Theory section 7: (W^2 - V^2) t^2 + 2 (R.W) t + R^2 = 0 with relative position R, relative velocity W and airspeed
    V; smallest positive root, in a form without cancellation (section 9, item 5 for the sign of R.W).
    """
    a = jnp.sum(relative_velocity * relative_velocity) - speed**2
    b = jnp.sum(relative_position * relative_velocity)
    c = jnp.sum(relative_position * relative_position)
    discriminant = b * b - a * c
    exists = (a < 0.0) | ((b < 0.0) & (discriminant >= 0.0))
    root = safe_sqrt(discriminant)
    is_receding = b > 0.0
    divisor = jnp.where(is_receding, -a, root - b)
    usable = exists & (divisor > 0.0)
    time = jnp.where(is_receding, root + b, c) / jnp.where(usable, divisor, 1.0)
    stand_in = norm(relative_position) / (speed + norm(relative_velocity))
    return jnp.where(usable, time, stand_in), exists


def final_air_velocity(
    rendezvous: Rendezvous, line_n: Vector3, speed: ScalarLike, wind_n: Vector3
) -> tuple[Vector3, Flag]:
    """Compute the velocity relative to the air (NED, m/s) at arrival in the prescribed direction over the ground.

    Parameters
    ----------
    line_n
        Vector from start to rendezvous in the frame of the moving air, NED, m. If no direction is prescribed, the
        aircraft arrives along `line_n`. If only course or path angle is prescribed, the missing angle over the ground
        is taken from a flight along `line_n`.
    speed, wind_n
        Airspeed at arrival, m/s, and steady wind, NED, m/s.

    Returns
    -------
    Velocity relative to the air, and whether the prescribed direction over the ground can be flown (True if no
    direction is prescribed). A direction with the unit vector d can be flown if a ground speed g > 0 solves
    |g d - wind| = `speed`. If no direction is prescribed or can be flown, the velocity is along `line_n`.
    """
    straight_velocity = jnp.asarray(speed) * unit_vector(line_n, jnp.array([1.0, 0.0, 0.0]))
    straight_path = polar(straight_velocity + wind_n, jnp.zeros(3))
    chi = jnp.where(rendezvous.course_prescribed, rendezvous.course, straight_path.chi)
    gamma = jnp.where(rendezvous.path_angle_prescribed, rendezvous.path_angle, straight_path.gamma)
    along = jnp.stack([jnp.cos(gamma) * jnp.cos(chi), jnp.cos(gamma) * jnp.sin(chi), -jnp.sin(gamma)])
    tail_wind = jnp.sum(along * wind_n)
    discriminant = tail_wind * tail_wind - jnp.sum(wind_n * wind_n) + speed**2
    solvable = discriminant > 0.0
    ground_speed = tail_wind + jnp.sqrt(jnp.where(solvable, discriminant, 1.0))
    prescribed = rendezvous.course_prescribed | rendezvous.path_angle_prescribed
    attainable = ~prescribed | (solvable & (ground_speed > 0.0))
    return jnp.where(prescribed & attainable, ground_speed * along - wind_n, straight_velocity), attainable


_LEAST = 0.05  # least deceleration, as a ratio to the deceleration at the start


class IdleDeceleration(eqx.Module):
    """Deceleration with idle thrust, (drag - thrust) / mass, as a table over airspeed; stacked for a fleet.

    The values are ratios to the level deceleration at the flight's start (see `Performance.idle`), linear between the
    airspeeds of the table and constant beyond. The methods take an airspeed (m/s) and a load factor, or two arrays.
    """

    speeds: Float[Array, "*aircraft entries"]  # airspeeds of the table, rising, m/s
    level: Float[Array, "*aircraft entries"]  # relative deceleration in level flight (load factor 1) at each airspeed
    by_lift: Float[Array, "*aircraft entries"]  # part of `level` due to lift, proportional to (load factor)^2

    def share(self, speed: Any, load_factor: Any) -> Any:
        """Return the deceleration at an airspeed (m/s) as a ratio to that at the flight's start; at least `_LEAST`.

        A load factor below 1 reduces the drag due to lift; a load factor above 1 has no effect here, see `rise`.
        """
        array_module = namespace(self, speed, load_factor)
        return self._interpolate(array_module, self._unloaded_entries(array_module, load_factor), speed)

    def least_share(self, slow: Any, fast: Any, load_factor: Any) -> Any:
        """Return the minimum of `share` between two airspeeds (m/s), for load factors of at least `load_factor`."""
        array_module = namespace(self, slow, fast, load_factor)
        return -self._maximum(array_module, -self._unloaded_entries(array_module, load_factor), slow, fast)

    def rise(self, speed: Any, load_factor: Any) -> Any:
        """Return the increase of `share` due to a load factor above 1; 0 for a load factor up to 1."""
        array_module = namespace(self, speed, load_factor)
        return self._interpolate(array_module, self._load_increases(array_module, load_factor), speed)

    def greatest_rise(self, slow: Any, fast: Any, load_factor: Any) -> Any:
        """Return the maximum of `rise` between two airspeeds (m/s), for load factors up to `load_factor`."""
        array_module = namespace(self, slow, fast, load_factor)
        return self._maximum(array_module, self._load_increases(array_module, load_factor), slow, fast)

    def _unloaded_entries(self, array_module: ModuleType, load_factor: Any) -> Any:
        """Return `share` at every airspeed of the table; the last axis is the airspeeds."""
        level, by_lift = (_expand_entries(load_factor, entries) for entries in (self.level, self.by_lift))
        unloaded = 1.0 - array_module.clip(load_factor, 0.0, 1.0) ** 2
        return array_module.maximum(level - array_module.expand_dims(unloaded, -1) * by_lift, _LEAST)

    def _load_increases(self, array_module: ModuleType, load_factor: Any) -> Any:
        """Return `rise` at every airspeed of the table; the last axis is the airspeeds."""
        loaded = array_module.maximum(load_factor, 1.0) ** 2 - 1.0
        return array_module.expand_dims(loaded, -1) * _expand_entries(load_factor, self.by_lift)

    def _interpolate(self, array_module: ModuleType, entries: Any, speed: Any) -> Any:
        speeds = _expand_entries(speed, self.speeds)
        low, high = speeds[..., :-1], speeds[..., 1:]
        parts = array_module.clip((array_module.expand_dims(speed, -1) - low) / (high - low), 0.0, 1.0)
        return entries[..., 0] + array_module.sum(parts * (entries[..., 1:] - entries[..., :-1]), axis=-1)

    def _maximum(self, array_module: ModuleType, entries: Any, slow: Any, fast: Any) -> Any:
        """Return the maximum of tabulated values in the closed interval between two airspeeds (m/s)."""
        speeds = _expand_entries(slow, self.speeds)
        inside = (speeds > array_module.expand_dims(slow, -1)) & (speeds < array_module.expand_dims(fast, -1))
        endpoint_maximum = array_module.maximum(
            self._interpolate(array_module, entries, slow), self._interpolate(array_module, entries, fast)
        )
        return array_module.maximum(
            endpoint_maximum, array_module.max(array_module.where(inside, entries, -array_module.inf), axis=-1)
        )


def _expand_entries(values: Any, entries: Any) -> Any:
    """Return table entries with an axis of length 1 in front for each axis of `values`, for broadcasting."""
    return entries.reshape((1,) * np.ndim(values) + entries.shape)


class AircraftReport(eqx.Module):
    """Report of one aircraft to the planner: its motion, its goal's motion and its rendezvous; stacked for a fleet.

    All vectors are NED in the Earth's chart, m and m/s; the motion of the goal and its covariance are estimates.
    """

    position_n: Vector3
    #: Measured velocity relative to the air, measured wind, and true airspeed (m/s, not scaled to the chart).
    air_velocity_n: Vector3
    wind_n: Vector3
    airspeed: Scalar
    goal_position_n: Vector3
    goal_velocity_n: Vector3
    rendezvous: Rendezvous
    #: Whether the aircraft flies to its goal by its plan; planning ignores aircraft that stopped, broke away or left.
    active: Flag
    #: Whether the aircraft has left the fleet and flies its exit path, which the other aircraft should avoid.
    has_left: Flag
    #: Covariance of the goal's position and velocity, NED, m and m/s; None if they are exact.
    goal_covariance: Float[Array, "*aircraft 6 6"] | None = None

    def rendezvous_n(self, duration: ScalarLike) -> Vector3:
        """Return the position of the rendezvous after a duration (s), NED, m; the goal moves at constant velocity."""
        return self.goal_position_n + duration * self.goal_velocity_n + self.rendezvous.stand_off_n


class Performance(eqx.Module):
    """Greatest acceleration and deceleration along the path of one aircraft; stacked for a fleet."""

    deceleration: Float[Array, "..."]  #: With idle thrust, in level flight at the airspeed of the start, m/s^2.
    acceleration: Float[Array, "..."]  #: With full thrust, in level flight at the airspeed of the start, m/s^2.
    #: Deceleration at other airspeeds and load factors, as a ratio to the greater of `deceleration` and
    #: `ACCELERATION_FLOOR` of `anser.steady.performance`.
    idle: IdleDeceleration


class NetworkView(eqx.Module):
    """Clock and message data of one aircraft in a decentralised fleet, for the record; stacked for a fleet."""

    #: True time minus the aircraft's clock, s. On its path, the aircraft follows the point for the time of its clock.
    lag: Scalar
    rate: Scalar  #: Rate of the clock; 1: as fast as true time.
    hears: Bool[Array, " aircraft"]  #: True for each aircraft from which a message arrived at the last exchange.
    offers: Flag  #: Whether the aircraft offers the fleet a new path.


_GOAL_OUTRUNS = 1  # status `GOAL_OUTRUNS` of `anser.planning.published.coordination`, a room that imports this module


class AircraftPlan(eqx.Module):
    """Plan of one aircraft, stacked for a fleet: path, arrival time, hold (motion after the arrival) and status."""

    trajectory: AbstractReference  #: Planned motion up to the arrival, which the guidance follows.
    arrival_time: Scalar  #: Time of arrival at the rendezvous, s.
    #: Index into `anser.planning.published.coordination.PLAN_MESSAGES`; 0: success.
    status: Integer = eqx.field(default_factory=lambda: jnp.zeros((), dtype=jnp.int32))
    length: Scalar = eqx.field(default_factory=lambda: jnp.asarray(jnp.nan))  #: Length of the path, m.
    #: 16 times the greatest sideways offset by which the published planner lengthens a path, m; NaN: other planner.
    lateral_bend: Scalar = eqx.field(default_factory=lambda: jnp.asarray(jnp.nan))
    #: Origin of the plan: a code of `anser.planning.certified.replanning`, such as `FIRST_PLAN`.
    replanning: Integer = eqx.field(default_factory=lambda: jnp.zeros((), dtype=jnp.int32))
    hold: Any = None  #: Planned motion after the arrival; None: the hold of the aircraft's mission.
    #: Greatest distance by which the hold moves with a goal that deviates from its forecast, m. None: no such limit,
    #: but the hold is flown only if the goal's velocity is close to the forecast (see `hold_reference`).
    hold_reach: Scalar | None = None
    network: NetworkView | None = None  #: Clock and message data; None if the fleet is not decentralised.

    @classmethod
    def straight(
        cls, reports: AircraftReport, time: ScalarLike, arrival_time: ScalarLike | None = None
    ) -> "AircraftPlan":
        """Return stacked plans of straight paths at constant speed from the reported positions to the rendezvous.

        Parameters
        ----------
        reports
            Stacked reports at `time` (s).
        arrival_time
            Common time of arrival, s; the required airspeeds are not checked. None: the earliest time at which every
            active aircraft can arrive at its airspeed, except aircraft that the goal outruns; the status of these is
            `GOAL_OUTRUNS` of `anser.planning.published.coordination`.
        """

        def meeting(report: AircraftReport) -> tuple[Scalar, Flag]:
            air_motion_n = report.goal_velocity_n - report.wind_n
            return time_to_go(report.rendezvous_n(0.0) - report.position_n, air_motion_n, report.airspeed)

        if arrival_time is None:
            durations, exists = jax.vmap(meeting)(reports)
            longest = jnp.max(jnp.where(reports.active & exists, durations, -jnp.inf))
            common = time + jnp.where(jnp.isfinite(longest), longest, jnp.max(durations))
            status = jnp.where(reports.active & ~exists, _GOAL_OUTRUNS, 0).astype(jnp.int32)
        else:
            common, status = jnp.asarray(arrival_time), jnp.zeros(reports.active.shape, jnp.int32)

        def plan(report: AircraftReport, status: Integer) -> AircraftPlan:
            path = StraightPath(report.position_n, report.rendezvous_n(common - time), jnp.asarray(time), common)
            return cls(path, common, status)

        return jax.vmap(plan)(reports, status)


class AbstractPlanner(AbstractPart):
    """Interface of the planner of a fleet. Subclass this class directly, not a concrete planner.

    The planner state (`planner_state`) is a pytree of arrays. Compiled code calls `plans` and `observe` at every step
    and `replan` at the replanning times; these methods must return the same structure, shapes and dtypes each time. If
    a new plan needs too much computation for compiled steps, `replan_needed` returns True, and `replan_between_steps`
    makes the plan. An inactive aircraft gets no plan and does not constrain the fleet.
    """

    #: Whether most flights with random numbers (sensor errors, gusts) need a new plan from `replan_between_steps`.
    searches_often: ClassVar[bool] = False
    #: Whether arrival times may be postponed in flight.
    arrival_is_free: Flag = eqx.field(default_factory=lambda: as_array(True, bool), kw_only=True)

    @abc.abstractmethod
    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> Any:
        """Make the first plan from the stacked reports at `time` (s); return the planner state that contains the plan.

        `anser.simulation.start.start_flight` calls this method before the first step.
        """

    def initial_state(self, plan_state: Any, randomness: AbstractRandomness | None) -> Any:
        """Return the planner state at time 0 from `plan_state`, the result of planning in advance; by default equal."""
        return plan_state

    def replan_needed(self, planner_state: Any) -> Flag:
        """Whether the fleet needs a new plan that `replan` cannot make; must stay True until the plan is made.

        The flight then returns to the sample at which the need arose, and `replan_between_steps` makes the plan. By
        default False.
        """
        return as_array(False, bool)

    def replan_between_steps(
        self,
        planner_state: Any,
        time: float,  # current time, s
        reports: AircraftReport,
    ) -> Any:
        """Make the plan that `replan_needed` asks for, by any Python code; return the new planner state.

        Flights of `anser.missions` call this method before the step at which the plan is needed; `anser.simulation.fly`
        alone never does. By default raises NotImplementedError.
        """
        raise NotImplementedError(f"{type(self).__name__}.replan_needed asks for a plan: define replan_between_steps")

    def prepare_replanning(self, planner_state: Any, reports: AircraftReport) -> Iterator[PreparedProgram]:
        """Yield the programs of `replan_between_steps`, compiled for arguments of these shapes; by default none.

        If `searches_often` is True, the programs are compiled together with the steps of a flight with random numbers.
        """
        return iter(())

    def replan(self, planner_state: Any, time: ScalarLike, reports: AircraftReport) -> Any:
        """Correct the plan from the stacked reports at `time` (s), or make a new plan; return the new planner state.

        By default the plan is unchanged.
        """
        return planner_state

    def observe(
        self,
        planner_state: Any,
        reports: AircraftReport,
        number: Integer,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> Any:
        """Return the planner state after one step of flight, whether or not a plan was made; by default unchanged.

        `reports` and the sample number `number` are for the start of the step; `step` is the sampling period, s.
        `randomness` is None in a flight without a seed.
        """
        return planner_state

    def plans(self, planner_state: Any) -> AircraftPlan:
        """Return the plan in force of every aircraft, stacked; leading axis aircraft.

        By default the planner state must be an `AircraftPlan`, and each scalar in it is repeated for every aircraft.
        """
        count = planner_state.arrival_time.shape[:1]
        return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, count) if jnp.ndim(leaf) == 0 else leaf, planner_state)
