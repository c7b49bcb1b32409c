"""Splines: trajectories as cubic splines in time of the position over the ground.

And the least-squares equations of their limit violations. The acceleration is linear between the knots. Positions,
velocities and accelerations are linear in the coefficients, and each depends on four of them only, so that normal
equations are summed interval by interval.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environment.environment import AbstractWind, LayeredWind
from anser.numerics.integration import gauss_legendre
from anser.numerics.linear import BlockTridiagonal
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.demand import demand
from anser.planning.limits import CERTIFIED_LIMITS, acceleration_limits
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Scalar, ScalarLike

_RULE = gauss_legendre(4)
_HALVINGS = 45
_LAYER_EDGE_M = 1e-6  # from the edge of a layer of wind: where its rate is taken on either side
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


def basis_values(fractions: Float[np.ndarray, " places"] | Float[Array, " places"]) -> Any:
    """The four splines that reach an interval, with slopes and second derivatives, at places of it from 0 to 1.

    (order, place, spline); derivatives are by the part of the interval; of the kind of array that places are.
    """
    stack = np.stack if isinstance(fractions, np.ndarray) else jnp.stack
    u, v = fractions, 1.0 - fractions
    value = [v**3 / 6, (3 * u**3 - 6 * u**2 + 4) / 6, (3 * v**3 - 6 * v**2 + 4) / 6, u**3 / 6]
    slope = [-(v**2) / 2, (3 * u**2 - 4 * u) / 2, (4 * v - 3 * v**2) / 2, u**2 / 2]
    return stack([stack(rows, axis=-1) for rows in (value, slope, [v, 3 * u - 2, 3 * v - 2, u])])


def coefficient_windows(coefficients: Coefficients) -> Float[Array, "cells 4 3"]:
    """The four coefficients on which each interval depends."""
    cells = coefficients.shape[0] - 3
    return jnp.stack([coefficients[k : k + cells] for k in range(4)], axis=1)


def spline_states(spline: Spline, fractions: Float[np.ndarray, " places"]) -> Float[Array, "cells places 3 3"]:
    """Position, velocity and acceleration (order, axis) at the same places, from 0 to 1, of each interval."""
    scale = jnp.stack([spline.cell**-order for order in range(3)])
    return jnp.einsum(
        "ouk,nka,o->nuoa", jnp.asarray(basis_values(fractions)), coefficient_windows(spline.coefficients), scale
    )


def states_at(spline: Spline, times: Float[Array, " times"]) -> Float[Array, "times 3 3"]:
    """The same at any times, s."""
    share = times / spline.cell
    which = jnp.clip(jnp.floor(share), 0, spline.cells - 1)
    scale = jnp.stack([spline.cell**-order for order in range(3)])
    held = coefficient_windows(spline.coefficients)[which.astype(jnp.int32)]
    return jnp.einsum("otk,tka,o->toa", basis_values(share - which), held, scale)


def knot_coefficients(cell: ScalarLike) -> Float[Array, "3 3"]:
    """How the three coefficients about a knot follow from position, velocity and acceleration there: by a product."""
    sixth = jnp.asarray(cell) ** 2 / 6.0
    one = jnp.ones(())
    return jnp.stack(
        [jnp.stack([one, side * cell, part * sixth]) for side, part in ((-one, 2.0), (0.0 * one, -1.0), (one, 2.0))]
    )


@functools.cache
def mean_squares() -> Float[np.ndarray, "3 4 4"]:
    """Mean squares of place, velocity and acceleration in an interval of 1 s, as forms of its four coefficients."""
    at = basis_values(np.asarray(_RULE.nodes))
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
    blowing, changing = wind_along(wind, -at[:, 0, 2] + _LAYER_EDGE_M * aside, -at[:, 1, 2])
    drift = jnp.stack([drifts, blowing, changing], axis=1)
    return TimedPath(start_time + times, at - drift, drift)


GROUP = 4
"""Coefficients whose changes are unknowns together; the intervals of a spline are a multiple."""
_SAMPLE_POINTS = np.array([0.25, 0.5, 0.75, 1.0])  # of each interval; nothing changes the start
_SPEED, _FORCE, _ALONG, _CLIMB, _HEIGHT_M, _INSIDE_M = 5.0, 1.0, 0.3, 2.0, 50.0, 200.0
"""Violations that weigh as much as each other: m/s; m/s^2 across and along the path; m/s up; m; in a volume, m."""
_STEP_M, _STEP_SPEED, _STEP_ACCELERATION = 3000.0, 30.0, 3.0
"""Changes that make a step of the size 1: m, m/s, m/s^2."""
_CLIMB_KEPT = 0.998
_VIOLATION_FACTOR, _LEAST_KEPT = 1.3, 0.5
_SPEED_RESERVE, _SPEED_PART = 0.15, 0.1  # m/s, but no more than this part of the range
_RESERVE_M, _RESERVE_UP_M = 30.0, 10.0
_UP_WEIGHT = 3.0  # metres aside that one metre up or down is worth, to get out of a keep-out
_ANY_LOAD, _ANY_SPEED = 1e3, 1e4
_LEVEL_LEAST = 1.0  # m/s


class SplineProblem(NamedTuple):
    """Who flies, where, and how long, s."""

    task: AircraftTask
    airspace: Airspace
    duration: Scalar


class TightenedLimits(NamedTuple):
    """Limits somewhat narrower than an aircraft's own, for what lies between the instants that are looked at.

    Attributes
    ----------
    speed_min, speed_max
        m/s.
    bank
        Tangent of the bank angle.
    load_factor, climb_rate
        1, m/s.
    acceleration, deceleration
        Along the path, m/s^2.
    """

    speed_min: Scalar
    speed_max: Scalar
    bank: Scalar
    load_factor: Scalar
    climb_rate: Scalar
    acceleration: Scalar
    deceleration: Scalar


class SplineStart(NamedTuple):
    """Where the search for one spline begins.

    Attributes
    ----------
    coefficients
        Of a spline that begins as the aircraft does and ends at the rendezvous, as prescribed: (coefficient, axis).
    frame
        Directions in which its last velocity may change, (axis, direction); those that may not are 0.
    allowed
        Limits that it is held to.
    """

    coefficients: Float[Array, "coefficients 3"]
    frame: Float[Array, "3 3"]
    allowed: TightenedLimits


class NormalEquations(NamedTuple):
    """Normal equations of least squares: half the sum of squares, its gradient, the Jacobian's product with itself."""

    cost: Scalar
    gradient: Float[Array, "groups n"]
    form: BlockTridiagonal


def initial_limits(problem: SplineProblem, share: Scalar) -> TightenedLimits:
    """A share of the limits of bank, load factor and acceleration along the path, nearly all of the others."""
    limits = problem.task.limits
    highest = jnp.minimum(limits.speed_max, _ANY_SPEED)
    reserve = jnp.minimum(_SPEED_RESERVE, _SPEED_PART * (highest - limits.speed_min))
    return TightenedLimits(
        limits.speed_min + reserve,
        highest - reserve,
        share * jnp.tan(limits.bank_max),
        share * jnp.minimum(limits.load_factor_max, _ANY_LOAD),
        _CLIMB_KEPT * limits.climb_rate_max,
        share * limits.acceleration_max,
        share * limits.deceleration_max,
    )


def tighten_limits(problem: SplineProblem, allowed: TightenedLimits, over: Float[Array, "9"]) -> TightenedLimits:
    """Less by what is violated between the instants looked at (`certificate.excess`), and a little more."""
    limits = problem.task.limits
    fields = (limit.field for limit in CERTIFIED_LIMITS)
    violated: dict[str, Scalar] = dict(zip(fields, _VIOLATION_FACTOR * jnp.maximum(over, 0.0), strict=True))
    middle = 0.5 * (limits.speed_min + jnp.minimum(limits.speed_max, _ANY_SPEED))
    low = allowed.speed_min + violated["speed_min"] * limits.speed_min
    high = allowed.speed_max - violated["speed_max"] * jnp.minimum(limits.speed_max, _ANY_SPEED)

    less = {
        name: getattr(allowed, name) * jnp.maximum(1.0 - violated[f"{name}_max"], _LEAST_KEPT)
        for name in ("bank", "load_factor", "climb_rate", "acceleration", "deceleration")
    }
    return TightenedLimits(jnp.minimum(low, middle), jnp.maximum(high, middle), **less)


def initial_state_n(problem: SplineProblem) -> Float[Array, "3 3"]:
    """Position, velocity and acceleration over the ground at the start: (order, axis)."""
    task, airspace, _ = problem
    down, rate = task.position_n[2], task.air_velocity_n[2]
    (wind,), (by_climb,) = wind_along(airspace.wind, -down[None], jnp.ones(1))
    wind_dot = -(rate + wind[2]) * by_climb
    return jnp.stack([task.position_n, task.air_velocity_n + wind, task.air_acceleration_n + wind_dot])


def _limit_violations(
    problem: SplineProblem,
    allowed: TightenedLimits,
    altitude: Scalar,
    velocity: Float[Array, "3"],
    acceleration: Float[Array, "3"],
) -> Float[Array, "8"]:
    """Violations of limits at one instant, each in the unit that weighs as much; 0 where kept."""
    limits, gravity = problem.task.limits, problem.airspace.gravity
    (wind,), _ = wind_along(problem.airspace.wind, altitude[None], jnp.ones(1))
    asked = demand(velocity - wind, acceleration, gravity, _LEVEL_LEAST)
    most = allowed.load_factor * gravity
    held_to = eqx.tree_at(acceleration_limits, limits, (allowed.acceleration, allowed.deceleration))
    banked, loaded, along = asked.excess(allowed.bank, most, *held_to.along(asked.speed, asked.smooth_normal / gravity))
    low, high = limits.altitude_min + _RESERVE_UP_M, limits.altitude_max - _RESERVE_UP_M
    violations = [
        (allowed.speed_min - asked.speed) / _SPEED,
        (asked.speed - allowed.speed_max) / _SPEED,
        banked / _FORCE,
        loaded / _FORCE,
        along / _ALONG,
        (jnp.abs(velocity[2] - wind[2]) - allowed.climb_rate) / _CLIMB,
        (low - altitude) / _HEIGHT_M,
        (altitude - high) / _HEIGHT_M,
    ]
    return jnp.maximum(jnp.stack(violations), 0.0)


def _keep_out_penetration(problem: SplineProblem, time: Scalar, place: Float[Array, "3"]) -> Scalar:
    """How deep a place is inside keep-outs, summed over them."""
    limits, volumes = problem.task.limits, problem.airspace.keep_outs
    altitude = -place[2]
    off = place[None, :2] - volumes.position_n - time * volumes.velocity_n
    aside = volumes.radius + _RESERVE_M - jnp.sqrt(jnp.sum(off**2, axis=1) + 1.0)
    under, over = altitude - volumes.bottom + _RESERVE_UP_M, volumes.top + _RESERVE_UP_M - altitude
    # A way out that leads below the floor or above the ceiling is none.
    under = jnp.where(volumes.bottom > limits.altitude_min + 50.0, _UP_WEIGHT * under, jnp.inf)
    over = jnp.where(volumes.top < limits.altitude_max - 50.0, _UP_WEIGHT * over, jnp.inf)
    deep = jnp.minimum(aside, jnp.minimum(under, over))
    return jnp.sum(jnp.maximum(deep, 0.0)) / _INSIDE_M


def _violations(
    problem: SplineProblem, allowed: TightenedLimits, time: Scalar, state: Float[Array, "3 3"]
) -> Float[Array, " rows"]:
    """All violations at one instant in a state over the ground (order, axis)."""
    rows = _limit_violations(problem, allowed, -state[0, 2], state[1], state[2])
    if problem.airspace.keep_outs.radius.shape[0]:
        rows = jnp.append(rows, _keep_out_penetration(problem, time, state[0]))
    return rows


def update_coefficients(
    begin: SplineStart, cell: Scalar, unknowns: Float[Array, "groups 12"]
) -> Float[Array, "coefficients 3"]:
    """Coefficients after a change: of those between both ends, and of the last velocity and acceleration."""
    changes = unknowns.reshape(-1, 3)
    inner, (_, velocity, acceleration) = changes[:-3], changes[-3:]
    last = knot_coefficients(cell)[:, 1:] @ jnp.stack([begin.frame @ velocity, acceleration])
    return begin.coefficients + jnp.concatenate([jnp.zeros((3, 3)), inner, last])


def _end_jacobian(begin: SplineStart, cell: Scalar) -> Float[Array, "12 12"]:
    """How the last group of coefficients follows from the last unknowns."""
    slopes = knot_coefficients(cell)
    by_velocity = slopes[:, 1, None, None] * begin.frame[None, :, :]
    by_acceleration = slopes[:, 2, None, None] * jnp.eye(3)[None, :, :]
    last = jnp.stack([jnp.zeros((3, 3, 3)), by_velocity, by_acceleration], axis=2).reshape(9, 9)
    return jax.scipy.linalg.block_diag(jnp.eye(3), last)


def _sum_into_groups(each: Float[Array, "cells 4 4 a b"]) -> BlockTridiagonal:
    """Sum of what each interval says of its four coefficients, for all but the first three, in groups of four."""
    cells, axes = each.shape[0], each.shape[3]
    phases = each.reshape(cells // GROUP, GROUP, 4, 4, axes, axes)
    # Of four neighbours, the first reaches back to the group before by three coefficients, the last by none.
    wide = [jnp.pad(phases[:, k], ((0, 0), (k + 1, 3 - k), (k + 1, 3 - k), (0, 0), (0, 0))) for k in range(GROUP)]
    both = functools.reduce(jnp.add, wide)
    own = both[:, 4:, 4:].at[:-1].add(both[1:, :4, :4])

    def flat(blocks: Array) -> Array:
        return jnp.swapaxes(blocks, 2, 3).reshape(-1, GROUP * axes, GROUP * axes)

    return BlockTridiagonal(flat(own), flat(both[:, 4:, :4]))


def _in_unknowns(form: BlockTridiagonal, last: Float[Array, "12 12"]) -> BlockTridiagonal:
    """A form of coefficients as one of unknowns."""
    own = form.diagonal.at[-1].set(last.T @ form.diagonal[-1] @ last)
    return BlockTridiagonal(own, form.subdiagonal.at[-1].set(last.T @ form.subdiagonal[-1]))


def arrives_forward(begin: SplineStart, velocity_n: Float[Array, "3"]) -> Flag:
    """Whether a last velocity over the ground points where a prescribed course does, not the other way."""
    free = jnp.all(jnp.any(begin.frame != 0.0, axis=0))
    return free | (begin.frame[:2, 0] @ velocity_n[:2] > 0.0)


def step_metric(problem: SplineProblem, begin: SplineStart) -> BlockTridiagonal:
    """Square of the size of a step of the unknowns, as an aircraft feels it; 1 for unknowns that change nothing."""
    cells = begin.coefficients.shape[0] - 3
    cell = problem.duration / cells
    place, velocity, acceleration = (jnp.asarray(squares) / cells for squares in mean_squares())
    one = place / _STEP_M**2 + velocity / (_STEP_SPEED * cell) ** 2 + acceleration / (_STEP_ACCELERATION * cell**2) ** 2
    last = _end_jacobian(begin, cell)
    every = one[None, :, :, None, None] * jnp.eye(3)[None, None, None]
    size = _in_unknowns(_sum_into_groups(jnp.tile(every, (cells, 1, 1, 1, 1))), last)
    idle = jnp.where(jnp.any(last != 0.0, axis=0), 0.0, 1.0)
    return size._replace(diagonal=size.diagonal.at[-1].add(jnp.diag(idle)))


def normal_equations(
    problem: SplineProblem, begin: SplineStart, unknowns: Float[Array, "groups 12"]
) -> NormalEquations:
    """Normal equations of all that a spline violates, at a few instants of each interval."""
    cells = begin.coefficients.shape[0] - 3
    spline = Spline(problem.duration, update_coefficients(begin, problem.duration / cells, unknowns))
    cell = spline.cell
    now = spline_states(spline, _SAMPLE_POINTS)
    times = cell * (jnp.arange(cells)[:, None] + jnp.asarray(_SAMPLE_POINTS)[None, :])
    one = functools.partial(_violations, problem, begin.allowed)
    violations = jax.vmap(jax.vmap(one))(times, now)
    by_state = jax.vmap(jax.vmap(jax.jacfwd(one, argnums=1)))(times, now)
    scaled = jnp.stack([jnp.asarray(of_order) / cell**k for k, of_order in enumerate(basis_values(_SAMPLE_POINTS))])
    by_window = jnp.einsum("nuroa,ouk->nurka", by_state, scaled).reshape(cells, -1, 12)
    gradients = jnp.einsum("nr,nrj->nj", violations.reshape(cells, -1), by_window).reshape(cells, 4, 3)
    squares = jnp.einsum("nri,nrj->nij", by_window, by_window).reshape(cells, 4, 3, 4, 3)
    form = _sum_into_groups(jnp.swapaxes(squares, 2, 3))
    gradient = functools.reduce(jnp.add, (jnp.pad(gradients[:, k], ((k, 3 - k), (0, 0))) for k in range(4)))
    gradient = gradient[3:].reshape(cells // GROUP, 3 * GROUP)
    last = _end_jacobian(begin, cell)
    gradient = gradient.at[-1].set(last.T @ gradient[-1])
    return NormalEquations(0.5 * jnp.sum(violations**2), gradient, _in_unknowns(form, last))
