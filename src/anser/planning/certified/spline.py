"""Trajectories as cubic splines in time of the position over the ground.

The acceleration is linear between the knots, so that a path through a few of its states is the spline itself. Places,
velocities and accelerations are linear in the coefficients, and each depends on four of them only.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environment import AbstractWind, LayeredWind
from anser.numerics.quadrature import gauss_legendre
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike

_RULE = gauss_legendre(4)
_HALVINGS = 45
_BESIDE_M = 1e-6  # from the edge of a layer of wind: where its rate is taken on either side
Coefficients = Float[Array, "coefficients 3"]


class Spline(eqx.Module):
    """Where one aircraft is when.

    Attributes
    ----------
    duration
        s.
    coefficients
        Of uniform cubic B-splines, three more than there are intervals; NED, m.
    """

    duration: Scalar
    coefficients: Coefficients

    @property
    def cells(self) -> int:
        """Number of equal intervals."""
        return self.coefficients.shape[0] - 3

    @property
    def cell(self) -> Scalar:
        """Length of an interval, s."""
        return self.duration / self.cells


def bases(places: Float[np.ndarray, " places"] | Float[Array, " places"]) -> Any:
    """The four splines that reach an interval, with slopes and second derivatives, at places of it from 0 to 1.

    (order, place, spline); derivatives are by the part of the interval; of the kind of array that places are.
    """
    stack = np.stack if isinstance(places, np.ndarray) else jnp.stack
    u, v = places, 1.0 - places
    value = [v**3 / 6, (3 * u**3 - 6 * u**2 + 4) / 6, (3 * v**3 - 6 * v**2 + 4) / 6, u**3 / 6]
    slope = [-(v**2) / 2, (3 * u**2 - 4 * u) / 2, (4 * v - 3 * v**2) / 2, u**2 / 2]
    return stack([stack(rows, axis=-1) for rows in (value, slope, [v, 3 * u - 2, 3 * v - 2, u])])


def windows(coefficients: Coefficients) -> Float[Array, "cells 4 3"]:
    """The four coefficients on which each interval depends."""
    cells = coefficients.shape[0] - 3
    return jnp.stack([coefficients[k : k + cells] for k in range(4)], axis=1)


def states(spline: Spline, places: Float[np.ndarray, " places"]) -> Float[Array, "cells places 3 3"]:
    """Position, velocity and acceleration (order, axis) at the same places, from 0 to 1, of each interval."""
    scale = jnp.stack([spline.cell**-order for order in range(3)])
    return jnp.einsum("ouk,nka,o->nuoa", jnp.asarray(bases(places)), windows(spline.coefficients), scale)


def states_at(spline: Spline, times: Float[Array, " times"]) -> Float[Array, "times 3 3"]:
    """The same at any times, s."""
    share = times / spline.cell
    which = jnp.clip(jnp.floor(share), 0, spline.cells - 1)
    scale = jnp.stack([spline.cell**-order for order in range(3)])
    held = windows(spline.coefficients)[which.astype(jnp.int32)]
    return jnp.einsum("otk,tka,o->toa", bases(share - which), held, scale)


def end_slopes(cell: ScalarLike) -> Float[Array, "3 3"]:
    """How the three coefficients about a knot follow from position, velocity and acceleration there: by a product."""
    sixth = jnp.asarray(cell) ** 2 / 6.0
    one = jnp.ones(())
    return jnp.stack(
        [jnp.stack([one, side * cell, part * sixth]) for side, part in ((-one, 2.0), (0.0 * one, -1.0), (one, 2.0))]
    )


@functools.cache
def mean_squares() -> Float[np.ndarray, "3 4 4"]:
    """Mean squares of place, velocity and acceleration in an interval of 1 s, as forms of its four coefficients."""
    at = bases(np.asarray(_RULE.nodes))
    return np.einsum("ouk,oul,u->okl", at, at, np.asarray(_RULE.weights))


def wind_along(
    wind: AbstractWind, altitudes: Float[Array, " n"], climbs: Float[Array, " n"]
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Wind at altitudes (m), m/s, and how it changes for one who climbs (m/s) there, m/s^2."""

    def one(altitude: Scalar, climb: Scalar) -> tuple[Array, Array]:
        def at(h: Scalar) -> Array:
            return wind.at(jnp.stack([jnp.zeros(()), jnp.zeros(()), -h]), 0.0)

        return jax.jvp(at, (altitude,), (climb,))

    return jax.vmap(one)(altitudes, climbs)


def _crossings(
    spline: Spline, edges: Float[Array, " layers"], intervals: int, most: int
) -> tuple[Float[Array, " most"], Float[Array, " most"]]:
    """When altitudes (m) are crossed, s, and whether up or down, 1 or -1; for no crossing the last time and 0.

    Those between intervals that are on both sides; no more than so many.
    """
    times = spline.duration * jnp.linspace(0.0, 1.0, intervals + 1)
    heights = -states_at(spline, times)[:, 0, 2]
    over = heights[:, None] > edges[None, :]
    crossed = (over[1:] != over[:-1]).ravel()
    found = jnp.flatnonzero(crossed, size=most, fill_value=0)
    there = jnp.arange(most) < jnp.sum(crossed)
    tick, edge = found // edges.shape[0], edges[found % edges.shape[0]]
    way = jnp.where(over[tick + 1, found % edges.shape[0]], 1.0, -1.0)

    def halve(_: int, span: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = span
        middle = 0.5 * (low + high)
        yet = way * (-states_at(spline, middle)[:, 0, 2] - edge) < 0.0
        return jnp.where(yet, middle, low), jnp.where(yet, high, middle)

    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, (times[tick], times[tick + 1]))
    return jnp.where(there, 0.5 * (low + high), spline.duration), jnp.where(there, way, 0.0)


def spline_path(start_time: ScalarLike, spline: Spline, wind: AbstractWind, intervals: int, knots: int) -> TimedPath:
    """The spline as it is delivered, in a wind, with empty intervals at its end up to a number of knots.

    Where it crosses the edge of a layer of wind, there are two knots: the rate of the wind jumps.

    Parameters
    ----------
    start_time
        s.
    spline, wind
        What is flown, in what.
    intervals
        Even intervals, a multiple of the spline's.
    knots
        More than `intervals`; half of those beyond are for edges.
    """
    times = spline.duration * jnp.linspace(0.0, 1.0, intervals + 1)
    most = (knots - intervals - 1) // 2
    aside = jnp.zeros(intervals + 1)
    if isinstance(wind, LayeredWind):
        crossed, way = _crossings(spline, wind.altitudes, intervals, most)
        times = jnp.concatenate([times, jnp.repeat(crossed, 2)])
        aside = jnp.concatenate([aside, jnp.stack([-way, way], axis=1).ravel()])
    order = jnp.argsort(times, stable=True)
    order = jnp.concatenate([order, jnp.repeat(order[-1:], knots - order.shape[0])])
    times, aside = times[order], aside[order]
    nodes, spans = jnp.asarray(_RULE.nodes), jnp.diff(times)
    within = states_at(spline, (times[:-1, None] + spans[:, None] * nodes[None, :]).ravel())
    winds, _ = wind_along(wind, -within[:, 0, 2], -within[:, 1, 2])
    weights = jnp.asarray(_RULE.weights)[None, :, None]
    parts = spans[:, None] * jnp.sum(winds.reshape(-1, nodes.shape[0], 3) * weights, axis=1)
    drifts = jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(parts, axis=0)])
    at = states_at(spline, times)
    blowing, changing = wind_along(wind, -at[:, 0, 2] + _BESIDE_M * aside, -at[:, 1, 2])
    drift = jnp.stack([drifts, blowing, changing], axis=1)
    return TimedPath(start_time + times, at - drift, drift)
