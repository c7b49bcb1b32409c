"""Violations of limits by a spline, and how they change with it: the equations of its least-squares problem.

A spline over the ground begins as its aircraft does and ends at the rendezvous, whatever its unknowns.
Its violations at an instant depend on four coefficients only: normal equations are summed up interval by interval.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.tridiagonal import BlockTridiagonal
from anser.planning.certified.spline import Spline, bases, end_slopes, mean_squares, states, wind_along
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.demand import demand
from anser.planning.limits import CERTIFIED_LIMITS, accelerations_of
from anser.shapes import Flag, Scalar

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


def tightened(problem: SplineProblem, allowed: TightenedLimits, over: Float[Array, "9"]) -> TightenedLimits:
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


def first_state(problem: SplineProblem) -> Float[Array, "3 3"]:
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
    held_to = eqx.tree_at(accelerations_of, limits, (allowed.acceleration, allowed.deceleration))
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


def updated(begin: SplineStart, cell: Scalar, unknowns: Float[Array, "groups 12"]) -> Float[Array, "coefficients 3"]:
    """Coefficients after a change: of those between both ends, and of the last velocity and acceleration."""
    changes = unknowns.reshape(-1, 3)
    inner, (_, velocity, acceleration) = changes[:-3], changes[-3:]
    last = end_slopes(cell)[:, 1:] @ jnp.stack([begin.frame @ velocity, acceleration])
    return begin.coefficients + jnp.concatenate([jnp.zeros((3, 3)), inner, last])


def _last_slopes(begin: SplineStart, cell: Scalar) -> Float[Array, "12 12"]:
    """How the last group of coefficients follows from the last unknowns."""
    slopes = end_slopes(cell)
    by_velocity = slopes[:, 1, None, None] * begin.frame[None, :, :]
    by_acceleration = slopes[:, 2, None, None] * jnp.eye(3)[None, :, :]
    last = jnp.stack([jnp.zeros((3, 3, 3)), by_velocity, by_acceleration], axis=2).reshape(9, 9)
    return jax.scipy.linalg.block_diag(jnp.eye(3), last)


def _grouped(each: Float[Array, "cells 4 4 a b"]) -> BlockTridiagonal:
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


def _ended(form: BlockTridiagonal, last: Float[Array, "12 12"]) -> BlockTridiagonal:
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
    last = _last_slopes(begin, cell)
    every = one[None, :, :, None, None] * jnp.eye(3)[None, None, None]
    size = _ended(_grouped(jnp.tile(every, (cells, 1, 1, 1, 1))), last)
    idle = jnp.where(jnp.any(last != 0.0, axis=0), 0.0, 1.0)
    return size._replace(diagonal=size.diagonal.at[-1].add(jnp.diag(idle)))


def normal_equations(
    problem: SplineProblem, begin: SplineStart, unknowns: Float[Array, "groups 12"]
) -> NormalEquations:
    """Normal equations of all that a spline violates, at a few instants of each interval."""
    cells = begin.coefficients.shape[0] - 3
    spline = Spline(problem.duration, updated(begin, problem.duration / cells, unknowns))
    cell = spline.cell
    now = states(spline, _SAMPLE_POINTS)
    times = cell * (jnp.arange(cells)[:, None] + jnp.asarray(_SAMPLE_POINTS)[None, :])
    one = functools.partial(_violations, problem, begin.allowed)
    violations = jax.vmap(jax.vmap(one))(times, now)
    by_state = jax.vmap(jax.vmap(jax.jacfwd(one, argnums=1)))(times, now)
    scaled = jnp.stack([jnp.asarray(of_order) / cell**k for k, of_order in enumerate(bases(_SAMPLE_POINTS))])
    by_window = jnp.einsum("nuroa,ouk->nurka", by_state, scaled).reshape(cells, -1, 12)
    gradients = jnp.einsum("nr,nrj->nj", violations.reshape(cells, -1), by_window).reshape(cells, 4, 3)
    squares = jnp.einsum("nri,nrj->nij", by_window, by_window).reshape(cells, 4, 3, 4, 3)
    form = _grouped(jnp.swapaxes(squares, 2, 3))
    gradient = functools.reduce(jnp.add, (jnp.pad(gradients[:, k], ((k, 3 - k), (0, 0))) for k in range(4)))
    gradient = gradient[3:].reshape(cells // GROUP, 3 * GROUP)
    last = _last_slopes(begin, cell)
    gradient = gradient.at[-1].set(last.T @ gradient[-1])
    return NormalEquations(0.5 * jnp.sum(violations**2), gradient, _ended(form, last))
