"""Clearance: bounds of the distances between aircraft and from keep-outs, valid between the sample times, too.

Over a short interval a path stays within acceleration x interval^2 / 8 of the chord between its ends, and two straight
motions have their least distance in closed form. In a large fleet, the cylinders that enclose parts of the paths give a
first lower bound (the broad phase); the bound by chords is computed for the nearest pairs only.

A clearance ratio is the ratio of distance to required separation: at least 1 means separated.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import count_not_above
from anser.planning.certified.path_bounds import path_bounds
from anser.planning.certified.profile import TabulatedProfile
from anser.planning.certified.routes import PathEndpoints, Route, TurnsAndLegs, cis, route, turn_limits
from anser.planning.certified.task import Airspace, KeepOuts
from anser.planning.demand import coordinated_demand, normal_force_max
from anser.planning.limits import PathLimits, reduced_limit
from anser.planning.separation import Separation, closest_fraction, separation_ratio
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3

_TINY = 1e-9  # m^2
_ROUNDING_S = 1e-6  # tolerance of comparisons of times


class Track(eqx.Module):
    """Positions of a path at equally spaced times, with an error bound for the motion in the intervals between them."""

    positions_n: Float[Array, "*batch instants 3"]  # over the ground, (time, axis), NED, m
    # greatest distance of the path from its chord, m: proven from `path_track`, an estimate from `route_track`
    error_bound: Float[Array, "*batch intervals"]
    included: Float[Array, "*batch intervals"]  # 1 in the intervals whose distances count (up to the arrival), else 0


def _vector_length_min(begin: Float[Array, "*b 2"], end: Float[Array, "*b 2"]) -> Float[Array, "*b"]:
    """Return the least length, m, of a vector that changes linearly from `begin` to `end` (m)."""
    step = end - begin
    closest = begin + closest_fraction(begin, step, _TINY)[..., None] * step
    return jnp.sqrt(jnp.maximum(jnp.sum(closest * closest, axis=-1), _TINY))


def _magnitude_min(begin: Float[Array, "*b"], end: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Return the least magnitude of a number that changes linearly from `begin` to `end`."""
    return jnp.where(begin * end <= 0.0, 0.0, jnp.minimum(jnp.abs(begin), jnp.abs(end)))


def pair_clearance_ratio(subject: Track, neighbour: Track, separation: Separation) -> Float[Array, "*batch"]:
    """Return a lower bound of the ratio of distance to required separation between two paths over all their times.

    The bound is proven if both tracks are from `path_track`; with a track from `route_track`, the bound is an estimate.
    The result is infinite if no separation is required or no interval is common. Batches of equal rank broadcast.
    """
    offset = neighbour.positions_n - subject.positions_n
    error_bound = subject.error_bound + neighbour.error_bound
    horizontal = _vector_length_min(offset[..., :-1, :2], offset[..., 1:, :2]) - error_bound
    height = _magnitude_min(offset[..., :-1, 2], offset[..., 1:, 2]) - error_bound
    ratio = separation_ratio(horizontal, height, separation.horizontal, separation.vertical)
    return jnp.min(jnp.where(subject.included * neighbour.included > 0.0, ratio, jnp.inf), axis=-1)


def clearance_from_keep_outs(
    track: Track, times: Float[Array, " instants"], volumes: KeepOuts
) -> Float[Array, " volumes"]:
    """Return a lower bound of a path's distance from each keep-out over time, m; negative inside.

    `times` are the sample times of the track, s; at time 0 the keep-outs are at `volumes.position_n`.
    """

    def volume_clearance(volume: KeepOuts) -> Scalar:
        offset = track.positions_n[:, :2] - volume.position_n[None, :] - times[:, None] * volume.velocity_n[None, :]
        radial_distance = _vector_length_min(offset[:-1], offset[1:]) - track.error_bound - volume.radius
        up = -track.positions_n[:, 2]
        low, high = jnp.minimum(up[:-1], up[1:]) - track.error_bound, jnp.maximum(up[:-1], up[1:]) + track.error_bound
        clearance = jnp.maximum(jnp.maximum(radial_distance, volume.bottom - high), low - volume.top)
        return jnp.min(jnp.where(track.included > 0.0, clearance, jnp.inf))

    return jax.vmap(volume_clearance)(volumes)


_CONTINUATION_INTERVALS = 4  # intervals that `continue_straight` appends; a multiple of `INTERVALS_PER_CYLINDER`


def continue_straight(
    tracks: Track,  # tracks from time 0 to the last of the arrivals, (aircraft, candidate, ...)
    arrivals: Float[Array, " aircraft"],  # times of arrival, s, up to which the tracks are included
    seconds: ScalarLike,  # duration after the arrival, s, for which each continued track is included
    continuing: Bool[Array, " aircraft"],  # mask of the aircraft whose tracks are continued
) -> Track:
    """Continue tracks beyond the arrivals in a straight line, as an estimate of the motion until the hold."""
    last_s, intervals = jnp.max(arrivals), tracks.error_bound.shape[-1]
    step = last_s / intervals
    ends_n = tracks.positions_n[..., -1:, :]
    velocities_n = (ends_n - tracks.positions_n[..., -2:-1, :]) / step
    later = seconds / _CONTINUATION_INTERVALS * jnp.arange(_CONTINUATION_INTERVALS + 1)
    begins = jnp.concatenate([step * jnp.arange(intervals), last_s + later[:-1]])
    since_arrival = begins[None, :] - arrivals[:, None] + _ROUNDING_S
    after_arrival = continuing[:, None] & (since_arrival >= 0.0) & (since_arrival < seconds)
    appended = jnp.zeros((*tracks.error_bound.shape[:-1], _CONTINUATION_INTERVALS))
    return Track(
        jnp.concatenate([tracks.positions_n, ends_n + later[None, None, 1:, None] * velocities_n], axis=-2),
        jnp.concatenate([tracks.error_bound, appended], axis=-1),
        jnp.where(after_arrival[:, None, :], 1.0, jnp.concatenate([tracks.included, appended], axis=-1)),
    )


def chord_error_bound(acceleration: Float[Array, "*batch intervals"], step: Scalar) -> Float[Array, "*batch intervals"]:
    """Return the greatest distance of a path from its chord, m, in intervals of duration `step` (s).

    `acceleration` is the greatest acceleration in each interval, m/s^2.
    """
    return acceleration * step**2 / 8


INTERVALS_PER_CYLINDER = 4
"""Number of intervals of a track that one bounding cylinder encloses; divides every number of intervals in use."""
CHORD_BOUNDED_PAIRS = 24
"""Number of neighbours for which the closer bound by chords is computed at once."""
_CYLINDER_TINY = (
    1e-9  # m^2: keeps the derivatives of roots finite; added to radii as well, so that the bound stays a lower bound
)


class BoundingCylinders(eqx.Module):
    """Upright cylinders that enclose a path and its error bounds, one per group of consecutive intervals."""

    centre: Float[Array, "*batch cylinders 2"]  # north and east, m
    radius: Float[Array, "*batch cylinders"]  # m
    low: Float[Array, "*batch cylinders"]  # least down coordinate, m
    high: Float[Array, "*batch cylinders"]  # greatest down coordinate, m
    included: Float[Array, "*batch cylinders"]  # 1 if an interval of the group is included (see `Track`), else 0


def bounding_cylinders(track: Track, size: int = INTERVALS_PER_CYLINDER) -> BoundingCylinders:
    """Return cylinders that enclose a track, one per `size` intervals.

    Raises ValueError if the number of intervals is not a multiple of `size`.
    """
    batch, count = track.error_bound.shape[:-1], track.error_bound.shape[-1]
    if count % size:
        raise ValueError(f"track: arrived {count} intervals; expected a multiple of {size}")
    positions = track.positions_n
    grouped_shape = (*batch, count // size, size)
    endpoints = jnp.concatenate(
        [positions[..., :-1, :].reshape(*grouped_shape, 3), positions[..., 1:, :].reshape(*grouped_shape, 3)], axis=-2
    )
    error_bound = jnp.max(track.error_bound.reshape(grouped_shape), axis=-1)
    lower_corner, upper_corner = jnp.min(endpoints, axis=-2), jnp.max(endpoints, axis=-2)
    centre = 0.5 * (lower_corner + upper_corner)[..., :2]
    offset = endpoints[..., :2] - centre[..., None, :]
    radius = jnp.sqrt(jnp.maximum(jnp.max(jnp.sum(offset * offset, axis=-1), axis=-1), _CYLINDER_TINY)) + error_bound
    included = jnp.max(track.included.reshape(grouped_shape), axis=-1)
    return BoundingCylinders(
        centre, radius, lower_corner[..., 2] - error_bound, upper_corner[..., 2] + error_bound, included
    )


def fleet_cylinders(tracks: Track, fleet: int, size: int = INTERVALS_PER_CYLINDER) -> BoundingCylinders:
    """Return the cylinders of `tracks`, one per `size` intervals, for `fleet_clearance_ratio`.

    For a `fleet` of at most `CHORD_BOUNDED_PAIRS` aircraft the result is empty, because chords bound every pair.
    """
    if fleet > CHORD_BOUNDED_PAIRS:
        return bounding_cylinders(tracks, size)
    empty = jnp.zeros((*tracks.error_bound.shape[:-1], 0))
    return BoundingCylinders(jnp.zeros((*empty.shape, 2)), empty, empty, empty, empty)


def cylinder_clearance_ratio(
    subject: BoundingCylinders, neighbour: BoundingCylinders, separation: Separation
) -> Float[Array, "*batch"]:
    """Return a lower bound, at least 0, of the clearance ratio of two paths, from their bounding cylinders.

    The bound is infinite if no separation is required.
    """
    offset = neighbour.centre - subject.centre
    radius = subject.radius + neighbour.radius
    horizontal = jnp.sqrt(jnp.maximum(jnp.sum(offset * offset, axis=-1), _CYLINDER_TINY)) - radius
    height = jnp.maximum(neighbour.low - subject.high, subject.low - neighbour.high)
    # The distance of overlapping cylinders has no positive lower bound.
    ratio = jnp.maximum(separation_ratio(horizontal, height, separation.horizontal, separation.vertical), 0.0)
    return jnp.min(jnp.where(subject.included * neighbour.included > 0.0, ratio, jnp.inf), axis=-1)


def fleet_clearance_ratio(
    # track of the one path, and its cylinders
    track: Track,
    cylinders: BoundingCylinders,
    fleet: BoundingCylinders,  # bounding cylinders of the fleet's paths, stacked
    # function that returns the stacked tracks for aircraft indices
    tracks_of: Callable[[Int[Array, " selected"]], Track],
    neighbours: Bool[Array, " aircraft"],  # mask of the aircraft to compare with; the ratio is infinite elsewhere
    separation: Separation,
) -> Float[Array, " aircraft"]:
    """Return lower bounds of the clearance ratio between one path and each path of a fleet.

    The close bound of `pair_clearance_ratio` is computed for the aircraft with the nearest cylinders, at least
    `CHORD_BOUNDED_PAIRS`, and for every aircraft with cylinders nearer than the separation. The bounds of the remaining
    aircraft follow from the cylinders alone.
    """
    count = neighbours.shape[0]

    def chord_bounds(indices: Int[Array, " selected"]) -> Float[Array, " selected"]:
        return pair_clearance_ratio(jax.tree.map(lambda leaf: leaf[None], track), tracks_of(indices), separation)

    if count <= CHORD_BOUNDED_PAIRS:
        return jnp.where(neighbours, chord_bounds(jnp.arange(count)), jnp.inf)
    bound = cylinder_clearance_ratio(jax.tree.map(lambda leaf: leaf[None], cylinders), fleet, separation)
    bound = jnp.where(neighbours, bound, jnp.inf)
    order = jnp.argsort(bound)
    groups = -(-count // CHORD_BOUNDED_PAIRS)
    padded = jnp.concatenate([order, jnp.repeat(order[-1:], groups * CHORD_BOUNDED_PAIRS - count)])

    def bound_group(carry: tuple[Integer, Array]) -> tuple[Integer, Array]:
        group, ratios = carry
        nearest = jax.lax.dynamic_slice_in_dim(padded, group * CHORD_BOUNDED_PAIRS, CHORD_BOUNDED_PAIRS)
        tight = jnp.where(neighbours[nearest], jnp.maximum(chord_bounds(nearest), bound[nearest]), jnp.inf)
        return group + 1, ratios.at[nearest].set(tight)

    def may_be_too_near(carry: tuple[Integer, Array]) -> Flag:
        group, _ = carry
        next_bound = bound[padded[jnp.minimum(group * CHORD_BOUNDED_PAIRS, count - 1)]]
        return (group == 0) | ((group < groups) & (next_bound < 1.0))

    return jax.lax.while_loop(may_be_too_near, bound_group, (jnp.asarray(0), bound))[1]


def fleet_clearance_ratios(
    tracks: Track, separation: Separation, size: int = INTERVALS_PER_CYLINDER
) -> Float[Array, "aircraft aircraft"]:
    """Return a lower bound of the clearance ratio of each pair of a fleet's paths; infinite on the diagonal.

    `size` is the number of intervals per bounding cylinder.
    """
    fleet = tracks.error_bound.shape[0]
    cylinders, aircraft_indices = fleet_cylinders(tracks, fleet, size), jnp.arange(fleet)

    def tracks_of(indices: Int[Array, " selected"]) -> Track:
        return jax.tree.map(lambda leaf: leaf[indices], tracks)

    def ratios_of(aircraft: Integer) -> Float[Array, " aircraft"]:
        track, track_cylinders = jax.tree.map(lambda leaf: leaf[aircraft], (tracks, cylinders))
        neighbours = aircraft_indices != aircraft
        return fleet_clearance_ratio(track, track_cylinders, cylinders, tracks_of, neighbours, separation)

    return jax.lax.map(ratios_of, aircraft_indices)


_LIMIT_FRACTION = 0.995  # of the limits: a margin for the motion between the sample times


class ProfileSamples(eqx.Module):
    """Samples of one profile at equally spaced times; after the end of the profile, the values at the end."""

    since_end: Float[Array, " instants"]  # time since the end of the profile, s
    length: Float[Array, " instants"]  # horizontal length flown through the air, m
    drift_n: Float[Array, "instants 3"]  # displacement of the air, NED, m
    # wind and its rate, NED, m/s, m/s^2
    wind_n: Float[Array, "instants 3"]
    wind_dot_n: Float[Array, "instants 3"]
    # altitude, vertical speed over the ground, up positive, and its rate, m, m/s, m/s^2
    altitude: Float[Array, " instants"]
    climb: Float[Array, " instants"]
    climb_dot: Float[Array, " instants"]
    # horizontal airspeed and its rate, m/s, m/s^2
    speed: Float[Array, " instants"]
    speed_dot: Float[Array, " instants"]


def sample_profile(table: TabulatedProfile, times: Float[Array, " instants"]) -> ProfileSamples:
    """Evaluate a profile at `times`, s after its start."""

    def sample(t: Scalar) -> ProfileSamples:
        inside = jnp.clip(t, 0.0, table.profile.duration)
        (speed, wind), (speed_dot, wind_dot) = jax.jvp(table.rates, (inside,), (jnp.ones_like(inside),))
        state = table.profile.at(inside)
        length, drift = table.flown_at(inside)
        return ProfileSamples(
            t - inside, length, drift, wind, wind_dot, state.altitude, state.climb, state.climb_dot, speed, speed_dot
        )

    return jax.vmap(sample)(times)


class _CandidatePoint(eqx.Module):
    """Motion of a candidate at one time."""

    position_n: Vector3  # NED, m
    acceleration: Scalar  # magnitude of the acceleration over the ground, m/s^2
    # whether bank angle, load factor and acceleration along the path keep their limits; true after the end of the path
    within_limits: Flag


def _candidate_point(
    sample: ProfileSamples, horizontal: Route, scale: Scalar, limits: PathLimits, gravity: ScalarLike
) -> _CandidatePoint:
    """Evaluate a candidate at one sample; `scale` is the length of the route over the length in the profile."""
    route_position, heading, curvature = horizontal.at(scale * sample.length)
    direction = cis(heading)
    horizontal_position = route_position + sample.since_end * sample.speed * direction
    down = -sample.altitude - sample.since_end * sample.climb
    air_drift = sample.drift_n[:2] + sample.since_end * sample.wind_n[:2]
    # The force follows from the acceleration over the ground, which includes the change of the wind with altitude.
    cosine, sine = jnp.real(direction), jnp.imag(direction)
    gust_ahead = cosine * sample.wind_dot_n[0] + sine * sample.wind_dot_n[1]
    gust_side = cosine * sample.wind_dot_n[1] - sine * sample.wind_dot_n[0]
    side = curvature * sample.speed**2 + gust_side
    forward = sample.speed_dot + gust_ahead
    up_rate = sample.climb + sample.wind_n[2]  # through the air
    required = coordinated_demand(sample.speed, up_rate, side, forward, gravity + sample.climb_dot)
    accelerations = limits.along(required.speed, required.normal / gravity)
    greatest = jnp.tan(limits.bank_max), normal_force_max(limits, gravity), *accelerations
    bank, normal, faster, slower = (reduced_limit(limit, _LIMIT_FRACTION) for limit in greatest)
    lift_min = (1.0 - _LIMIT_FRACTION * (1.0 - limits.load_factor_min)) * gravity
    bank_excess, load_excess, along_excess = required.excess(bank, normal, lift_min, faster, slower)
    within = (bank_excess <= 0.0) & (load_excess <= 0.0) & (along_excess <= 0.0)
    position = jnp.stack(
        [jnp.real(horizontal_position) + air_drift[0], jnp.imag(horizontal_position) + air_drift[1], down]
    )
    return _CandidatePoint(
        position, jnp.sqrt(side**2 + forward**2 + sample.climb_dot**2), within | (sample.since_end > 0.0)
    )


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
    """Return the track of a candidate at `times` (s), and whether the candidate keeps its limits at these times.

    The candidate is a route (`endpoints`, `turns_and_legs`) with a profile (`table`, sampled in `samples`). The limits
    are bank angle, load factor and acceleration along the path, up to the end of the path. `speed` is the mean
    airspeed, m/s. If `active` is 0, no interval of the track is included.
    """
    horizontal = route(endpoints, turns_and_legs)
    scale = horizontal.length / jnp.maximum(table.length, 1.0)
    step = times[1] - times[0]
    motions = jax.vmap(lambda sample: _candidate_point(sample, horizontal, scale, limits, gravity))(samples)
    # A curvature ramp may raise the acceleration between the sample times.
    tightest = jnp.min(turns_and_legs.scales)
    ramp_allowance = 0.25 * step * turn_limits(endpoints, tightest)[1] * speed**3
    acceleration_max = endpoints.curvature_max * table.profile.speed_max**2 + 2.0
    bound = jnp.minimum(
        jnp.maximum(motions.acceleration[1:], motions.acceleration[:-1]) + ramp_allowance, acceleration_max / tightest
    )
    included = active * jnp.where(times[:-1] < table.profile.duration - _ROUNDING_S, 1.0, 0.0)
    return Track(motions.position_n, chord_error_bound(bound, step), included), jnp.all(motions.within_limits)


def path_track(
    path: TimedPath,
    accelerations: Float[Array, " cells"],
    active: ScalarLike,
    times: Float[Array, " instants"],
    from_time: ScalarLike = -jnp.inf,
) -> Track:
    """Return the track of a timed path at equally spaced times (s), with a proven error bound in each interval.

    `accelerations` are bounds of the acceleration in each cell of the path, m/s^2. The track is included from
    `from_time` (s) or the path's start, whichever is later, to the arrival; nowhere if `active` is 0.
    """
    step = times[1] - times[0]
    positions = jax.vmap(path.position_n)(times)
    count = times.shape[0] - 1
    first_cells = jnp.floor((path.times[:-1] - times[0]) / step - 1e-9).astype(jnp.int32)
    last_cells = jnp.floor((path.times[1:] - times[0]) / step + 1e-9).astype(jnp.int32)
    # An interval lies within one cell, found by its midpoint, or each cell it touches begins or ends in it.
    middles = 0.5 * (times[1:] + times[:-1])
    within = jax.vmap(lambda middle: count_not_above(path.times, middle))(middles) - 1
    bounds = accelerations[jnp.clip(within, 0, accelerations.shape[0] - 1)]
    for touched in (first_cells, last_cells):
        bounds = bounds.at[jnp.clip(touched, 0, count - 1)].max(accelerations)
    flown = (times[:-1] < path.times[-1] - _ROUNDING_S) & (times[1:] > jnp.maximum(from_time, path.times[0]))
    included = active * jnp.where(flown, 1.0, 0.0)
    return Track(positions, chord_error_bound(bounds, step), included)


def bounded_track(path: TimedPath, airspace: Airspace, active: ScalarLike, times: Float[Array, " instants"]) -> Track:
    """Return the track of a timed path at equally spaced times (s), with error bounds from its `path_bounds`."""
    return path_track(path, path_bounds(path, airspace.wind, airspace.gravity).cell_acceleration, active, times)
