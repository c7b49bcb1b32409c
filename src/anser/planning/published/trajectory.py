"""Trajectories of the published planner: Hermite cubics with two bends, in a frame that drifts with steady wind."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.numerics.integration import GAUSS_LEGENDRE_16, NEWTON_COTES_6, QuadratureRule, integrate
from anser.numerics.roots import bracketed_newton
from anser.parts.paths import AbstractReference, PathPoint
from anser.planning.published.time_law import (
    BRAKING_RESERVE_M_S2,
    CELLS,
    Clock,
    TimeLaw,
    even_law,
    path_derivatives,
    published_law,
)
from anser.shapes import Flag, Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm

# s^2 (1 - s)^2 in ascending powers of s: the only quartic with zero value and slope at both ends.
BEND_COEFFICIENTS = (0.0, 0.0, 1.0, -2.0, 1.0)
_DISTANCE_MIN = 1e-6  # m, horizontal: shorter lines have no usable direction


class Trajectory(AbstractReference):
    """Planned position of one aircraft over time, in steady wind.

    The path is a polynomial in s, from 0 to 1, in a frame that drifts with the wind and coincides with the ground frame
    at `start_time`; `law` maps time to s. Source: theory section 6.
    """

    start_time: Scalar  # start of the path, s
    duration: Scalar  # time from start to rendezvous, s; positive
    coefficients_n: Float[Array, "3 5"]  # coefficients of the path for ascending powers of s, one row per NED axis, m
    wind_n: Vector3  # velocity of the air over the ground, NED, m/s
    lateral_n: Vector3  # horizontal unit vector along which lateral bends act, NED
    law: TimeLaw  # time law: path parameter s as a function of time

    def clock(self, time: ScalarLike) -> Clock:
        """Return the path parameter s (0 start, 1 rendezvous) and its rates (1/s, 1/s^2) at a time (s)."""
        return self.law.clock(self.coefficients_n, time - self.start_time, self.duration)

    def at(self, time: ScalarLike) -> PathPoint:
        """Return position, velocity and acceleration over the ground at a time (s); NED, m, m/s, m/s^2."""
        clock = self.clock(time)
        position_n, slope_n, bend_n = path_derivatives(self.coefficients_n, clock.s[None], (0, 1, 2))[..., 0]
        return PathPoint(
            position_n=position_n + self.wind_n * (time - self.start_time),
            velocity_n=slope_n * clock.s_dot + self.wind_n,
            acceleration_n=bend_n * clock.s_dot**2 + slope_n * clock.s_ddot,
        )

    def air_velocity_n(self, time: ScalarLike) -> Vector3:
        """Return the velocity relative to the air at a time (s), NED, m/s."""
        clock = self.clock(time)
        return path_derivatives(self.coefficients_n, clock.s[None], (1,))[0, :, 0] * clock.s_dot


def lateral_direction_n(line_n: Vector3, velocity_0_n: Vector3) -> Vector3:
    """Return the horizontal unit vector, NED, to the right of the line from start to rendezvous, `line_n` (m).

    If the line is vertical, the start velocity `velocity_0_n` (m/s) replaces the line. If the start velocity is
    vertical too, the result is east.
    """
    direction = line_n[:2]
    for replacement in (velocity_0_n[:2], jnp.array([1.0, 0.0])):
        direction = jnp.where(norm(direction) > _DISTANCE_MIN, direction, replacement)
    direction = direction / norm(direction)
    return jnp.stack([-direction[1], direction[0], jnp.zeros_like(direction[0])])


def bend_trajectory(trajectory: Trajectory, lateral_bend: ScalarLike, vertical_bend: ScalarLike = 0.0) -> Trajectory:
    """Return a trajectory with a lateral and an upward bend (m) added; both ends keep their positions and directions.

    A bend is the coefficient of s^4, for the path parameter s from 0 to 1; the middle of the path moves by a sixteenth
    of the bend, along `lateral_n` or upwards. In the theory, the lateral bend is kappa = b_4 duration^4, and the upward
    bend c_4 duration^4. The result has the same duration, and the published time law.
    """
    shift = lateral_bend * trajectory.lateral_n - vertical_bend * jnp.array([0.0, 0.0, 1.0])
    coefficients = trajectory.coefficients_n + shift[:, None] * jnp.array(BEND_COEFFICIENTS)[None, :]
    return eqx.tree_at(lambda path: (path.coefficients_n, path.law), trajectory, (coefficients, published_law()))


def with_even_speed(
    trajectory: Trajectory,
    speed_0: ScalarLike,
    deceleration: ScalarLike | None = None,
    exchange: ScalarLike | None = None,
    even: Flag | bool = True,
) -> Trajectory:
    """Return the trajectory flown with an evenly changing airspeed, which is `speed_0` (m/s) at the start.

    The other arguments are those of `even_law`. Path, start time and duration are unchanged.
    """
    law = even_law(trajectory.coefficients_n, trajectory.duration, speed_0, deceleration, exchange, even)
    return eqx.tree_at(lambda path: path.law, trajectory, law)


def fit_trajectory(
    # s; the duration must be positive
    start_time: ScalarLike,
    duration: ScalarLike,
    position_0: Vector3,  # start, NED, m
    velocity_0: Vector3,  # velocity relative to the air at the start, NED, m/s
    # rendezvous in the frame that drifts with the air (position over the ground minus wind times duration), NED, m
    position_f: Vector3,
    velocity_f: Vector3,  # velocity relative to the air at the rendezvous, NED, m/s
    # bends, m, see `bend_trajectory`; zero is the nominal path
    lateral_bend: ScalarLike = 0.0,
    vertical_bend: ScalarLike = 0.0,
    wind_n: Vector3 | None = None,  # steady wind, NED, m/s; None: still air
    # lateral bends act to the right of this line, NED, m; None: line from start to rendezvous. In flight: line of
    # the first plan, because with another line the rest of a bent path cannot be fitted
    line_n: Vector3 | None = None,
) -> Trajectory:
    """Return the trajectory with the required positions and velocities at both ends, plus the bends.

    The path parameter is linear in time (published time law).

    Notes
    -----
    Theory section 6, with time scaled to [0, 1]. The four lower coefficients are the Hermite cubic; bends are multiples
    of s^2 (1 - s)^2, the null space of the boundary conditions.
    """
    duration = jnp.asarray(duration, dtype=float)
    line, slope_0, slope_f = position_f - position_0, duration * velocity_0, duration * velocity_f
    cubic = [position_0, slope_0, 3.0 * line - 2.0 * slope_0 - slope_f, slope_0 + slope_f - 2.0 * line]
    nominal = Trajectory(
        jnp.asarray(start_time, dtype=float),
        duration,
        jnp.stack([*cubic, jnp.zeros(3)], axis=1),
        jnp.zeros(3) if wind_n is None else wind_n,
        lateral_direction_n(line if line_n is None else line_n, velocity_0),
        published_law(),
    )
    return bend_trajectory(nominal, lateral_bend, vertical_bend)


def arc_length(
    trajectory: Trajectory, start_phase: ScalarLike = 0.0, rule: QuadratureRule = GAUSS_LEGENDRE_16
) -> Scalar:
    """Return the length of the path through the air, m, from the path parameter `start_phase` (0..1) to the rendezvous.

    If `start_phase` is `trajectory.clock(t).s`, the result is the remaining length at time t.
    """

    def path_speed(phases: Float[Array, " nodes"]) -> Float[Array, " nodes"]:
        return norm(path_derivatives(trajectory.coefficients_n, phases, (1,))[0], axis=0)

    return integrate(path_speed, jnp.asarray(start_phase, dtype=float), 1.0, rule)


def arc_length_estimate(trajectory: Trajectory, start_phase: ScalarLike = 0.0) -> Scalar:
    """Return the length (m) of the path through the air from the path parameter `start_phase` (0..1) to the end.

    The quadrature is the published one, the closed six-point Newton-Cotes rule (theory section 6; section 9, item 1).
    """
    return arc_length(trajectory, start_phase, NEWTON_COTES_6)


_SPEED_SHARE_MIN = 0.3  # least airspeed with idle engine, fraction of the initial speed


def slowest_mean_speed(path: Trajectory, speed_0: ScalarLike, deceleration: ScalarLike) -> Scalar:
    """Return the least mean airspeed, m/s, at which an aircraft can fly a path: with the engine idle all the way.

    The airspeed V over the length l follows from V dV/dl = g (-dh/dl) - a, with the altitude h. Here a is
    `deceleration` (m/s^2, engine idle in level flight) minus `BRAKING_RESERVE_M_S2`. V is at least 0.3 of the initial
    airspeed `speed_0` (m/s). The result does not depend on the time law.
    """
    edges = np.linspace(0.0, 1.0, CELLS + 1)
    middles = jnp.asarray(0.5 * (edges[1:] + edges[:-1]))
    segments = norm(path_derivatives(path.coefficients_n, middles, (1,))[0], axis=0) / CELLS
    down = path_derivatives(path.coefficients_n, jnp.asarray(edges), (0,))[0, 2]
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(segments)])
    braking_work = (deceleration - BRAKING_RESERVE_M_S2) * lengths
    square = speed_0**2 + 2 * (STANDARD_GRAVITY_M_S2 * (down - down[0]) - braking_work)
    speeds = jnp.sqrt(jnp.maximum(square, (_SPEED_SHARE_MIN * speed_0) ** 2))
    return lengths[-1] / jnp.sum(2 * segments / (speeds[1:] + speeds[:-1]))


# 20,000 random paths with 1 + 1e-9 to 2 times the nominal length needed at most 16 steps from any guess in the bracket.
BEND_STEPS = 24
# Relative tolerance of the length: a micrometre in ten kilometres, a hundred times rounding.
LENGTH_TOLERANCE = 1e-10
# Integral over [0, 1] of the square of the slope of s^2 (1 - s)^2.
_BEND_SLOPE_SQUARE = 2.0 / 105.0


class Bend(eqx.Module):
    """Sideways shift of a path that gives the path a required length, from `solve_lateral_bend`."""

    kappa: Scalar  # 16 times the sideways shift of the path's middle (see `bend_trajectory`), m, right positive
    converged: Flag  # whether the path with this bend has the required length


def bend_slope(phase: np.ndarray) -> np.ndarray:
    """Return the derivative of the bend's shape s^2 (1 - s)^2 with respect to s, at `phase` = s (0..1)."""
    return 2.0 * phase * (1.0 - phase) * (1.0 - 2.0 * phase)


def _length_excess(
    size: Scalar, data: tuple[Float[Array, "nodes 3"], Float[Array, "nodes 3"], Float[Array, " nodes"], Scalar]
) -> tuple[Scalar, Scalar]:
    """Return the length of a path with a bend of `size` (m) minus the required length, m, and the derivative by `size`.

    `data` has four entries. At the nodes of the quadrature rule: slope dr/ds (m) of the path without bend, slope of a
    bend of 1 m, and weights. The last entry is the required length (m).
    """
    straight, sideways, weights, required_length = data
    tangent = straight + size * sideways
    square = jnp.sum(tangent * tangent, axis=1)
    speed = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
    slope = jnp.sum(tangent * sideways, axis=1) / speed
    return jnp.sum(weights * jnp.where(square > 0.0, speed, 0.0)) - required_length, jnp.sum(weights * slope)


def solve_lateral_bend(
    nominal: Trajectory,  # the trajectory without bend
    # required length of the air path, m. At the nominal length, the bend is exactly zero. If the required length is
    # less, no solution exists: the bend is zero and `converged` is false
    length_ref: ScalarLike,
    side: ScalarLike,  # positive: bend to the right; negative: to the left
    guess: ScalarLike | None = None,  # initial bend, m, either sign; None: computed
    rule: QuadratureRule = GAUSS_LEGENDRE_16,
) -> Bend:
    """Find the lateral bend, m, with which a path has the length `length_ref` (m).

    Notes
    -----
    The length L of the path with the bend kappa is convex, as the integral of the norm of an affine function of kappa:
    if L(0) <= length_ref, there is one root on each side. A lower bound of L brackets the root: |kappa| times the
    integral of the slope's magnitude for a bend of 1 m, minus L(0) (theory section 6). Derivatives of the bend are
    implicit, and zero for a bend fixed at zero.
    """
    nodes, weights = jnp.asarray(rule.nodes), jnp.asarray(rule.weights)
    powers = jnp.arange(1, 5)
    basis = powers[None, :] * nodes[:, None] ** (powers[None, :] - 1)
    straight = jnp.sum(basis[:, None, :] * nominal.coefficients_n[None, :, 1:], axis=2)
    sign = jnp.where(jnp.asarray(side) < 0, -1.0, 1.0)
    slopes = bend_slope(rule.nodes)
    sideways = jnp.asarray(slopes)[:, None] * (sign * nominal.lateral_n)[None, :]

    length_ref = jnp.asarray(length_ref, dtype=float)
    data = (straight, sideways, weights, length_ref)
    excess = -_length_excess(jnp.zeros(()), data)[0]
    tolerance = LENGTH_TOLERANCE * length_ref
    # Within rounding of the nominal length, the bend is zero, because the implicit derivative would be infinite.
    longer = excess > 1e-3 * tolerance
    nominal_length = length_ref - excess
    high = 1.000001 * (length_ref + nominal_length) / float(np.sum(rule.weights * np.abs(slopes)))
    if guess is None:
        # Exact to leading order, for a straight path of steady speed: L - L(0) = kappa^2 (2/105)/(2 L(0)).
        square = jnp.where(longer, excess * (length_ref + nominal_length), 0.0) / _BEND_SLOPE_SQUARE
        guess = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
    # An unsolvable length is replaced by a solvable one, for finite gradients.
    solvable = (straight, sideways, weights, jnp.where(longer, length_ref, 1.1 * nominal_length + 1.0))
    high = jnp.where(longer, high, 20.0 * nominal_length + 20.0)
    root = bracketed_newton(_length_excess, solvable, 0.0, high, jnp.abs(guess), BEND_STEPS)
    converged = jnp.where(longer, jnp.abs(root.residual) <= tolerance, excess >= -tolerance)
    return Bend(jnp.where(longer, sign * root.x, 0.0), converged)
