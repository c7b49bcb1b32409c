"""A path by how it is steered: heading, rate of climb and airspeed as smooth functions of time, none prescribed.

Each is a quadratic spline in time, so that the path's acceleration is continuous. A spline stays between its
coefficients: airspeed and rate of climb keep within limits if these do.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environment import AbstractWind
from anser.numerics.quadrature import gauss_legendre
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike

CELLS = 32
"""Equal intervals of the splines; a path's intervals divide them evenly."""
_RULE = gauss_legendre(4)
_SQUARE_MIN = 1.0  # (m/s)^2


class Steering(eqx.Module):
    """How one aircraft is steered.

    Attributes
    ----------
    duration
        s.
    altitude_0
        m.
    start
        North and east, m.
    headings, climbs, speeds
        Coefficients of the splines: heading through the air, rad; rate of climb over the ground, airspeed, m/s.
    """

    duration: Scalar
    altitude_0: Scalar
    start: Float[Array, "2"]
    headings: Float[Array, "34"]
    climbs: Float[Array, "34"]
    speeds: Float[Array, "34"]

    @property
    def cell(self) -> Scalar:
        """Length of an interval of the splines, s."""
        return self.duration / CELLS


class Steered(eqx.Module):
    """What comes of steering at some instants; (instant,) unless said otherwise.

    Attributes
    ----------
    heading, heading_dot
        Through the air, rad and rad/s.
    climb, climb_dot
        Over the ground or through the air, m/s and m/s^2.
    speed, speed_dot
        Airspeed, m/s and m/s^2.
    """

    heading: Array
    heading_dot: Array
    climb: Array
    climb_dot: Array
    speed: Array
    speed_dot: Array

    def through(self, winds_n: Array, winds_dot_n: Array) -> "Steered":
        """The same with the rate of climb through the air, from that over the ground."""
        climbs = (self.climb + winds_n[:, 2], self.climb_dot + winds_dot_n[:, 2])
        return eqx.tree_at(lambda s: (s.climb, s.climb_dot), self, climbs)

    @property
    def level(self) -> Array:
        """Horizontal airspeed, m/s, with the climb through the air."""
        return jnp.sqrt(jnp.maximum(self.speed**2 - self.climb**2, _SQUARE_MIN))

    @property
    def level_dot(self) -> Array:
        """Its rate, m/s^2."""
        return (self.speed * self.speed_dot - self.climb * self.climb_dot) / self.level

    @property
    def level_velocity(self) -> Array:
        """Horizontal air velocity, (2, instant), m/s."""
        return jnp.stack([self.level * jnp.cos(self.heading), self.level * jnp.sin(self.heading)])


def first_coefficients(value: ScalarLike, slope: ScalarLike, cell: ScalarLike) -> tuple[Scalar, Scalar]:
    """The first two coefficients of a spline that begins with a value and a slope."""
    return jnp.asarray(value - 0.5 * cell * slope), jnp.asarray(value + 0.5 * cell * slope)


def _bases(u: Float[np.ndarray, " u"]) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes of the three splines that reach an interval, at places of it from 0 to 1: (3, u)."""
    v = 1.0 - u
    return np.stack([0.5 * v * v, 0.5 + u * v, 0.5 * u * u]), np.stack([-v, 1.0 - 2.0 * u, u])


def steered(steering: Steering, places: Float[np.ndarray, " u"]) -> Steered:
    """What comes of steering at the same places, from 0 to 1, of each of its intervals."""
    values, slopes = _bases(places)

    def one(coefficients: Float[Array, "34"]) -> tuple[Array, Array]:
        windows = jnp.stack([coefficients[k : k + CELLS] for k in range(3)], axis=1)
        return (windows @ values).reshape(-1), (windows @ slopes).reshape(-1) / steering.cell

    splines = (one(c) for c in (steering.headings, steering.climbs, steering.speeds))
    return Steered(*(part for spline in splines for part in spline))


class Flown(eqx.Module):
    """Where steering leads: at the ends of equal intervals, in a wind.

    Attributes
    ----------
    level_n
        North and east through the air, (instant, 2), m.
    altitudes
        (instant,), m.
    drifts_n
        Of the air, (instant, 3), m.
    at_ends
        What comes of steering there, the climb over the ground.
    winds_n, winds_dot_n
        There, (instant, 3), m/s and m/s^2.
    """

    level_n: Float[Array, "instants 2"]
    altitudes: Float[Array, " instants"]
    drifts_n: Float[Array, "instants 3"]
    at_ends: Steered
    winds_n: Float[Array, "instants 3"]
    winds_dot_n: Float[Array, "instants 3"]


def _summed(rates: Float[Array, "nodes n"], step: Scalar, first: Array) -> Array:
    weights = jnp.asarray(_RULE.weights)
    parts = step * jnp.sum(rates.reshape(-1, weights.size, rates.shape[1]) * weights[None, :, None], axis=1)
    return first[None, :] + jnp.concatenate([jnp.zeros((1, rates.shape[1])), jnp.cumsum(parts, axis=0)])


def wind_along(
    wind: AbstractWind, altitudes: Float[Array, " n"], climbs: Float[Array, " n"]
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Wind at altitudes (m), m/s, and how it changes for one who climbs (m/s) there, m/s^2."""

    def one(altitude: Scalar, climb: Scalar) -> tuple[Array, Array]:
        def at(h: Scalar) -> Array:
            return wind.at(jnp.stack([jnp.zeros(()), jnp.zeros(()), -h]), 0.0)

        return jax.jvp(at, (altitude,), (climb,))

    return jax.vmap(one)(altitudes, climbs)


def fly(steering: Steering, wind: AbstractWind, ticks: int) -> Flown:
    """Follow a steering through a wind; `ticks` equal intervals, a multiple of `CELLS`."""
    each, step = ticks // CELLS, steering.duration / ticks
    nodes = np.asarray(_RULE.nodes)
    within = steered(steering, ((np.arange(each)[:, None] + nodes[None, :]) / each).ravel())
    altitudes = _summed(within.climb[:, None], step, steering.altitude_0[None])[:, 0]
    last = jax.tree.map(lambda leaf: leaf[-1:], steered(steering, np.ones(1)))
    at = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), steered(steering, np.arange(each) / each), last)
    # Between the ends of an interval, the climb is quadratic in time and the altitude a cubic through what is known.
    u = jnp.tile(jnp.asarray(nodes), ticks)
    begin, end = (jnp.repeat(part, nodes.size) for part in (altitudes[:-1], altitudes[1:]))
    up, up_end = (step * jnp.repeat(part, nodes.size) for part in (at.climb[:-1], at.climb[1:]))
    rise = end - begin
    between = begin + u * (up + u * (3.0 * rise - 2.0 * up - up_end + u * (up + up_end - 2.0 * rise)))
    winds, winds_dot = wind_along(wind, between, within.climb)
    level = _summed(within.through(winds, winds_dot).level_velocity.T, step, steering.start)
    return Flown(level, altitudes, _summed(winds, step, jnp.zeros(3)), at, *wind_along(wind, altitudes, at.climb))


def steered_path(
    start_time: ScalarLike, steering: Steering, wind: AbstractWind, ticks: int, knots: int
) -> tuple[TimedPath, Flown]:
    """The path as it is delivered, with empty intervals at its end up to a number of knots."""
    flown = fly(steering, wind, ticks)
    at = flown.at_ends.through(flown.winds_n, flown.winds_dot_n)
    cosine, sine = jnp.cos(at.heading), jnp.sin(at.heading)
    across = at.level * at.heading_dot
    velocity = jnp.stack([at.level * cosine, at.level * sine, -at.climb], axis=1)
    bend = [at.level_dot * cosine - across * sine, at.level_dot * sine + across * cosine, -at.climb_dot]
    down = -flown.altitudes - flown.drifts_n[:, 2]
    place = jnp.concatenate([flown.level_n, down[:, None]], axis=1)
    air = jnp.stack([place, velocity, jnp.stack(bend, axis=1)], axis=1)
    drift = jnp.stack([flown.drifts_n, flown.winds_n, flown.winds_dot_n], axis=1)
    times = start_time + steering.duration * jnp.linspace(0.0, 1.0, ticks + 1)
    filled = jnp.minimum(jnp.arange(knots), ticks)
    return TimedPath(times[filled], air[filled], drift[filled]), flown
