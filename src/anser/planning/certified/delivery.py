"""From route and tabulated profile to the path that is delivered."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.planning.certified.profile import TabulatedProfile, flown_between
from anser.planning.certified.route import Route
from anser.planning.certified.smooth_turn import cis
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike, Vector3

_CLOSE_S = 0.02  # knots closer than this become one: differences of positions keep their digits in the accelerations


def _knots(marks: Float[Array, " marks"], duration: Scalar, intervals: int) -> Float[Array, " knots"]:
    """Equal intervals and the given times (s), in order, none closer than `_CLOSE_S` unless equal."""
    even = duration * jnp.linspace(0.0, 1.0, intervals + 1)
    times = jnp.sort(jnp.concatenate([even, jnp.clip(marks, 0.0, duration)]))
    times = jnp.where(duration - times < _CLOSE_S, duration, times)

    def merge(last: Scalar, time: Scalar) -> tuple[Scalar, Scalar]:
        now = jnp.where(time - last < _CLOSE_S, last, time)
        return now, now

    return jax.lax.scan(merge, jnp.zeros(()), times)[1]


def deliver(start_time: ScalarLike, table: TabulatedProfile, horizontal: Route) -> TimedPath:
    """Path from a time (s) on, with knots at equal intervals and wherever curvature, climb or speed has a kink.

    The table's length is the route's to a part in a million, which the airspeed takes up.
    """
    duration = table.profile.duration
    marks = jax.vmap(table.time_at)(horizontal.marks[1:-1] * (table.length / jnp.maximum(horizontal.length, 1.0)))
    times = _knots(jnp.concatenate([marks, table.profile.kinks]), duration, table.lengths.shape[0] - 1)
    # From knot to knot, where nothing kinks: the table's lengths are a little off where a kink lies within an interval,
    # and in a cell of some hundredths of a second a tenth of a millimetre is an acceleration of 1 m/s^2.
    flown, drifted = jax.vmap(lambda begin, span: flown_between(table.profile, table.wind, begin, span))(
        times[:-1], times[1:] - times[:-1]
    )
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(flown)])
    drifts = jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(drifted, axis=0)])
    # It ends where it was to end: the table's drift has led there.
    astray = (table.drift_n - drifts[-1]) / duration
    scale = horizontal.length / jnp.maximum(lengths[-1], 1.0)

    def one(t: Scalar, length: Scalar, drift: Vector3) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
        (speed, wind), (speed_dot, wind_dot) = jax.jvp(table.rates, (t,), (jnp.ones_like(t),))
        place, heading, curvature = horizontal.at(scale * length)
        drift, wind = drift + t * astray, wind + astray
        now = table.profile.at(t)
        ahead = cis(heading)
        rate, bend = scale * speed * ahead, (scale * speed_dot + 1j * curvature * (scale * speed) ** 2) * ahead
        level = [jnp.stack([jnp.real(x), jnp.imag(x)]) for x in (place, rate, bend)]
        down = (-now.altitude - drift[2], -now.climb - wind[2], -now.climb_dot - wind_dot[2])
        air = jnp.stack([jnp.append(x, z) for x, z in zip(level, down, strict=True)])
        return air, jnp.stack([drift, wind, wind_dot])

    air_n, drift_n = jax.vmap(one)(times, lengths, drifts)
    return TimedPath(start_time + times, air_n, drift_n)
