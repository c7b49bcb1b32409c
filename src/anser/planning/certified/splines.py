"""Cubic splines in time of the position over the ground, and least-squares equations for violations of the limits.

The acceleration is linear between the knots. In each interval, position, velocity and acceleration are linear in four
coefficients; the normal equations are sums over the intervals.
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
from anser.planning.certified.fitted_wind import wind_layers
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.demand import demand
from anser.planning.limits import CERTIFIED_LIMITS, acceleration_limits, reduced_limit
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Scalar, ScalarLike

_RULE = gauss_legendre(4)
_HALVINGS = 45
_CLOSE_S = 1e-3  # time between a crossing of the edge of a wind layer and a knot within which they become one
_LAYER_EDGE_M = 1e-6  # distance from the edge of a wind layer at which the rate of the wind is evaluated
Coefficients = Float[Array, "coefficients 3"]


class Spline(eqx.Module):
    """Position of one aircraft over the ground as a function of time: a uniform cubic B-spline."""

    duration: Scalar  # s
    coefficients: Coefficients  # coefficients, one for each interval and three more, (coefficient, NED axis), m

    @property
    def cells(self) -> int:
        """Number of equal intervals."""
        return self.coefficients.shape[0] - 3

    @property
    def cell(self) -> Scalar:
        """Duration of an interval, s."""
        return self.duration / self.cells


def basis_values(fractions: Float[np.ndarray, " fractions"] | Float[Array, " fractions"]) -> Any:
    """Return values, first and second derivatives of the four B-splines in an interval, at fractions (0 to 1) of it.

    The derivatives are with respect to the fraction. Shape of the result: (order of derivative, fraction, B-spline), a
    NumPy or JAX array like the argument.
    """
    stack = np.stack if isinstance(fractions, np.ndarray) else jnp.stack
    u, v = fractions, 1.0 - fractions
    basis = [v**3 / 6, (3 * u**3 - 6 * u**2 + 4) / 6, (3 * v**3 - 6 * v**2 + 4) / 6, u**3 / 6]
    slopes = [-(v**2) / 2, (3 * u**2 - 4 * u) / 2, (4 * v - 3 * v**2) / 2, u**2 / 2]
    return stack([stack(values, axis=-1) for values in (basis, slopes, [v, 3 * u - 2, 3 * v - 2, u])])


def coefficient_windows(coefficients: Coefficients) -> Float[Array, "cells 4 3"]:
    """Return the four coefficients on which each interval depends: (interval, coefficient, axis)."""
    cells = coefficients.shape[0] - 3
    return jnp.stack([coefficients[k : k + cells] for k in range(4)], axis=1)


def spline_states(spline: Spline, fractions: Float[np.ndarray, " fractions"]) -> Float[Array, "cells fractions 3 3"]:
    """Return position, velocity and acceleration over the ground (NED, SI) at fractions (0 to 1) of each interval.

    Shape of the result: (interval, fraction, order of derivative, axis).
    """
    scale = jnp.stack([spline.cell**-order for order in range(3)])
    return jnp.einsum(
        "ouk,nka,o->nuoa", jnp.asarray(basis_values(fractions)), coefficient_windows(spline.coefficients), scale
    )


def states_at(spline: Spline, times: Float[Array, " times"]) -> Float[Array, "times 3 3"]:
    """Return position, velocity and acceleration over the ground (NED, SI) at times, s after the start.

    Shape of the result: (time, order of derivative, axis).
    """
    share = times / spline.cell
    interval = jnp.clip(jnp.floor(share), 0, spline.cells - 1)
    scale = jnp.stack([spline.cell**-order for order in range(3)])
    coefficients = coefficient_windows(spline.coefficients)[interval.astype(jnp.int32)]
    return jnp.einsum("otk,tka,o->toa", basis_values(share - interval), coefficients, scale)


def knot_coefficients(cell: ScalarLike) -> Float[Array, "3 3"]:
    """Return the matrix that converts position, velocity and acceleration at a knot to the three coefficients there.

    `cell` is the duration of an interval, s.
    """
    sixth = jnp.asarray(cell) ** 2 / 6.0
    unit = jnp.ones(())
    return jnp.stack(
        [
            jnp.stack([unit, side * cell, factor * sixth])
            for side, factor in ((-unit, 2.0), (0.0 * unit, -1.0), (unit, 2.0))
        ]
    )


@functools.cache
def mean_squares() -> Float[np.ndarray, "3 4 4"]:
    """Return matrices M for the mean squares of position, velocity and acceleration, over an interval of 1 s.

    The mean square is c^T M c, for the interval's four coefficients c of one axis.
    """
    basis = basis_values(np.asarray(_RULE.nodes))
    return np.einsum("ouk,oul,u->okl", basis, basis, np.asarray(_RULE.weights))


def wind_along(
    wind: AbstractWind, altitudes: Float[Array, " n"], climbs: Float[Array, " n"]
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Return the wind at altitudes (m), m/s, and its rate of change for climb rates `climbs` (m/s), m/s^2; both NED."""

    def wind_and_rate(altitude: Scalar, climb: Scalar) -> tuple[Array, Array]:
        def at(h: Scalar) -> Array:
            return wind.at(jnp.stack([jnp.zeros(()), jnp.zeros(()), -h]), 0.0)

        return jax.jvp(at, (altitude,), (climb,))

    return jax.vmap(wind_and_rate)(altitudes, climbs)


def _crossings(
    spline: Spline, edges: Float[Array, " layers"], intervals: int, max_count: int
) -> tuple[Float[Array, " crossings"], Float[Array, " crossings"]]:
    """Find the first `max_count` crossings of the altitudes of the wind layers (`edges`, m) by the spline.

    Returns the times, s, and the directions (1 climbing, -1 descending); for missing crossings, the duration and 0.
    """
    # Changes of side between neighbouring points of a time grid, refined by bisection.
    times = spline.duration * jnp.linspace(0.0, 1.0, intervals + 1)
    heights = -states_at(spline, times)[:, 0, 2]
    over = heights[:, None] > edges[None, :]
    crossed = (over[1:] != over[:-1]).ravel()
    crossing_indices = jnp.flatnonzero(crossed, size=max_count, fill_value=0)
    exists = jnp.arange(max_count) < jnp.sum(crossed)
    tick, edge = crossing_indices // edges.shape[0], edges[crossing_indices % edges.shape[0]]
    direction = jnp.where(over[tick + 1, crossing_indices % edges.shape[0]], 1.0, -1.0)

    def halve(_: int, span: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = span
        middle = 0.5 * (low + high)
        is_before = direction * (-states_at(spline, middle)[:, 0, 2] - edge) < 0.0
        return jnp.where(is_before, middle, low), jnp.where(is_before, high, middle)

    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, (times[tick], times[tick + 1]))
    return jnp.where(exists, 0.5 * (low + high), spline.duration), jnp.where(exists, direction, 0.0)


def _with_sides_at_ends(
    side: Float[Array, " knots"], spline: Spline, times: Float[Array, " knots"], edges: Float[Array, " layers"]
) -> Float[Array, " knots"]:
    """Return `side` with the values at the first and last knot set if these knots lie at the edge of a wind layer.

    At an edge, the rate of the wind jumps. The side of a knot selects the layer from which the rate is taken: 1 for the
    layer above the edge, -1 below.
    """
    for knot, ahead in ((0, 1.0), (-1, -1.0)):
        state = states_at(spline, times[knot : knot + 1 or None])[0, :2, 2]
        is_at_edge = jnp.any(jnp.abs(-state[0] - edges) < _LAYER_EDGE_M)
        side = side.at[knot].set(jnp.where(is_at_edge, -ahead * jnp.sign(state[1]), side[knot]))
    return side


def spline_path(
    start_time: ScalarLike,  # start time, s
    # trajectory over the ground, and the wind
    spline: Spline,
    wind: AbstractWind,
    intervals: int,  # number of equal intervals of the path, a multiple of the spline's
    knots: int,  # number of knots, at least `intervals` + 1 + 2 for each crossing of the edge of a wind layer
) -> TimedPath:
    """Convert a spline to a timed path in a wind.

    At the edge of a wind layer the path has two knots, because the rate of the wind jumps. Empty intervals at the end
    pad the path to `knots` knots.
    """
    times = spline.duration * jnp.linspace(0.0, 1.0, intervals + 1)
    max_crossings = (knots - intervals - 1) // 2
    side = jnp.zeros(intervals + 1)
    layers = wind_layers(wind)
    if isinstance(layers, LayeredWind):
        crossed, direction = _crossings(spline, layers.altitudes, intervals, max_crossings)
        # A crossing next to a knot moves to it: a cell of some 1e-14 s would have no acceleration to speak of.
        nearest = jnp.round(crossed * (intervals / spline.duration)).astype(jnp.int32)
        is_close = (jnp.abs(crossed - times[nearest]) < _CLOSE_S) & (direction != 0.0)
        crossed = jnp.where(is_close, times[nearest], crossed)
        side = side.at[jnp.where(is_close, nearest, intervals + 1)].set(-direction, mode="drop")
        side = _with_sides_at_ends(side, spline, times, layers.altitudes)
        times = jnp.concatenate([times, jnp.repeat(crossed, 2)])
        side = jnp.concatenate([side, jnp.stack([-direction, direction], axis=1).ravel()])
    order = jnp.argsort(times, stable=True)
    order = jnp.concatenate([order, jnp.repeat(order[-1:], knots - order.shape[0])])
    times, side = times[order], side[order]
    nodes, spans = jnp.asarray(_RULE.nodes), jnp.diff(times)
    within = states_at(spline, (times[:-1, None] + spans[:, None] * nodes[None, :]).ravel())
    winds, _ = wind_along(wind, -within[:, 0, 2], -within[:, 1, 2])
    weights = jnp.asarray(_RULE.weights)[None, :, None]
    drift_steps = spans[:, None] * jnp.sum(winds.reshape(-1, nodes.shape[0], 3) * weights, axis=1)
    drifts = jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(drift_steps, axis=0)])
    states = states_at(spline, times)
    wind_n, wind_rate_n = wind_along(wind, -states[:, 0, 2] + _LAYER_EDGE_M * side, -states[:, 1, 2])
    drift = jnp.stack([drifts, wind_n, wind_rate_n], axis=1)
    return TimedPath(start_time + times, states - drift, drift)


GROUP = 4
"""Number of coefficients that form one block of the normal equations; divides the number of intervals of a spline."""
_PAIRS = tuple((i, j) for i in range(4) for j in range(i, 4))  # pairs of an interval's four coefficients
_SAMPLE_POINTS = np.array([0.25, 0.5, 0.75, 1.0])  # of each interval; the start is fixed
_SPEED, _FORCE, _ALONG, _CLIMB, _HEIGHT_M, _INSIDE_M = 5.0, 1.0, 0.3, 2.0, 50.0, 200.0
"""Violations of equal weight: airspeed, m/s; force across and along the path, m/s^2; climb rate, m/s; altitude, m;
depth inside a keep-out, m."""
_STEP_M, _STEP_SPEED, _STEP_ACCELERATION = 3000.0, 30.0, 3.0
"""Changes of position (m), velocity (m/s) and acceleration (m/s^2) that make a step of size 1."""
_CLIMB_FRACTION = 0.998
_VIOLATION_FACTOR, _TIGHTENING_MIN = 1.3, 0.5
_PUSH_OVER_MAX = 0.95  # greatest tightened least load factor
_SPEED_RESERVE, _SPEED_FRACTION = 0.15, 0.1  # m/s, but at most this fraction of the range
_RESERVE_M, _RESERVE_UP_M = 30.0, 10.0
_UP_WEIGHT = 3.0  # cost of one metre of vertical escape from a keep-out, in metres of lateral escape
_ANY_LOAD, _ANY_SPEED = 1e3, 1e4
_LEVEL_MIN = 1.0  # m/s


class SplineProblem(NamedTuple):
    """Problem of a spline search: task and airspace of one aircraft, and the time from start to arrival, s."""

    task: AircraftTask
    airspace: Airspace
    duration: Scalar


class TightenedLimits(NamedTuple):
    """Limits of a spline search, SI units: the aircraft's limits with a margin for the times between sample points."""

    speed_min: Scalar
    speed_max: Scalar
    bank: Scalar  # tangent of the bank angle
    # load factor, greatest and least
    load_factor: Scalar
    load_factor_min: Scalar
    climb_rate: Scalar
    # along the path
    acceleration: Scalar
    deceleration: Scalar


class SplineStart(NamedTuple):
    """Initial spline of a search, the allowed changes of its arrival velocity, and the limits of the search."""

    # spline with the prescribed motion at start and rendezvous: (coefficient, axis)
    coefficients: Float[Array, "coefficients 3"]
    # columns: unit vectors of the allowed changes of the velocity at the arrival, NED; columns of 0 allow no change
    frame: Float[Array, "3 3"]
    allowed: TightenedLimits  # limits of the search


class NormalEquations(NamedTuple):
    """Cost, gradient and Gauss-Newton matrix of a least-squares problem; the unknowns are in groups of equal size."""

    cost: Scalar  # half the sum of squares
    gradient: Float[Array, "groups n"]  # gradient of the cost
    form: BlockTridiagonal  # Gauss-Newton matrix


def initial_limits(problem: SplineProblem, fraction: Scalar) -> TightenedLimits:
    """Return the limits at the start of a search: `fraction` times the limits of bank, load factor and accelerations.

    The limits of airspeed and climb rate are slightly narrower than the aircraft's limits. A negative limit of
    acceleration is lowered, too (see `reduced_limit`).
    """
    limits = problem.task.limits
    highest = jnp.minimum(limits.speed_max, _ANY_SPEED)
    reserve = jnp.minimum(_SPEED_RESERVE, _SPEED_FRACTION * (highest - limits.speed_min))
    return TightenedLimits(
        limits.speed_min + reserve,
        highest - reserve,
        fraction * jnp.tan(limits.bank_max),
        fraction * jnp.minimum(limits.load_factor_max, _ANY_LOAD),
        1.0 - fraction * (1.0 - jnp.maximum(limits.load_factor_min, -_ANY_LOAD)),
        _CLIMB_FRACTION * limits.climb_rate_max,
        reduced_limit(limits.acceleration_max, fraction),
        fraction * limits.deceleration_max,
    )


def tighten_limits(problem: SplineProblem, allowed: TightenedLimits, over: Float[Array, "10"]) -> TightenedLimits:
    """Return the limits of a search, tightened because the path violated the aircraft's limits between sample points.

    Each limit changes by the violation times a safety factor. `over` is the relative excess over each of the aircraft's
    limits (0.1 is 10 %), in the order of `CERTIFIED_LIMITS`.
    """
    limits = problem.task.limits
    fields = (limit.field for limit in CERTIFIED_LIMITS)
    violated: dict[str, Scalar] = dict(zip(fields, _VIOLATION_FACTOR * jnp.maximum(over, 0.0), strict=True))
    middle = 0.5 * (limits.speed_min + jnp.minimum(limits.speed_max, _ANY_SPEED))
    low = allowed.speed_min + violated["speed_min"] * limits.speed_min
    high = allowed.speed_max - violated["speed_max"] * jnp.minimum(limits.speed_max, _ANY_SPEED)

    reduced = {
        name: reduced_limit(getattr(allowed, name), jnp.maximum(1.0 - violated[f"{name}_max"], _TIGHTENING_MIN))
        for name in ("bank", "load_factor", "climb_rate", "acceleration", "deceleration")
    }
    # A violation of the least load factor is relative to 1.
    push_over = jnp.minimum(allowed.load_factor_min + violated["load_factor_min"], _PUSH_OVER_MAX)
    return TightenedLimits(jnp.minimum(low, middle), jnp.maximum(high, middle), load_factor_min=push_over, **reduced)


def initial_state_n(problem: SplineProblem) -> Float[Array, "3 3"]:
    """Return position, velocity and acceleration over the ground at the start: (order of derivative, axis), NED, SI."""
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
) -> Float[Array, "6"]:
    """Return the violations of the flight limits at one sample point, in units of equal weight; 0 if satisfied.

    `altitude` in m, `velocity` and `acceleration` over the ground, NED, m/s and m/s^2. In order: airspeed, bank angle,
    load factor, force along the path, climb rate, altitude.
    """
    limits, gravity = problem.task.limits, problem.airspace.gravity
    (wind,), _ = wind_along(problem.airspace.wind, altitude[None], jnp.ones(1))
    required = demand(velocity - wind, acceleration, gravity, _LEVEL_MIN)
    limits_along = eqx.tree_at(acceleration_limits, limits, (allowed.acceleration, allowed.deceleration))
    bank_excess, load_excess, along_excess = required.excess(
        allowed.bank,
        allowed.load_factor * gravity,
        allowed.load_factor_min * gravity,
        *limits_along.along(required.speed, required.smooth_normal / gravity),
    )
    low, high = limits.altitude_min + _RESERVE_UP_M, limits.altitude_max - _RESERVE_UP_M
    violations = [
        jnp.maximum(allowed.speed_min - required.speed, required.speed - allowed.speed_max) / _SPEED,
        bank_excess / _FORCE,
        load_excess / _FORCE,
        along_excess / _ALONG,
        (jnp.abs(velocity[2] - wind[2]) - allowed.climb_rate) / _CLIMB,
        jnp.maximum(low - altitude, altitude - high) / _HEIGHT_M,
    ]
    return jnp.maximum(jnp.stack(violations), 0.0)


def _keep_out_penetration(problem: SplineProblem, time: Scalar, position: Float[Array, "3"]) -> Scalar:
    """Return the depth of a position (NED, m) inside a keep-out, in units of 200 m; the sum over all keep-outs.

    The keep-outs are enlarged by a margin. The depth is the horizontal distance to the outside, or three times the
    vertical distance if less.
    """
    limits, volumes = problem.task.limits, problem.airspace.keep_outs
    altitude = -position[2]
    offset = position[None, :2] - volumes.position_n - time * volumes.velocity_n
    radial_depth = volumes.radius + _RESERVE_M - jnp.sqrt(jnp.sum(offset**2, axis=1) + 1.0)
    depth_below, depth_above = altitude - volumes.bottom + _RESERVE_UP_M, volumes.top + _RESERVE_UP_M - altitude
    # An escape below the floor or above the ceiling is not allowed.
    depth_below = jnp.where(volumes.bottom > limits.altitude_min + 50.0, _UP_WEIGHT * depth_below, jnp.inf)
    depth_above = jnp.where(volumes.top < limits.altitude_max - 50.0, _UP_WEIGHT * depth_above, jnp.inf)
    depths = jnp.minimum(radial_depth, jnp.minimum(depth_below, depth_above))
    return jnp.sum(jnp.maximum(depths, 0.0)) / _INSIDE_M


def _violations(
    problem: SplineProblem, allowed: TightenedLimits, time: Scalar, state: Float[Array, "3 3"]
) -> Float[Array, " violations"]:
    """Return the violations of flight limits and keep-outs at one sample point, in units of equal weight.

    `time` in s after the start; `state` has the rows position, velocity and acceleration over the ground, NED, SI.
    """
    violations = _limit_violations(problem, allowed, -state[0, 2], state[1], state[2])
    if problem.airspace.keep_outs.radius.shape[0]:
        violations = jnp.append(violations, _keep_out_penetration(problem, time, state[0]))
    return violations


def update_coefficients(
    start: SplineStart, cell: Scalar, unknowns: Float[Array, "groups 12"]
) -> Float[Array, "coefficients 3"]:
    """Return the spline coefficients (m) for the unknowns: changes of inner coefficients and of the arrival's motion.

    A group of unknowns has the changes of four coefficients. The last group has the change of one coefficient, three
    numbers without effect, and the changes of velocity and acceleration at the arrival. `cell` in s.
    """
    changes = unknowns.reshape(-1, 3)
    inner, (_, velocity, acceleration) = changes[:-3], changes[-3:]
    last_change = knot_coefficients(cell)[:, 1:] @ jnp.stack([start.frame @ velocity, acceleration])
    return start.coefficients + jnp.concatenate([jnp.zeros((3, 3)), inner, last_change])


def _end_jacobian(start: SplineStart, cell: Scalar) -> Float[Array, "12 12"]:
    """Return the derivative of the last group of coefficients with respect to the last group of unknowns."""
    slopes = knot_coefficients(cell)
    by_velocity = slopes[:, 1, None, None] * start.frame[None, :, :]
    by_acceleration = slopes[:, 2, None, None] * jnp.eye(3)[None, :, :]
    last_block = jnp.stack([jnp.zeros((3, 3, 3)), by_velocity, by_acceleration], axis=2).reshape(9, 9)
    return jax.scipy.linalg.block_diag(jnp.eye(3), last_block)


def _sum_into_groups(cell_forms: Float[Array, "pairs 3 3 cells"]) -> BlockTridiagonal:
    """Sum the intervals' quadratic forms into blocks of `GROUP` coefficients, without the first three, fixed ones.

    The form of an interval has a 3 by 3 block for each pair of its four coefficients, in the order of `_PAIRS`.
    """
    # bands[d] has the blocks of each coefficient (row) with the d-th coefficient after it (column)
    bands = jnp.stack(
        [
            functools.reduce(
                jnp.add, [_shifted(block, i) for block, (i, j) in zip(cell_forms, _PAIRS, strict=True) if j - i == d]
            )
            for d in range(GROUP)
        ]
    )
    upper = bands.reshape(GROUP, 3, 3, -1, GROUP)  # (d, axis, axis, group, coefficient in the group)
    lower = jnp.swapaxes(upper, 1, 2)
    zeros = jnp.zeros_like(upper[0, ..., 0])
    columns = range(GROUP)
    diagonal = [[upper[j - i, ..., i] if i <= j else lower[i - j, ..., j] for j in columns] for i in columns]
    subdiagonal = [[lower[GROUP + i - j, ..., j] if i < j else zeros for j in columns] for i in columns]

    def flatten(blocks: list[list[Array]]) -> Array:
        stacked = jnp.stack([jnp.stack(row) for row in blocks])
        return jnp.transpose(stacked, (4, 0, 2, 1, 3)).reshape(-1, 3 * GROUP, 3 * GROUP)

    return BlockTridiagonal(flatten(diagonal), jnp.roll(flatten(subdiagonal), 1, axis=0))


def _shifted(cell_values: Float[Array, "*axes cells"], k: int) -> Float[Array, "*axes coefficients"]:
    """Assign the values of the intervals to each interval's coefficient k; without the first three coefficients."""
    return jnp.pad(cell_values, [(0, 0)] * (cell_values.ndim - 1) + [(k, 3 - k)])[..., 3:]


def _in_unknowns(form: BlockTridiagonal, end_jacobian: Float[Array, "12 12"]) -> BlockTridiagonal:
    """Convert a quadratic form of the coefficients to a form of the unknowns.

    Only the last group differs; its derivative by the unknowns is `end_jacobian`.
    """
    diagonal = form.diagonal.at[-1].set(end_jacobian.T @ form.diagonal[-1] @ end_jacobian)
    return BlockTridiagonal(diagonal, form.subdiagonal.at[-1].set(end_jacobian.T @ form.subdiagonal[-1]))


def arrives_forward(start: SplineStart, velocity_n: Float[Array, "3"]) -> Flag:
    """Return whether the velocity at the arrival points along the prescribed course; True if the course is free."""
    is_free = jnp.all(jnp.any(start.frame != 0.0, axis=0))
    return is_free | (start.frame[:2, 0] @ velocity_n[:2] > 0.0)


def step_metric(problem: SplineProblem, start: SplineStart) -> BlockTridiagonal:
    """Return the quadratic form that measures the size of a step of the unknowns, for the damping.

    The form is the mean square over time of the changes of position, velocity and acceleration, each over a reference
    change (`_STEP_M`, `_STEP_SPEED`, `_STEP_ACCELERATION`). Unknowns without effect get a diagonal of 1.
    """
    cells = start.coefficients.shape[0] - 3
    cell = problem.duration / cells
    position, velocity, acceleration = (jnp.asarray(squares) / cells for squares in mean_squares())
    cell_form = (
        position / _STEP_M**2
        + velocity / (_STEP_SPEED * cell) ** 2
        + acceleration / (_STEP_ACCELERATION * cell**2) ** 2
    )
    end_jacobian = _end_jacobian(start, cell)
    cell_forms = jnp.stack([cell_form[pair] * jnp.eye(3) for pair in _PAIRS])
    size = _in_unknowns(_sum_into_groups(jnp.tile(cell_forms[..., None], cells)), end_jacobian)
    inactive = jnp.where(jnp.any(end_jacobian != 0.0, axis=0), 0.0, 1.0)
    return size._replace(diagonal=size.diagonal.at[-1].add(jnp.diag(inactive)))


def normal_equations(
    problem: SplineProblem, start: SplineStart, unknowns: Float[Array, "groups 12"]
) -> NormalEquations:
    """Build the normal equations for the violations of a spline at the four sample points of each interval."""
    # Samples are on the last axis of all arrays, which the processor's vector instructions traverse.
    cells, points = start.coefficients.shape[0] - 3, jnp.asarray(_SAMPLE_POINTS)
    cell = problem.duration / cells
    windows = coefficient_windows(update_coefficients(start, cell, unknowns))
    basis = jnp.stack([jnp.asarray(values) / cell**k for k, values in enumerate(basis_values(_SAMPLE_POINTS))])
    states = jnp.einsum("ouk,nka->oaun", basis, windows).reshape(3, 3, -1)
    times = (cell * (jnp.arange(cells)[None, :] + points[:, None])).ravel()
    violations_at = functools.partial(_violations, problem, start.allowed)
    violations_of = jax.vmap(violations_at, in_axes=(0, -1), out_axes=-1)
    unit_changes = jnp.tile(jnp.eye(9).reshape(9, 3, 3, 1), times.shape[0])
    violations, by_state = jax.vmap(
        lambda change: jax.jvp(lambda at: violations_of(times, at), (states,), (change,)), out_axes=(None, 0)
    )(unit_changes)
    rows = range(violations.shape[0])
    gradients = functools.reduce(jnp.add, [violations[None, r] * by_state[:, r] for r in rows])
    squares = functools.reduce(jnp.add, [by_state[:, None, r] * by_state[None, :, r] for r in rows])
    by_coefficient = jnp.einsum("ouk,oaun->kan", basis, gradients.reshape(3, 3, points.size, cells))
    products = jnp.stack([basis[:, None, :, i] * basis[None, :, :, j] for i, j in _PAIRS])
    form = jnp.einsum("poqu,oaqbun->pabn", products, squares.reshape(3, 3, 3, 3, points.size, cells))
    gradient = functools.reduce(jnp.add, [_shifted(by_coefficient[k], k) for k in range(4)])
    gradient = gradient.T.reshape(cells // GROUP, 3 * GROUP)
    end_jacobian = _end_jacobian(start, cell)
    gradient = gradient.at[-1].set(end_jacobian.T @ gradient[-1])
    return NormalEquations(0.5 * jnp.sum(violations**2), gradient, _in_unknowns(_sum_into_groups(form), end_jacobian))
