"""Interface of a planner.

The reports and the performance that it plans with, the rendezvous it plans for, and the plan that it returns for
each aircraft.
"""

import abc
from types import ModuleType
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.numerics.arrays import as_array, namespace
from anser.numerics.randomness import AbstractRandomness
from anser.parts.paths import AbstractReference, polar
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm, safe_sqrt, unit_vector


class Rendezvous(eqx.Module):
    """How an aircraft is to meet its goal; arrays throughout, so that other numbers do not recompile."""

    stand_off_n: Vector3
    """From the goal to the rendezvous, NED, m (300 m above the goal is (0, 0, -300))."""
    course: Scalar
    """Prescribed course over the ground at arrival, rad."""
    course_prescribed: Flag
    path_angle: Scalar
    """Prescribed path angle over the ground at arrival, up positive, rad."""
    path_angle_prescribed: Flag


def make_rendezvous(
    stand_off_n: Vector3, course: ScalarLike | None = None, path_angle: ScalarLike | None = None
) -> Rendezvous:
    """Rendezvous with the final course and path angle (over the ground, rad) prescribed where given."""
    return Rendezvous(
        stand_off_n,
        as_array(0.0 if course is None else course),
        as_array(course is not None, bool),
        as_array(0.0 if path_angle is None else path_angle),
        as_array(path_angle is not None, bool),
    )


def time_to_go(relative_position: Vector3, relative_velocity: Vector3, speed: ScalarLike) -> tuple[Scalar, Flag]:
    """Shortest time in which a point of given speed can meet a steadily moving one on a straight line.

    Parameters
    ----------
    relative_position
        From the aircraft to the moving point, NED, m.
    relative_velocity
        Velocity of the moving point relative to the air, NED, m/s.
    speed
        Airspeed, m/s.

    Returns
    -------
    Time to go, s, and whether one exists. Where the goal outruns the aircraft, the time is a finite stand-in: the
    range over the sum of both speeds.

    Notes
    -----
    Theory section 7: (W^2 - V^2) t^2 + 2 (R.W) t + R^2 = 0, smallest positive root, in the form that does not cancel
    (section 9, item 5 for the sign of R.W).
    """
    a = jnp.sum(relative_velocity * relative_velocity) - speed**2
    b = jnp.sum(relative_position * relative_velocity)
    c = jnp.sum(relative_position * relative_position)
    discriminant = b * b - a * c
    exists = (a < 0.0) | ((b < 0.0) & (discriminant >= 0.0))
    between = safe_sqrt(discriminant)
    away = b > 0.0
    divisor = jnp.where(away, -a, between - b)
    usable = exists & (divisor > 0.0)
    time = jnp.where(away, between + b, c) / jnp.where(usable, divisor, 1.0)
    stand_in = norm(relative_position) / (speed + norm(relative_velocity))
    return jnp.where(usable, time, stand_in), exists


def final_air_velocity(
    rendezvous: Rendezvous, line_n: Vector3, speed: ScalarLike, wind_n: Vector3
) -> tuple[Vector3, Flag]:
    """Velocity relative to the air at arrival.

    Parameters
    ----------
    rendezvous
        What is prescribed.
    line_n
        From start to rendezvous in the frame that drifts with the air, NED, m: the direction of arrival where nothing
        is prescribed. Where one of course and path angle is, the other is that of this arrival seen from the ground.
    speed
        Airspeed at arrival, m/s.
    wind_n
        Steady wind, NED, m/s.

    Returns
    -------
    Velocity, NED, m/s, always of the given length, and whether the prescribed direction over the ground can be flown:
    the ground speed g > 0 solves |g d - wind| = speed. Where none does, the velocity is that of the free arrival.
    """
    free = jnp.asarray(speed) * unit_vector(line_n, jnp.array([1.0, 0.0, 0.0]))
    seen = polar(free + wind_n, jnp.zeros(3))
    chi = jnp.where(rendezvous.course_prescribed, rendezvous.course, seen.chi)
    gamma = jnp.where(rendezvous.path_angle_prescribed, rendezvous.path_angle, seen.gamma)
    along = jnp.stack([jnp.cos(gamma) * jnp.cos(chi), jnp.cos(gamma) * jnp.sin(chi), -jnp.sin(gamma)])
    tail = jnp.sum(along * wind_n)
    discriminant = tail * tail - jnp.sum(wind_n * wind_n) + speed**2
    solvable = discriminant > 0.0
    ground_speed = tail + jnp.sqrt(jnp.where(solvable, discriminant, 1.0))
    prescribed = rendezvous.course_prescribed | rendezvous.path_angle_prescribed
    attainable = ~prescribed | (solvable & (ground_speed > 0.0))
    return jnp.where(prescribed & attainable, ground_speed * along - wind_n, free), attainable


_LEAST = 0.05  # of the deceleration at the start: there is always some


class IdleDeceleration(eqx.Module):
    """Drag less idle thrust per mass, as a share of a deceleration that it is told with; stacked, a fleet.

    Linear in airspeed between the entries, and beyond them that of the first and of the last. The drag due to lift goes
    with the square of the load factor. Each method takes one airspeed (m/s) and load factor, or equally many of each.

    Attributes
    ----------
    speeds
        Airspeeds, rising, m/s.
    level
        Share in level flight, load factor 1, at each of them.
    by_lift
        The part of it that is due to lift, not negative.
    """

    speeds: Float[Array, "*aircraft entries"]
    level: Float[Array, "*aircraft entries"]
    by_lift: Float[Array, "*aircraft entries"]

    def share(self, speed: Any, load_factor: Any) -> Any:
        """Share that can be counted upon: what a load factor above 1 adds is not."""
        xp = namespace(self, speed, load_factor)
        return self._between(xp, self._unloaded(xp, load_factor), speed)

    def least_share(self, slow: Any, fast: Any, load_factor: Any) -> Any:
        """The least `share` between two airspeeds, at a load factor or any greater one."""
        xp = namespace(self, slow, fast, load_factor)
        return -self._most(xp, -self._unloaded(xp, load_factor), slow, fast)

    def rise(self, speed: Any, load_factor: Any) -> Any:
        """By how much the share rises above that of level flight with a load factor above 1."""
        xp = namespace(self, speed, load_factor)
        return self._between(xp, self._loaded(xp, load_factor), speed)

    def greatest_rise(self, slow: Any, fast: Any, load_factor: Any) -> Any:
        """The greatest `rise` between two airspeeds, at a load factor or any smaller one."""
        xp = namespace(self, slow, fast, load_factor)
        return self._most(xp, self._loaded(xp, load_factor), slow, fast)

    def _unloaded(self, xp: ModuleType, load_factor: Any) -> Any:
        """Shares at a load factor, those of 1 above it, along another axis, the last."""
        level, by_lift = (_beside(load_factor, entries) for entries in (self.level, self.by_lift))
        unloaded = 1.0 - xp.clip(load_factor, 0.0, 1.0) ** 2
        return xp.maximum(level - xp.expand_dims(unloaded, -1) * by_lift, _LEAST)

    def _loaded(self, xp: ModuleType, load_factor: Any) -> Any:
        """What load factors above 1 add, along another axis, the last."""
        loaded = xp.maximum(load_factor, 1.0) ** 2 - 1.0
        return xp.expand_dims(loaded, -1) * _beside(load_factor, self.by_lift)

    def _between(self, xp: ModuleType, entries: Any, speed: Any) -> Any:
        speeds = _beside(speed, self.speeds)
        low, high = speeds[..., :-1], speeds[..., 1:]
        parts = xp.clip((xp.expand_dims(speed, -1) - low) / (high - low), 0.0, 1.0)
        return entries[..., 0] + xp.sum(parts * (entries[..., 1:] - entries[..., :-1]), axis=-1)

    def _most(self, xp: ModuleType, entries: Any, slow: Any, fast: Any) -> Any:
        """The greatest between two airspeeds: at either, or at an entry between them."""
        speeds = _beside(slow, self.speeds)
        inside = (speeds > xp.expand_dims(slow, -1)) & (speeds < xp.expand_dims(fast, -1))
        ends = xp.maximum(self._between(xp, entries, slow), self._between(xp, entries, fast))
        return xp.maximum(ends, xp.max(xp.where(inside, entries, -xp.inf), axis=-1))


def _beside(values: Any, entries: Any) -> Any:
    """Entries along another axis than those of some values, the last."""
    return entries.reshape((1,) * np.ndim(values) + entries.shape)


class AircraftReport(eqx.Module):
    """What one aircraft reports to the planner; stacked, a fleet. Velocities are rates in the Earth's chart.

    Attributes
    ----------
    position_n
        Its own, NED, m.
    air_velocity_n, wind_n
        Its velocity relative to the air and that of the air, as it measures them, NED, m/s.
    airspeed
        m/s.
    goal_position_n, goal_velocity_n
        Its goal as it takes it to be, NED, m and m/s over the ground.
    rendezvous
        How it is to meet the goal.
    active
        Whether it flies its plan. One that has stopped or has broken off does not: the others are planned without it.
    goal_covariance
        Of the goal's position and velocity as it takes them to be, NED, m and m/s; None: they are exact.
    """

    position_n: Vector3
    air_velocity_n: Vector3
    wind_n: Vector3
    airspeed: Scalar
    goal_position_n: Vector3
    goal_velocity_n: Vector3
    rendezvous: Rendezvous
    active: Flag
    goal_covariance: Float[Array, "*aircraft 6 6"] | None = None


class Performance(eqx.Module):
    """What one aircraft can do along its path from steady flight at its start; stacked, a fleet.

    Attributes
    ----------
    deceleration, acceleration
        With the engine idle, and with all its thrust, in level flight, m/s^2.
    idle
        What of that deceleration there is at other airspeeds and load factors.
    """

    deceleration: Float[Array, "..."]
    acceleration: Float[Array, "..."]
    idle: IdleDeceleration


class NetworkView(eqx.Module):
    """What one aircraft of a fleet without a centre shares with the others; stacked, for a fleet.

    Attributes
    ----------
    lag
        By how much its clock is behind the time, s.
    rate
        Of its clock.
    hears
        Whom it heard at the last exchange.
    offers
        Whether it offers another path.
    """

    lag: Scalar
    rate: Scalar
    hears: Bool[Array, " aircraft"]
    offers: Flag


class AircraftPlan(eqx.Module):
    """What the closed loop takes of a plan for one aircraft; stacked, for a fleet.

    Attributes
    ----------
    trajectory
        Where to be at which time up to the arrival.
    arrival_time
        When it is to be at its rendezvous, s.
    status
        Index into `PLAN_MESSAGES`, 0 where all is well.
    length
        Of its path, m.
    lateral_bend
        Parameter of the published paths, m; NaN where paths have none.
    renewal
        How the plan in force came about: index into `REPLANNING_MESSAGES`.
    hold
        What it flies after the arrival; None: what its own hold says.
    hold_reach
        How far its hold may go with a goal that moves otherwise than foreseen, m; None: as `hold_reference` has it.
    network
        Where nobody plans for all; else None.
    """

    trajectory: AbstractReference
    arrival_time: Scalar
    status: Count
    length: Scalar
    lateral_bend: Scalar
    replanning: Count
    hold: Any = None
    hold_reach: Scalar | None = None
    network: NetworkView | None = None


class AbstractPlanner(eqx.Module):
    """Planner of a fleet; concrete ones are final. Its state (`planner_state`) is a pytree of arrays of its own.

    Aircraft that are not active are planned for as nobody: the others go on without them.
    """

    @abc.abstractmethod
    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> Any:
        """State of the planner with a first plan, made from stacked reports at a time (s)."""

    @abc.abstractmethod
    def replan(self, planner_state: Any, time: ScalarLike, reports: AircraftReport) -> Any:
        """State of the planner with a plan renewed from stacked reports at a time (s)."""

    @abc.abstractmethod
    def observe(
        self,
        planner_state: Any,
        reports: AircraftReport,
        number: Count,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> Any:
        """State of the planner after one more step of flight, at whose start the fleet reported.

        Parameters
        ----------
        planner_state, reports
            Of the sample at the start of the step.
        number, step
            Of that sample, and s.
        randomness
            Of the flight; None: it may draw no random numbers.
        """

    @abc.abstractmethod
    def plans(self, planner_state: Any) -> AircraftPlan:
        """The plan in force; leading axis aircraft."""
