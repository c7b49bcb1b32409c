"""How close the aircraft of a plan come to each other and to closed volumes, from samples of their motion.

Between two samples a path is the cubic with the positions and velocities of both ends. At half a second that is within
a millimetre of paths of aircraft: the error is the fourth derivative times the interval to the fourth over 384.
"""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from anser.compiling import compiled, compiled_quickly
from anser.numerics import as_array, filled_up
from anser.planning import separation_ratio
from anser.results import ClosestApproach
from anser.scenario.schema_airspace import KeepOut
from anser.shapes import Scalar

_MOST_PAIRS = 64  # pairs that are looked at between the samples: the nearest ones at the samples
_PARTS = 16  # of an interval between two samples, each of which is halved so often that only rounding is left
_HALVINGS = 30


FLEET, _TIMES, _VOLUMES = 4, 512, 2  # sizes to whose multiples all are filled up: other numbers seldom compile


class SampledMotion(eqx.Module):
    """Positions (m) and velocities (m/s) over the ground, NED, (time, aircraft, axis); NaN after an arrival."""

    times: Float[Array, " time"]
    positions_n: Float[Array, "time aircraft 3"]
    velocities_n: Float[Array, "time aircraft 3"]


def track_of(times_s: np.ndarray, history: Mapping[str, np.ndarray]) -> SampledMotion:
    """Motion of a fleet from a history as `sample_paths` makes it; the wind is horizontal."""
    places = np.stack([history["north"], history["east"], -history["altitude"]], axis=-1)
    speeds = np.stack([history["velocity_north"], history["velocity_east"], -history["climb_rate"]], axis=-1)
    return SampledMotion(*map(as_array, (times_s, places, speeds)))


def _filled(motion: SampledMotion) -> SampledMotion:
    """With instants and aircraft of which nothing is known."""
    count, fleet = motion.positions_n.shape[:2]
    more, others = -count % _TIMES, -fleet % FLEET
    known = np.asarray(motion.times)
    times = np.concatenate([known, known[-1] + 1.0 + np.arange(more)])
    states = (
        np.pad(np.asarray(state), ((0, more), (0, others), (0, 0)), constant_values=np.nan)
        for state in (motion.positions_n, motion.velocities_n)
    )
    return SampledMotion(*map(as_array, (times, *states)))


def _between(
    times: Float[Array, " time"], places: Float[Array, "time 3"], speeds: Float[Array, "time 3"], instant: Scalar
) -> Float[Array, "3"]:
    """Place on the cubic about an instant, NaN where an end of it is."""
    k = jnp.clip(jnp.searchsorted(times, instant, side="right") - 1, 0, times.shape[0] - 2)
    step = times[k + 1] - times[k]
    u = (instant - times[k]) / step
    way = places[k + 1] - places[k]
    c2 = 3.0 * way - step * (2.0 * speeds[k] + speeds[k + 1])
    c3 = step * (speeds[k] + speeds[k + 1]) - 2.0 * way
    inside = places[k] + u * (step * speeds[k] + u * (c2 + u * c3))
    # At a sample the next one does not count: it may lie after the arrival.
    return jnp.where(u == 0.0, places[k], inside)


def _fine_times(times: Float[Array, " time"]) -> Float[Array, " fine"]:
    inner = times[:-1, None] + (times[1:] - times[:-1])[:, None] * (jnp.arange(_PARTS) / _PARTS)[None, :]
    return jnp.concatenate([inner.ravel(), times[-1:]])


def _distance(apart: Float[Array, "*batch 3"], asked: Float[Array, "2"]) -> Float[Array, "*batch"]:
    """Distance in space where no separation is asked, else the horizontal one that would be as much of it."""
    level = jnp.sqrt(apart[..., 0] ** 2 + apart[..., 1] ** 2)
    height = jnp.abs(apart[..., 2])
    as_much = asked[0] * separation_ratio(level, height, asked[0], asked[1])
    return jnp.where(asked[0] > 0.0, as_much, jnp.sqrt(level**2 + height**2))


@compiled
def _at_instants(
    positions: Float[Array, "time aircraft 3"], asked: Float[Array, "2"]
) -> tuple[Float[Array, " time"], Int[Array, " time"], Float[Array, "aircraft aircraft"]]:
    """Least distance of two at each instant, who they are (as one number), and the least of each pair."""
    fleet = positions.shape[1]
    first = jnp.triu(jnp.ones((fleet, fleet), dtype=bool), 1)

    def look(least: Array, place: Float[Array, "aircraft 3"]) -> tuple[Array, tuple[Array, Array]]:
        apart = _distance(place[:, None, :] - place[None, :, :], asked)
        apart = jnp.where(first & jnp.isfinite(apart), apart, jnp.inf)
        who = jnp.argmin(apart)
        return jnp.minimum(least, apart), (apart.ravel()[who], who)

    # Instant by instant: memory stays quadratic in the fleet.
    least, (distance, who) = lax.scan(look, jnp.full((fleet, fleet), jnp.inf), positions)
    return distance, who, least


@compiled_quickly
def _closely(
    motion: SampledMotion, pairs: Int[Array, "pairs 2"], asked: Float[Array, "2"]
) -> tuple[Float[Array, " pairs"], Float[Array, " pairs"], Float[Array, "pairs 3"]]:
    """Least distance of each pair until one arrives, when, and what then lies between them (NED, m)."""
    fine = _fine_times(motion.times)

    def one(pair: Int[Array, "2"]) -> tuple[Scalar, Scalar, Float[Array, "3"]]:
        apart = motion.positions_n[:, pair[1]] - motion.positions_n[:, pair[0]]
        rate = motion.velocities_n[:, pair[1]] - motion.velocities_n[:, pair[0]]

        def at(time: Scalar) -> tuple[Scalar, Float[Array, "3"]]:
            between = _between(motion.times, apart, rate, time)
            found = _distance(between, asked)
            return jnp.where(jnp.isfinite(found), found, jnp.inf), between

        k = jnp.argmin(jax.vmap(lambda time: at(time)[0])(fine))
        low, middle, high = (fine[jnp.clip(k + step, 0, fine.shape[0] - 1)] for step in (-1, 0, 1))

        def narrower(_: int, ends: tuple[Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar]:
            left, best, right = ends
            tried = jnp.stack([left, 0.5 * (left + best), best, 0.5 * (best + right), right])
            j = jnp.argmin(jax.vmap(lambda time: at(time)[0])(tried))
            return tried[jnp.maximum(j - 1, 0)], tried[j], tried[jnp.minimum(j + 1, 4)]

        _, when, _ = lax.fori_loop(0, _HALVINGS, narrower, (low, middle, high))
        value, between = at(when)
        return value, when, between

    return lax.map(one, pairs)


def nearest_pairs(motion: SampledMotion, separation_m: tuple[float, float] | None) -> ClosestApproach:
    """The two aircraft of a fleet that are nearest to each other, at the samples and at all; until one arrives.

    Parameters
    ----------
    motion
        Of the fleet.
    separation_m
        How distance is measured: None in space; else in the plane, or, where the second is not 0, in altitude scaled
        by the first over the second, whichever is more: what is asked is kept where that is at least the first.

    Notes
    -----
    The least of all is sought among the 64 pairs that are nearest at the samples.
    """
    count, fleet = motion.positions_n.shape[:2]
    if fleet < 2:
        nothing = np.full(count, np.nan)
        return ClosestApproach(nothing, np.full((count, 2), -1), np.nan, (-1, -1), np.nan, np.nan, np.nan)
    measure, filled = as_array(separation_m or (0.0, 0.0)), _filled(motion)
    distance, who, least = (np.asarray(x) for x in _at_instants(filled.positions_n, measure))
    distance, who = distance[:count], who[:count]
    together = np.isfinite(distance)
    pairs = np.stack(np.triu_indices(len(least), 1), axis=1)
    candidates = pairs[np.argsort(least[tuple(pairs.T)], kind="stable")[:_MOST_PAIRS]]
    found, when, apart = (np.asarray(x) for x in _closely(filled, as_array(candidates, None), measure))
    best = int(np.argmin(found))
    pair = np.stack(np.unravel_index(who, least.shape), axis=1)
    one, other = (int(k) for k in candidates[best])
    met = bool(np.isfinite(found[best]))
    return ClosestApproach(
        distance_m=np.where(together, distance, np.nan),
        pair=np.where(together[:, None], pair, -1),
        least_m=float(found[best]) if met else np.nan,
        least_pair=(one, other) if met else (-1, -1),
        at_s=float(when[best]) if met else np.nan,
        level_m=float(np.hypot(apart[best, 0], apart[best, 1])) if met else np.nan,
        height_m=float(abs(apart[best, 2])) if met else np.nan,
    )


@compiled
def _rooms(
    motion: SampledMotion, volumes: Float[Array, "volumes 7"]
) -> tuple[Float[Array, "aircraft volumes"], Float[Array, "aircraft volumes"]]:
    fine = _fine_times(motion.times)

    def one(track: tuple[Float[Array, "time 3"], Float[Array, "time 3"]]) -> tuple[Array, Array]:
        positions = jax.vmap(lambda time: _between(motion.times, *track, time))(fine)

        def room(volume: Float[Array, "7"]) -> tuple[Scalar, Scalar]:
            away = positions[:, :2] - volume[None, 0:2] - fine[:, None] * volume[None, 2:4]
            beside = jnp.sqrt(jnp.sum(away**2, axis=1)) - volume[4]
            altitude = -positions[:, 2]
            out = jnp.maximum(beside, jnp.maximum(volume[5] - altitude, altitude - volume[6]))
            k = jnp.argmin(jnp.where(jnp.isfinite(out), out, jnp.inf))
            return out[k], fine[k]

        return jax.vmap(room)(volumes)

    return lax.map(one, (jnp.swapaxes(motion.positions_n, 0, 1), jnp.swapaxes(motion.velocities_n, 0, 1)))


def keep_out_rooms(motion: SampledMotion, keep_outs: tuple[KeepOut, ...]) -> tuple[np.ndarray, np.ndarray]:
    """How far each aircraft stays out of each volume at least, m, negative inside; and when, s; (aircraft, volume).

    Looked for at sixteen instants between two samples.
    """
    if not keep_outs:
        none = np.zeros((motion.positions_n.shape[1], 0))
        return none, none
    rows = [
        (one.north_m, one.east_m, *one.velocity_m_s()[:2], one.radius_m, one.bottom_m, one.top_m) for one in keep_outs
    ]
    found = _rooms(_filled(motion), filled_up(as_array(rows), _VOLUMES))
    rooms, when = (np.asarray(one)[: motion.positions_n.shape[1], : len(rows)] for one in found)
    return rooms, when
