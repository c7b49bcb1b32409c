"""An estimator of an aircraft's own motion, of the air about it, and of its goal, from sensors with errors."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, Disturbance, condition
from anser.environment import AbstractWind, Gust, SteadyWind
from anser.numerics.randomness import BRIEFING
from anser.sensing.direct import goal_seen, seen_or_ahead
from anser.sensing.goal_filters import AbstractGoalFilter, OwnMotion
from anser.sensing.ideal import line_of_sight
from anser.sensing.interface import (
    AbstractEstimator,
    Belief,
    GoalState,
    Instant,
    Reading,
    Uncertainty,
    velocity_over_ground_n,
)
from anser.sensing.navigation import AirFilter, AirMotion, Navigation, NavigationFilter, acceleration_n
from anser.shapes import Scalar, Vector3
from anser.spatial import rotate, rotate_back, rotation_from_quaternion


class Briefing(eqx.Module):
    """What is known of a goal before the flight: its place and motion at the start, with an error that is drawn.

    Attributes
    ----------
    position_n, velocity_n
        True, NED, m and m/s.
    position_sigma, velocity_sigma
        Standard deviations per axis, horizontally, m and m/s; the altitude is known to a tenth of that.
    """

    position_n: Vector3
    velocity_n: Vector3
    position_sigma: Scalar
    velocity_sigma: Scalar

    def drawn(self, instant: Instant) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
        """Place and velocity as they are said to be, and their standard deviations."""
        axes = jnp.array([1.0, 1.0, _VERTICAL])
        sigmas = jnp.concatenate([self.position_sigma * axes, self.velocity_sigma * axes])
        truth = jnp.concatenate([self.position_n, self.velocity_n])
        return truth + sigmas * instant.normals(BRIEFING, 6, once=True), sigmas


_VERTICAL = 0.1  # of the uncertainty of a goal's altitude and climb, beside that in the plane


class Tracked(eqx.Module):
    """What the estimator carries along; None where that part is exact, but for a goal: where it was last seen."""

    own: Navigation | None
    air: AirMotion | None
    goal: Any


class TrackingEstimator(AbstractEstimator):
    """Filters of the own motion, of the air and of the goal; each may be left out where its sensors are exact.

    Attributes
    ----------
    own
        None: position, velocity, attitude and rates are taken as they are read.
    air
        None: so is the air.
    goal
        Filter of the goal; None: its line of sight is exact, seen from where the aircraft takes itself to be.
    briefing
        What is known of the goal beforehand; with a filter of the goal only.
    model
        What the aircraft believes of its airframe; None: the airframe itself.
    """

    own: NavigationFilter | None = None
    air: AirFilter | None = None
    goal: AbstractGoalFilter | None = None
    briefing: Briefing | None = None
    model: AbstractAirframe | None = None

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> Tracked:
        """After the first reading."""
        state, now, wind = reading.state, reading.now, instant.environment.wind
        own = goal = None
        if self.own is not None:
            assert reading.fix is not None
            R_bn = rotation_from_quaternion(state.quaternion)
            own = self.own.init(reading.fix, acceleration_n(R_bn, reading.specific_force_b, now.earth))
        if self.goal is not None:
            assert self.briefing is not None
            goal = self.goal.init(*self.briefing.drawn(instant))
        elif reading.sight is not None:
            velocity_n = velocity_over_ground_n(now, state)
            goal = goal_seen(instant.environment.earth, reading.sight, state.position_n, velocity_n)
        air = None if self.air is None else self.air.init(wind.at(state.position_n, instant.time))
        return Tracked(own, air, goal)

    def estimate(
        self, memory: Tracked, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, Tracked]:
        """Take in a reading."""
        state, now, step = reading.state, reading.now, instant.step
        airframe = airframe if self.model is None else self.model
        own, air, goal, uncertainty, seen_goal = memory.own, memory.air, memory.goal, None, None
        own_covariance = jnp.zeros((3, 3), step.dtype)
        if self.own is not None and own is not None:
            assert reading.fix is not None
            R_bn = rotation_from_quaternion(state.quaternion)
            earth = instant.environment.earth.local(own.position_n, own.velocity_n)
            felt_n = acceleration_n(R_bn, reading.specific_force_b, earth)
            moved = self.own.step(own, reading.fix, felt_n, earth.chart_scale, step)
            own = jax.tree.map(lambda new, old: jnp.where(instant.number > 0, new, old), moved, own)
            state = eqx.tree_at(
                lambda s: (s.position_n, s.velocity_b), state, (own.position_n, rotate(R_bn, own.velocity_n))
            )
            own_covariance = own.position_covariance
        if self.air is not None and air is not None:
            R_bn = rotation_from_quaternion(state.quaternion)
            velocity_n = rotate_back(R_bn, state.velocity_b)
            measured_b = reading.velocity_air_b
            if measured_b is None:
                measured_b = rotate(now.R_bn, velocity_over_ground_n(now, reading.state) - now.wind_n)
            air = self.air.step(air, R_bn, velocity_n, measured_b, step)
            environment = eqx.tree_at(lambda e: e.wind, instant.environment, SteadyWind(air.wind_n), is_leaf=_is_wind)
            disturbance = Disturbance(Gust(air.gust_b, jnp.zeros_like(air.gust_b)), jnp.ones_like(step))
            now = condition(airframe, environment, instant.time, state, disturbance=disturbance)
        elif self.own is not None or self.model is not None:
            now = condition(airframe, instant.environment, instant.time, state)
        sight = reading.sight
        if self.goal is not None:
            assert reading.goal is not None
            velocity_n = velocity_over_ground_n(now, state)
            motion = OwnMotion(state.position_n, velocity_n)
            goal, found = self.goal.step(goal, reading.goal, motion, instant)
            seen_goal = GoalState(found.mean[:3], found.mean[3:])
            sight = line_of_sight(instant.environment.earth, state.position_n, velocity_n, seen_goal)
            covariance = found.covariance
            if reading.goal.kind == "sight":  # seen from a place that is uncertain itself
                covariance = covariance + jnp.pad(own_covariance, (0, 3))
            uncertainty = Uncertainty(own_covariance, covariance, found.seen, found.nis, found.status)
        elif sight is not None and goal is not None:
            velocity_n = velocity_over_ground_n(now, state)
            seen = goal_seen(instant.environment.earth, sight, state.position_n, velocity_n)
            seen_goal = goal = seen_or_ahead(seen, goal, reading, instant)
        belief = Belief(airframe, state, now, reading.specific_force_b, sight, seen_goal, uncertainty)
        return belief, Tracked(own, air, goal)


def _is_wind(value: Any) -> bool:
    return isinstance(value, AbstractWind)
