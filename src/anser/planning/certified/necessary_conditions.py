"""Necessary conditions of arrival times, whatever the path: distance, height, and rendezvous points that are free."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.compiling import compiled_quickly
from anser.environment import AbstractWind
from anser.numerics import as_array
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.separation import separation_ratio
from anser.shapes import Scalar

_ALTITUDES = 65  # at which the wind is asked for its greatest speed
_WIND_FACTOR = 1.02
_EDGE_M = 1.0  # so far inside a keep-out, or a separation, the judgement is left to the certificate
_ALTITUDE_MARGIN_M = 1000.0  # above and below all ends: where detours in altitude lead


def _strongest_wind(tasks: AircraftTask, airspace: Airspace) -> tuple[float, float]:
    """Greatest speed of the wind, and of its vertical component, between all ends and somewhat beyond, m/s."""
    both = -np.append(np.asarray(tasks.rendezvous_n)[:, 2], np.asarray(tasks.position_n)[:, 2])
    heights = np.linspace(np.min(both) - _ALTITUDE_MARGIN_M, np.max(both) + _ALTITUDE_MARGIN_M, _ALTITUDES)
    whole, vertical = _strongest(airspace.wind, as_array(heights))
    return _WIND_FACTOR * float(whole), _WIND_FACTOR * float(vertical)


@compiled_quickly
def _strongest(wind: AbstractWind, heights: Float[Array, " n"]) -> tuple[Scalar, Scalar]:
    winds = jax.vmap(lambda h: wind.at(jnp.stack([0.0 * h, 0.0 * h, -h]), 0.0))(heights)
    return jnp.max(jnp.linalg.norm(winds, axis=1)), jnp.max(jnp.abs(winds[:, 2]))


def climb_times_min(tasks: AircraftTask, airspace: Airspace) -> Float[np.ndarray, " aircraft"]:
    """Least time for each change of altitude at the greatest rate of climb or descent, s; infinite if there is none.

    A lower bound whatever the path: rates build up, but a small change needs a small rate only, so nothing is added
    for that, and the bound is zero for a level rendezvous and continuous there.
    """
    rate = np.asarray(tasks.limits.climb_rate_max) + _strongest_wind(tasks, airspace)[1]
    fall = (np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n))[:, 2]
    closing = rate - np.sign(fall) * np.asarray(tasks.goal_velocity_n)[:, 2]
    return np.where(closing > 0.0, np.abs(fall) / np.maximum(closing, 1e-9), np.where(fall == 0.0, 0.0, np.inf))


def may_arrive(
    tasks: AircraftTask, airspace: Airspace, who: Int[np.ndarray, " pairs"], durations: Float[np.ndarray, " pairs"]
) -> Bool[np.ndarray, " pairs"]:
    """Whether a duration (s) meets the necessary conditions: distance, height, a rendezvous outside keep-outs."""
    limits, t = tasks.limits, durations[:, None]
    line = (np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n))[who] + t * np.asarray(tasks.goal_velocity_n)[
        who
    ]
    wind, vertical_wind = _strongest_wind(tasks, airspace)
    fast = np.linalg.norm(line[:, :2], axis=1) <= (np.asarray(limits.speed_max)[who] + wind) * durations
    gentle = np.abs(line[:, 2]) <= (np.asarray(limits.climb_rate_max)[who] + vertical_wind) * durations
    place, volumes = np.asarray(tasks.position_n)[who] + line, airspace.keep_outs
    moved = np.asarray(volumes.position_n)[None] + t[:, :, None] * np.asarray(volumes.velocity_n)[None]
    beside = np.linalg.norm(place[:, None, :2] - moved, axis=2) >= np.asarray(volumes.radius) - _EDGE_M
    height = -place[:, 2:]
    over = height >= np.asarray(volumes.top) - _EDGE_M
    under = height <= np.asarray(volumes.bottom) + _EDGE_M
    return fast & gentle & np.all(beside | over | under, axis=1)


def arrival_distances_max(
    tasks: AircraftTask, airspace: Airspace, durations: Float[np.ndarray, "n aircraft"]
) -> tuple[Float[np.ndarray, "n aircraft aircraft"], Float[np.ndarray, "n aircraft aircraft"]]:
    """How far apart two aircraft can be at most when the first of them arrives, whatever their shapes.

    The one that arrives later (durations in s) may until then have been away from its rendezvous by what it flies in
    between.

    Returns
    -------
    Horizontal and vertical distance, m; infinite to itself and to one that is not active.
    """
    limits, (wind, vertical_wind) = tasks.limits, _strongest_wind(tasks, airspace)
    end = np.asarray(tasks.rendezvous_n)
    place = end + durations[:, :, None] * np.asarray(tasks.goal_velocity_n)
    apart = place[:, :, None] - place[:, None, :]
    between = durations[:, :, None] - durations[:, None, :]

    def covered(rate: Float[np.ndarray, " aircraft"], wind: float) -> Float[np.ndarray, "n aircraft aircraft"]:
        # A product with no time in between is nothing, even where a limit does not exist.
        fast = np.minimum(rate, 1e9) + wind
        return np.where(between > 0.0, fast[:, None], fast[None, :]) * np.abs(between)

    active = np.asarray(tasks.active) > 0.0
    nothing = np.eye(active.size, dtype=bool) | ~active[:, None] | ~active[None, :]
    level = np.linalg.norm(apart[..., :2], axis=-1) + covered(np.asarray(limits.speed_max), wind)
    height = np.abs(apart[..., 2]) + covered(np.asarray(limits.climb_rate_max), vertical_wind)
    return np.where(nothing, np.inf, level), np.where(nothing, np.inf, height)


def arrival_conflicts(
    tasks: AircraftTask, airspace: Airspace, durations: Float[np.ndarray, "n aircraft"]
) -> Bool[np.ndarray, "n aircraft aircraft"]:
    """Which two aircraft cannot be apart when the first of them arrives, if each takes its duration (s)."""
    horizontal, vertical = float(airspace.separation.horizontal), float(airspace.separation.vertical)
    level, height = arrival_distances_max(tasks, airspace, durations)
    return separation_ratio(level + _EDGE_M, height + _EDGE_M, horizontal, vertical) < 1.0
