"""Clearance: distances between moving aircraft and from keep-outs, valid between the sample times.

The broad phase of large fleets; tracks of candidates and paths. Over a short interval a path stays within
acceleration x interval^2 / 8 of the chord between its ends. Two straight motions have their least distance in closed
form. In a large fleet bounding cylinders give a lower bound first, and the exact distance is computed for the
nearest pairs only.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.planning.certified.profile import TabulatedProfile
from anser.planning.certified.routes import PathEndpoints, Route, TurnsAndLegs, cis, route, tightness
from anser.planning.certified.task import KeepOuts
from anser.planning.demand import coordinated_demand, normal_force_max
from anser.planning.limits import PathLimits
from anser.planning.separation import Separation, closest_fraction, separation_ratio
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

_TINY = 1e-9  # m^2


class Track(eqx.Module):
    """A path at equal intervals of time.

    Attributes
    ----------
    positions_n
        Over the ground, (instant, axis), NED, m.
    error_bound
        Of the distance between the path and its chord in each interval, m.
    counted
        1 in intervals that begin before the arrival, else 0.
    """

    positions_n: Float[Array, "*batch instants 3"]
    error_bound: Float[Array, "*batch intervals"]
    included: Float[Array, "*batch intervals"]


def _vector_length_min(begin: Float[Array, "*b 2"], end: Float[Array, "*b 2"]) -> Float[Array, "*b"]:
    """Least length of a vector that changes evenly between two."""
    step = end - begin
    near = begin + closest_fraction(begin, step, _TINY)[..., None] * step
    return jnp.sqrt(jnp.maximum(jnp.sum(near * near, axis=-1), _TINY))


def _magnitude_min(begin: Float[Array, "*b"], end: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Least size of a number that changes evenly between two."""
    return jnp.where(begin * end <= 0.0, 0.0, jnp.minimum(jnp.abs(begin), jnp.abs(end)))


def pair_clearance_ratio(subject: Track, neighbour: Track, separation: Separation) -> Float[Array, "*batch"]:
    """Least ratio of distance to separation between two paths: 1 is just enough.

    In each interval the better of the two ratios of distance to separation, horizontal and vertical, counts; infinite
    where nothing is asked. Batches broadcast; the ranks must agree.
    """
    apart = neighbour.positions_n - subject.positions_n
    error_bound = subject.error_bound + neighbour.error_bound
    level = _vector_length_min(apart[..., :-1, :2], apart[..., 1:, :2]) - error_bound
    height = _magnitude_min(apart[..., :-1, 2], apart[..., 1:, 2]) - error_bound
    ratio = separation_ratio(level, height, separation.horizontal, separation.vertical)
    return jnp.min(jnp.where(subject.included * neighbour.included > 0.0, ratio, jnp.inf), axis=-1)


def clearance_from_keep_outs(
    track: Track, times: Float[Array, " instants"], volumes: KeepOuts
) -> Float[Array, " volumes"]:
    """By how much one path stays out of each volume at the least, m: negative inside."""

    def one(volume: KeepOuts) -> Scalar:
        apart = track.positions_n[:, :2] - volume.position_n[None, :] - times[:, None] * volume.velocity_n[None, :]
        beside = _vector_length_min(apart[:-1], apart[1:]) - track.error_bound - volume.radius
        up = -track.positions_n[:, 2]
        low, high = jnp.minimum(up[:-1], up[1:]) - track.error_bound, jnp.maximum(up[:-1], up[1:]) + track.error_bound
        clearance = jnp.maximum(jnp.maximum(beside, volume.bottom - high), low - volume.top)
        return jnp.min(jnp.where(track.included > 0.0, clearance, jnp.inf))

    return jax.vmap(one)(volumes)


def chord_error_bound(acceleration: Float[Array, "*batch intervals"], step: Scalar) -> Float[Array, "*batch intervals"]:
    """Distance from the chord, m, by a bound of the acceleration in each interval (m/s^2) and its length (s)."""
    return acceleration * step**2 / 8


INTERVALS_PER_CYLINDER = 4
"""Every number of intervals in use is a multiple of it."""
EXACT_PAIRS = 24
"""Pairs of an aircraft whose clearance is exact; those of a smaller fleet all are."""
_CYLINDER_TINY = 1e-9  # m^2: keeps the derivatives of the roots finite; each radius grows by as much as a distance may


class BoundingCylinders(eqx.Module):
    """Upright cylinders that hold a path, one for several intervals each.

    Attributes
    ----------
    centre
        Of the axis, north and east, m.
    radius
        m.
    low, high
        Least and greatest down coordinate, m.
    counted
        1 where any of the intervals counts, else 0.
    """

    centre: Float[Array, "*batch cylinders 2"]
    radius: Float[Array, "*batch cylinders"]
    low: Float[Array, "*batch cylinders"]
    high: Float[Array, "*batch cylinders"]
    included: Float[Array, "*batch cylinders"]


def bounding_cylinders(track: Track, size: int = INTERVALS_PER_CYLINDER) -> BoundingCylinders:
    """Cylinders of a track, or of a batch of them, of `size` intervals each."""
    batch, count = track.error_bound.shape[:-1], track.error_bound.shape[-1]
    if count % size:
        raise ValueError(f"track: arrived {count} intervals; expected a multiple of {size}")
    places = track.positions_n
    parts = (*batch, count // size, size)
    both = jnp.concatenate([places[..., :-1, :].reshape(*parts, 3), places[..., 1:, :].reshape(*parts, 3)], axis=-2)
    error_bound = jnp.max(track.error_bound.reshape(parts), axis=-1)
    least, most = jnp.min(both, axis=-2), jnp.max(both, axis=-2)
    centre = 0.5 * (least + most)[..., :2]
    off = both[..., :2] - centre[..., None, :]
    radius = jnp.sqrt(jnp.maximum(jnp.max(jnp.sum(off * off, axis=-1), axis=-1), _CYLINDER_TINY)) + error_bound
    counted = jnp.max(track.included.reshape(parts), axis=-1)
    return BoundingCylinders(centre, radius, least[..., 2] - error_bound, most[..., 2] + error_bound, counted)


def fleet_cylinders(tracks: Track, fleet: int, size: int = INTERVALS_PER_CYLINDER) -> BoundingCylinders:
    """Cylinders for `fleet_clearance_ratio` of a fleet of so many; a small one, all of it exact, needs none."""
    if fleet > EXACT_PAIRS:
        return bounding_cylinders(tracks, size)
    none = jnp.zeros((*tracks.error_bound.shape[:-1], 0))
    return BoundingCylinders(jnp.zeros((*none.shape, 2)), none, none, none, none)


def cylinder_clearance_ratio(
    one: BoundingCylinders, other: BoundingCylinders, separation: Separation
) -> Float[Array, "*batch"]:
    """A lower bound of `clearance.pair_clearance_ratio`; infinite where nothing is asked."""
    apart = other.centre - one.centre
    radius = one.radius + other.radius
    level = jnp.sqrt(jnp.maximum(jnp.sum(apart * apart, axis=-1), _CYLINDER_TINY)) - radius
    height = jnp.maximum(other.low - one.high, one.low - other.high)
    # Where cylinders overlap, the distance may be anything.
    ratio = jnp.maximum(separation_ratio(level, height, separation.horizontal, separation.vertical), 0.0)
    return jnp.min(jnp.where(one.included * other.included > 0.0, ratio, jnp.inf), axis=-1)


def fleet_clearance_ratio(
    one: Track,
    cylinders: BoundingCylinders,
    fleet: BoundingCylinders,
    tracks_of: Callable[[Int[Array, " some"]], Track],
    others: Bool[Array, " aircraft"],
    separation: Separation,
) -> Float[Array, " aircraft"]:
    """Clearance ratio between one path and each of a fleet, see `clearance.pair_clearance_ratio`, or a lower bound.

    Parameters
    ----------
    one, cylinders
        A path, and its cylinders.
    fleet
        Bounding cylinders of the fleet's paths, stacked.
    tracks_of
        Stacked paths of some of the fleet, by their indices.
    others
        Which of the fleet count; infinite for those that do not.
    separation
        What is asked.

    Returns
    -------
    Exact for the `EXACT_PAIRS` whose cylinders are nearest, for the others the bound of the cylinders.
    """
    count = others.shape[0]

    def exact(some: Int[Array, " some"]) -> Float[Array, " some"]:
        return pair_clearance_ratio(jax.tree.map(lambda leaf: leaf[None], one), tracks_of(some), separation)

    if count <= EXACT_PAIRS:
        return jnp.where(others, exact(jnp.arange(count)), jnp.inf)
    bound = cylinder_clearance_ratio(jax.tree.map(lambda leaf: leaf[None], cylinders), fleet, separation)
    bound = jnp.where(others, bound, jnp.inf)
    near = jax.lax.top_k(-bound, EXACT_PAIRS)[1]
    return bound.at[near].set(jnp.where(others[near], jnp.maximum(exact(near), bound[near]), jnp.inf))


_LIMIT_FRACTION = 0.995  # of the limits: the rest is for what lies between the instants


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
    asked = coordinated_demand(here.speed, up_rate, side, forward, gravity + here.climb_dot)
    accelerations = limits.along(asked.speed, asked.normal / gravity)
    most = jnp.tan(limits.bank_max), normal_force_max(limits, gravity), *accelerations
    banked, loaded, along = asked.excess(*(_LIMIT_FRACTION * limit for limit in most))
    kept = (banked <= 0.0) & (loaded <= 0.0) & (along <= 0.0)
    position = jnp.stack([jnp.real(level) + shift[0], jnp.imag(level) + shift[1], down])
    return _Instant(position, jnp.sqrt(side**2 + forward**2 + here.climb_dot**2), kept | (here.since_end > 0.0))


def route_track(
    endpoints: PathEndpoints,
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
    horizontal = route(endpoints, turns_and_legs)
    scale = horizontal.length / jnp.maximum(table.length, 1.0)
    step = times[1] - times[0]
    seen = jax.vmap(lambda here: _instant(here, horizontal, scale, limits, gravity))(samples)
    # Between the instants a ramp may have raised it.
    tightest = jnp.min(turns_and_legs.scales)
    rising = 0.25 * step * tightness(endpoints, tightest)[1] * speed**3
    most = endpoints.curvature_max * table.profile.speed_max**2 + 2.0
    bound = jnp.minimum(jnp.maximum(seen.acceleration[1:], seen.acceleration[:-1]) + rising, most / tightest)
    counted = active * jnp.where(times[:-1] < table.profile.duration - 1e-6, 1.0, 0.0)
    return Track(seen.position_n, chord_error_bound(bound, step), counted), jnp.all(seen.within_limits)


def path_track(
    path: TimedPath,
    accelerations: Float[Array, " cells"],
    active: ScalarLike,
    times: Float[Array, " instants"],
    from_time: ScalarLike = -jnp.inf,
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
    flown = (times[:-1] < path.times[-1] - 1e-6) & (times[1:] > jnp.maximum(from_time, path.times[0]))
    counted = active * jnp.where(flown, 1.0, 0.0)
    return Track(positions, chord_error_bound(bounds, step), counted)
