"""Where a candidate is at the instants of a fleet's clock, and whether it keeps its aircraft's limits there."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.planning.certified.clearance import Track, chord_error_bound
from anser.planning.certified.profile import TabulatedProfile
from anser.planning.certified.route import PathEnds, Route, TurnsAndLegs, route, tightness
from anser.planning.certified.smooth_turn import cis
from anser.planning.demand import coordinated, greatest_normal
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

_KEPT = 0.995  # of the limits: the rest is for what lies between the instants


class ProfileSamples(eqx.Module):
    """A profile at equally spaced instants, for all candidates that share it. After its end it goes on.

    Attributes
    ----------
    since_end
        Time since the end, s; 0 before it.
    length
        Horizontal length flown, m.
    drift_n, wind_n, wind_dot_n
        How far the air has moved, NED, m; how fast, and how that changes for the aircraft, m/s and m/s^2.
    altitude, climb, climb_dot
        Over the ground, m, m/s, m/s^2.
    speed, speed_dot
        Horizontal airspeed and its rate, m/s and m/s^2.
    """

    since_end: Float[Array, " instants"]
    length: Float[Array, " instants"]
    drift_n: Float[Array, "instants 3"]
    wind_n: Float[Array, "instants 3"]
    wind_dot_n: Float[Array, "instants 3"]
    altitude: Float[Array, " instants"]
    climb: Float[Array, " instants"]
    climb_dot: Float[Array, " instants"]
    speed: Float[Array, " instants"]
    speed_dot: Float[Array, " instants"]


def sample_profile(table: TabulatedProfile, times: Float[Array, " instants"]) -> ProfileSamples:
    """A tabulated profile at times (s after its start)."""

    def one(t: Scalar) -> ProfileSamples:
        inside = jnp.clip(t, 0.0, table.profile.duration)
        (speed, wind), (speed_dot, wind_dot) = jax.jvp(table.rates, (inside,), (jnp.ones_like(inside),))
        now = table.profile.at(inside)
        length, drift = table.flown_at(inside)
        return ProfileSamples(
            t - inside, length, drift, wind, wind_dot, now.altitude, now.climb, now.climb_dot, speed, speed_dot
        )

    return jax.vmap(one)(times)


class _Instant(eqx.Module):
    """A candidate at one instant."""

    position_n: Vector3
    acceleration: Scalar
    """Size of the acceleration over the ground, m/s^2."""
    within_limits: Flag
    """Whether bank angle, load factor, and acceleration and deceleration along the path are within limits."""


def _instant(
    here: ProfileSamples, horizontal: Route, scale: Scalar, limits: PathLimits, gravity: ScalarLike
) -> _Instant:
    """One instant of a profile along a route that is `scale` times as long as the profile's path."""
    place, heading, curvature = horizontal.at(scale * here.length)
    ahead = cis(heading)
    level = place + here.since_end * here.speed * ahead
    down = -here.altitude - here.since_end * here.climb
    shift = here.drift_n[:2] + here.since_end * here.wind_n[:2]
    # Forces make the acceleration over the ground: where the wind changes with altitude, it has a share.
    cosine, sine = jnp.real(ahead), jnp.imag(ahead)
    gust_ahead = cosine * here.wind_dot_n[0] + sine * here.wind_dot_n[1]
    gust_side = cosine * here.wind_dot_n[1] - sine * here.wind_dot_n[0]
    side = curvature * here.speed**2 + gust_side
    forward = here.speed_dot + gust_ahead
    up_rate = here.climb + here.wind_n[2]  # through the air
    asked = coordinated(here.speed, up_rate, side, forward, gravity + here.climb_dot)
    accelerations = limits.along(asked.speed, asked.normal / gravity)
    most = jnp.tan(limits.bank_max), greatest_normal(limits, gravity), *accelerations
    banked, loaded, along = asked.excess(*(_KEPT * limit for limit in most))
    kept = (banked <= 0.0) & (loaded <= 0.0) & (along <= 0.0)
    position = jnp.stack([jnp.real(level) + shift[0], jnp.imag(level) + shift[1], down])
    return _Instant(position, jnp.sqrt(side**2 + forward**2 + here.climb_dot**2), kept | (here.since_end > 0.0))


def route_track(
    ends: PathEnds,
    turns_and_legs: TurnsAndLegs,
    speed: ScalarLike,
    table: TabulatedProfile,
    samples: ProfileSamples,
    times: Float[Array, " instants"],
    limits: PathLimits,
    gravity: ScalarLike,
    active: ScalarLike = 1.0,
) -> tuple[Track, Flag]:
    """Where a candidate with a route is at the times of its samples (s), and whether its limits are kept there.

    Limits of altitude, airspeed and climb are its profile's, and not looked at again.

    Parameters
    ----------
    ends, turns_and_legs
        Its route.
    speed
        Mean airspeed, m/s.
    table, samples, times
        Its profile, and that at the instants of a fleet's clock, s.
    limits, gravity, active
        What it is held to; m/s^2; 0 for one that does not count.
    """
    horizontal = route(ends, turns_and_legs)
    scale = horizontal.length / jnp.maximum(table.length, 1.0)
    step = times[1] - times[0]
    seen = jax.vmap(lambda here: _instant(here, horizontal, scale, limits, gravity))(samples)
    # Between the instants a ramp may have raised it.
    tightest = jnp.min(turns_and_legs.scales)
    rising = 0.25 * step * tightness(ends, tightest)[1] * speed**3
    most = ends.curvature_max * table.profile.speed_most**2 + 2.0
    bound = jnp.minimum(jnp.maximum(seen.acceleration[1:], seen.acceleration[:-1]) + rising, most / tightest)
    counted = active * jnp.where(times[:-1] < table.profile.duration - 1e-6, 1.0, 0.0)
    return Track(seen.position_n, chord_error_bound(bound, step), counted), jnp.all(seen.within_limits)


def path_track(
    path: TimedPath,
    accelerations: Float[Array, " cells"],
    active: ScalarLike,
    times: Float[Array, " instants"],
    since: ScalarLike = -jnp.inf,
) -> Track:
    """A delivered path at even instants (s), with a rigorous bound of its acceleration in each interval.

    Of the path there are bounds of the acceleration in each of its cells, m/s^2; `active` is 0 for one that does not
    count, and what is before `since`, s, or before the path begins, does not either.
    """
    step = times[1] - times[0]
    positions = jax.vmap(path.position_n)(times)
    count = times.shape[0] - 1
    first = jnp.floor((path.times[:-1] - times[0]) / step - 1e-9).astype(jnp.int32)
    last = jnp.floor((path.times[1:] - times[0]) / step + 1e-9).astype(jnp.int32)
    # An interval lies within one cell, which its middle tells, or each cell that it touches begins or ends in it.
    middles = 0.5 * (times[1:] + times[:-1])
    within = jnp.searchsorted(path.times, middles, side="right", method="compare_all") - 1
    bounds = accelerations[jnp.clip(within, 0, accelerations.shape[0] - 1)]
    for where in (first, last):
        bounds = bounds.at[jnp.clip(where, 0, count - 1)].max(accelerations)
    flown = (times[:-1] < path.times[-1] - 1e-6) & (times[1:] > jnp.maximum(since, path.times[0]))
    counted = active * jnp.where(flown, 1.0, 0.0)
    return Track(positions, chord_error_bound(bounds, step), counted)
