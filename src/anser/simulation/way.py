"""The whole way of an aircraft: its path to the arrival, and its hold after it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.planning.certified import Airspace, broad_phase, path_bounds
from anser.planning.certified.broad_phase import fleet_clearance_ratio, fleet_cylinders
from anser.planning.certified.clearance import Track
from anser.planning.certified.tracking import path_track
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Scalar, ScalarLike
from anser.simulation.planned_hold import PlannedHolds

INSTANTS = 8
"""Per cell of a hold's path, at which distances are looked at; bounds hold between them."""
INTERVALS_PER_CYLINDER = 4 * broad_phase.INTERVALS_PER_CYLINDER


class Way(eqx.Module):
    """Paths and holds; leading axis aircraft.

    Attributes
    ----------
    path
        To the arrivals.
    hold
        From there on, see `anser.simulation.planned_hold.each_alone`.
    """

    path: TimedPath
    hold: PlannedHolds


def holding_in(times: Float[Array, " instants"], arrival: ScalarLike) -> Bool[Array, " intervals"]:
    """In which intervals between some instants an aircraft holds, at least at the end."""
    return times[1:] > arrival


def whole_track(first: Track, second: Track, times: Float[Array, " instants"], arrival: ScalarLike) -> Track:
    """One track of an approach and the hold after it, by the same instants (s); that of the arrival is of both."""
    holding, underway = holding_in(times, arrival), times[:-1] < arrival
    error_bound = jnp.maximum(jnp.where(holding, second.error_bound, 0.0), jnp.where(underway, first.error_bound, 0.0))
    places = jnp.where((times > arrival)[:, None], second.positions_n, first.positions_n)
    return Track(places, error_bound, jnp.maximum(first.counted, second.counted))


def clearance_ratios(
    ways: Way, active: Float[Array, " ways"], airspace: Airspace, since: ScalarLike
) -> Float[Array, "ways ways"]:
    """Least ratio of distance to separation of each pair of ways from a time (s) to the end of their holds, or less.

    Infinite for a way and itself. What is before a path begins does not count; nor do ways whose `active` is 0.
    """
    cells, count = ways.hold.paths.times.shape[1] - 1, active.shape[0]
    until = jnp.max(ways.hold.paths.times)
    times = since + (until - since) * jnp.linspace(0.0, 1.0, INSTANTS * cells + 1)

    def tracked(path: TimedPath, counts: Scalar) -> Track:
        bounds = path_bounds(path, airspace.wind, airspace.gravity)
        return path_track(path, bounds.cell_acceleration, counts, times)

    def whole(path: TimedPath, hold: TimedPath, counts: Scalar) -> Track:
        return whole_track(tracked(path, counts), tracked(hold, counts), times, path.times[-1])

    tracks = jax.vmap(whole)(ways.path, ways.hold.paths, active)
    cylinders, everyone = fleet_cylinders(tracks, count, INTERVALS_PER_CYLINDER), jnp.arange(count)

    def ratios_of(who: Count) -> Float[Array, " ways"]:
        one, own = jax.tree.map(lambda leaf: leaf[who], (tracks, cylinders))
        others = everyone != who
        return fleet_clearance_ratio(
            one, own, cylinders, lambda some: jax.tree.map(lambda leaf: leaf[some], tracks), others, airspace.separation
        )

    return jax.lax.map(ratios_of, everyone)
