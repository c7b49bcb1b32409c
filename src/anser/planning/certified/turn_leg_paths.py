"""Turn-and-leg paths of a target length: four turns of any sense and radius and three legs, solved simultaneously.

These candidates have shapes that detours lack: three consecutive turns, loops, wide turns, paths around keep-outs. Four
equations (end position, end heading, length) and one per keep-out contain eleven unknowns. Damped Gauss-Newton steps of
minimum norm start from many random guesses.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from anser.numerics import least_squares
from anser.planning.certified.detours import FULL_TURN
from anser.planning.certified.profile import CURVATURE_FRACTION, TabulatedProfile
from anser.planning.certified.routes import (
    LEGS,
    TURNS,
    PathEndpoints,
    TurnsAndLegs,
    displacement,
    roll_out,
    smooth_turn,
    turn_limits,
)
from anser.planning.certified.task import KeepOuts
from anser.planning.demand import side_force_max
from anser.planning.limits import PathLimits
from anser.shapes import Integer, Scalar, ScalarLike

_FIRST_STEPS, _STEPS = 10, 24
_DAMPING = least_squares.Damping(lambda _: jnp.asarray(1e-4), 0.1, 20.0, 1e-14, 1e6)
_LONGEST_STEP = 0.7  # norm of the unknowns: square roots of radians and of leg / length
_RESIDUAL_TOLERANCE = 1e-10  # miss distance relative to the path's length; heading, rad
_TURN_MAX = 7.5  # rad, in addition to full circles
_UNKNOWNS = 2 * TURNS + LEGS
_RESERVE_M, _RESERVE_UP_M = 30.0, 5.0  # margins to keep-outs
_VOLUME_WEIGHT = 0.1
_RADIUS_ROUNDS = 4
_LEG_FRACTIONS = (0.0, 0.2, 0.4, 0.6, 0.8)  # points of a leg checked against keep-outs
Unknowns = Float[Array, "11"]
Spot = Float[Array, "3"]
"""Point of a path: north, east, and length along the path up to this point, m."""


def _grid_index(length: Scalar, step: Scalar, count: int) -> tuple[Integer, Scalar]:
    """Return the index of the grid point before a length (m), and the fraction of a step beyond this point.

    The grid has `count` points from zero, with the spacing `step` (m). A length outside the grid is limited to its
    ends; the index is at most count - 2.
    """
    grid_position = jnp.clip(length / step, 0.0, count - 1.0)
    k = jnp.minimum(grid_position.astype(jnp.int32), count - 2)
    return k, grid_position - k


class RadiusSchedule(eqx.Module):
    """Least turn radius that the limits allow, tabulated over the length along a path."""

    step: Scalar  # spacing of the table, m
    scales: Float[Array, " intervals"]  # radius in units of 1 / `PathEndpoints.curvature_max`

    def least_radius(self, length: ScalarLike, span: ScalarLike) -> Scalar:
        """Return the least radius (unit as `scales`) of a turn that lasts from `length` to `length` + `span`, m."""

        # greatest of the radii at start, middle and end
        def radius_at(position: Scalar) -> Scalar:
            k, fraction = _grid_index(position, self.step, self.scales.shape[0])
            return (1.0 - fraction) * self.scales[k] + fraction * self.scales[k + 1]

        return jnp.max(jax.vmap(radius_at)(length + span * jnp.array([0.0, 0.5, 1.0])))


class KeepOutsAlongPath(eqx.Module):
    """Keep-outs in the frame of the drifting air, tabulated over the length along a path of known profile.

    Radii and altitudes include a margin.
    """

    step: Scalar  # spacing of the table, m
    # centres, m
    norths: Float[Array, "volumes intervals"]
    easts: Float[Array, "volumes intervals"]
    radii: Float[Array, " volumes"]  # m
    # 1 where the path is at the altitudes of the keep-out, else 0
    in_altitude_band: Float[Array, "volumes intervals"]

    def penetration(self, spot: Spot) -> tuple[Float[Array, " volumes"], Float[Array, "volumes 3"]]:
        """Return the depth of a point inside each keep-out over the keep-out's radius, and its derivative by `spot`.

        The depth is 0 outside.
        """
        k, fraction = _grid_index(spot[2], self.step, self.in_altitude_band.shape[1])
        centres, next_centres = (jnp.stack([self.norths[:, j], self.easts[:, j]], axis=1) for j in (k, k + 1))
        offset = spot[None, :2] - (1.0 - fraction) * centres - fraction * next_centres
        distance = jnp.sqrt(jnp.sum(offset**2, axis=1) + 1.0)
        in_altitude_band = jnp.maximum(self.in_altitude_band[:, k], self.in_altitude_band[:, k + 1])
        depth = in_altitude_band * jnp.maximum(1.0 - distance / self.radii, 0.0)
        slope = jnp.where(depth > 0.0, -1.0 / (self.radii * distance), 0.0)[:, None] * offset
        moving = jnp.sum(slope * (next_centres - centres), axis=1) / self.step
        return depth, jnp.concatenate([slope, -moving[:, None]], axis=1)


def _even_times(table: TabulatedProfile) -> tuple[Scalar, Float[Array, " intervals"]]:
    """Return the step, m, of an equally spaced grid along a profile's path, and the time at each grid point, s."""
    count = table.lengths.shape[0]
    even = jnp.linspace(0.0, 1.0, count)
    times = jnp.interp(even * table.length, table.lengths, even * table.profile.duration)
    return jnp.maximum(table.length, 1.0) / (count - 1), times


def keep_outs_along_path(table: TabulatedProfile, volumes: KeepOuts) -> KeepOutsAlongPath:
    """Tabulate the keep-outs, in the frame of the drifting air, over the length along a profile's path."""
    step, times = _even_times(table)
    _, drifts = jax.vmap(table.flown_at)(times)
    altitudes = jax.vmap(lambda t: table.profile.at(t).altitude)(times)
    altitudes, times = altitudes[None, :], times[None, :]
    inside = (altitudes > volumes.bottom[:, None] - _RESERVE_UP_M) & (altitudes < volumes.top[:, None] + _RESERVE_UP_M)
    return KeepOutsAlongPath(
        step,
        volumes.position_n[:, :1] + volumes.velocity_n[:, :1] * times - drifts[None, :, 0],
        volumes.position_n[:, 1:] + volumes.velocity_n[:, 1:] * times - drifts[None, :, 1],
        volumes.radius + _RESERVE_M,
        inside.astype(float),
    )


def make_radius_schedule(
    table: TabulatedProfile, endpoints: PathEndpoints, limits: PathLimits, gravity: ScalarLike
) -> RadiusSchedule:
    """Tabulate the least turn radius that the limits of bank angle and load factor allow along a path."""
    step, times = _even_times(table)

    def least_radius_at(t: Scalar) -> Scalar:
        state = table.profile.at(t)
        sine = jnp.minimum(jnp.abs(state.climb) / jnp.maximum(state.speed, 1.0), 0.9)
        level = jnp.sqrt(1.0 - sine**2) * (gravity + state.climb_dot)
        share = sine * jnp.abs(state.speed_dot)  # vertical component of the longitudinal acceleration
        return state.speed**2 / (CURVATURE_FRACTION * side_force_max(level - share, level + share, limits, gravity))

    return RadiusSchedule(step, jax.vmap(least_radius_at)(times) * endpoints.curvature_max)


class Starts(NamedTuple):
    """Initial values of searches for turn-and-leg paths; leading axis search."""

    senses: Float[ArrayLike, "*starts 4"]  # senses of the turns: 1 right, -1 left
    # square roots of four turn angles (rad), three leg lengths (fractions of the path) and four excess radii (radius
    # over the least radius, minus 1)
    unknowns: Float[ArrayLike, "*starts 11"]
    # fraction of the spare length (target length less straight line) that each turn flies in full circles
    circling_fraction: Float[ArrayLike, "*starts 4"]


def make_starts(count: int) -> Starts:
    """Draw the initial values of `count` searches, the same in each call."""
    rng = np.random.default_rng([11, 0])
    number = np.arange(count)
    senses = np.where(number[:, None] >> np.arange(TURNS) & 1, 1.0, -1.0)
    turns = np.pi * rng.random((count, TURNS)) ** 2
    legs = rng.dirichlet(np.full(LEGS, 1.5), count) * rng.uniform(0.1, 0.9, (count, 1))
    excess_radii = np.where(rng.random((count, TURNS)) < 0.5, 0.02, rng.exponential(0.4, (count, TURNS)))
    circling = np.zeros((count, TURNS))
    circling[number, rng.integers(0, TURNS, count)] = np.where(rng.random(count) < 0.5, 0.0, rng.random(count))
    return Starts(senses, np.sqrt(np.concatenate([turns, legs, excess_radii], axis=1)), circling)


class TurnLegProblem(eqx.Module):
    """Conditions of a turn-and-leg path: endpoints, turn radii, keep-outs and length."""

    endpoints: PathEndpoints  # start, end and turn limits
    schedule: RadiusSchedule  # least turn radius along the path
    keep_outs: KeepOutsAlongPath  # keep-outs that the search avoids
    target_length: Scalar  # length of the whole path, m


class _Flown(eqx.Module):
    """Motion from the start to a point of a path; fields `..._by` are derivatives by the unknowns."""

    position: Float[Array, "2"]  # position of the point, north and east, m
    heading: Scalar  # heading at the point, rad
    length: Scalar  # length of the path up to the point, m
    penetration: Float[Array, " volumes"]  # depth inside each keep-out over its radius, summed over the checked points
    position_by: Float[Array, "2 11"]
    heading_by: Float[Array, "11"]
    length_by: Float[Array, "11"]
    penetration_by: Float[Array, "volumes 11"]


def _rotate(heading: Scalar, vector: Float[Array, "2 ..."]) -> Float[Array, "2 ..."]:
    cosine, sine = jnp.cos(heading), jnp.sin(heading)
    return jnp.stack([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])


def _perpendicular(vector: Float[Array, "2"]) -> Float[Array, "2"]:
    """Return the vector turned by 90 deg from north towards east."""
    return jnp.stack([-vector[1], vector[0]])


class _EvaluatedPath(NamedTuple):
    """Path for one set of unknowns, and residuals and Jacobian of its equations."""

    residual: Float[Array, "*batch equations"]
    jacobian: Float[Array, "*batch equations unknowns"]
    path: TurnsAndLegs

    @property
    def cost(self) -> Float[Array, "*batch"]:
        """Sum of squares of the residuals."""
        return jnp.sum(self.residual**2, axis=-1)


def _evaluate_path(
    x: Unknowns, problem: TurnLegProblem, senses: Float[Array, "4"], circles: Float[Array, "4"]
) -> _EvaluatedPath:
    """Compute the path for the unknowns `x`, the residuals of the equations, and their derivatives by the unknowns.

    `senses` are the senses of the turns (1 right, -1 left), `circles` the angles flown in full circles, rad. Residuals:

    - miss distance (north, east) and excess length, over the target length
    - heading error in half turns
    - weighted depth inside each keep-out
    """
    # The derivatives are composed by hand, because a turn depends on three numbers only, not on eleven unknowns.
    endpoints, target_length = problem.endpoints, problem.target_length
    squares, slopes = x * x, 2.0 * x
    squares_by = jnp.eye(_UNKNOWNS) * slopes[:, None]
    full_turns = senses * circles
    angles = senses * squares[:TURNS] + full_turns
    legs = jnp.append(target_length * squares[TURNS : TURNS + LEGS], 0.0)
    legs_by = jnp.concatenate([target_length * squares_by[TURNS : TURNS + LEGS], jnp.zeros((1, _UNKNOWNS))])
    excess_radii, excess_radii_by = squares[TURNS + LEGS :], squares_by[TURNS + LEGS :]
    turn_data = (angles, full_turns, excess_radii, legs, senses[:, None] * squares_by[:TURNS], excess_radii_by, legs_by)

    def turn(parameters: Float[Array, "3"], circled: Scalar) -> tuple[Array, tuple[Array, Scalar]]:
        """Return five lengths of a turn, m, and, as auxiliary output of `jacfwd`, these lengths and the turn's scale.

        The lengths are the displacements (ahead, right) to the end and to the middle of the turn, and the turn's
        length. `parameters` are angle (rad), excess radius and length of the path before the turn (m); `circled` is the
        angle flown in full circles, rad.
        """
        angle, excess_radii, length = parameters
        # The length of a turn depends on its radius, and the radius on the schedule over that length: iterate.
        scale = problem.schedule.least_radius(length, 0.0)
        for _ in range(_RADIUS_ROUNDS):
            estimate = smooth_turn(angle, *turn_limits(endpoints, scale))
            scale = problem.schedule.least_radius(length, estimate.length)
        scale = scale * (1.0 + excess_radii)
        curvature, sharpness = turn_limits(endpoints, scale)
        shape = smooth_turn(angle, curvature, sharpness)
        move = displacement(shape, sharpness)
        # The middle of a turn lies off its chord, by chord / 2 x tan(angle / 4).
        quarter = 0.25 * (angle - circled)
        middle = (0.5 - 0.5j * jnp.sin(quarter) / jnp.maximum(jnp.cos(quarter), 0.2)) * move
        quantities = jnp.stack([jnp.real(move), jnp.imag(move), jnp.real(middle), jnp.imag(middle), shape.length])
        return quantities, (quantities, scale)

    def fly(flown: _Flown, turn_parameters: tuple[Array, ...]) -> tuple[_Flown, Scalar]:
        angle, circled, excess_radii, leg, angle_by, excess_radii_by, leg_by = turn_parameters
        local, (quantities, scale) = jax.jacfwd(turn, has_aux=True)(
            jnp.stack([angle, excess_radii, flown.length]), circled
        )
        local, quantities = jax.lax.optimization_barrier((local, quantities))
        quantities_by = jnp.outer(local[:, 0], angle_by) + jnp.outer(local[:, 1], excess_radii_by)
        quantities_by = quantities_by + jnp.outer(local[:, 2], flown.length_by)
        move, middle = _rotate(flown.heading, quantities[:2]), _rotate(flown.heading, quantities[2:4])
        move_by = _rotate(flown.heading, quantities_by[:2]) + jnp.outer(_perpendicular(move), flown.heading_by)
        middle_by = _rotate(flown.heading, quantities_by[2:4]) + jnp.outer(_perpendicular(middle), flown.heading_by)
        heading, heading_by = flown.heading + angle, flown.heading_by + angle_by
        direction = jnp.stack([jnp.cos(heading), jnp.sin(heading)])
        leg_vector = leg * direction
        leg_vector_by = jnp.outer(direction, leg_by) + leg * jnp.outer(_perpendicular(direction), heading_by)
        leg_start = jnp.append(flown.position + move, flown.length + quantities[4])
        leg_start_by = jnp.concatenate([flown.position_by + move_by, (flown.length_by + quantities_by[4])[None]])
        along, along_by = jnp.append(leg_vector, leg), jnp.concatenate([leg_vector_by, leg_by[None]])
        penetration, penetration_by = flown.penetration, flown.penetration_by
        if penetration.shape[0]:
            halfway = jnp.append(flown.position + middle, flown.length + 0.5 * quantities[4])
            halfway_by = jnp.concatenate(
                [flown.position_by + middle_by, (flown.length_by + 0.5 * quantities_by[4])[None]]
            )
            fractions = jnp.array(_LEG_FRACTIONS)
            spots = jnp.concatenate([halfway[None], leg_start[None] + jnp.outer(fractions, along)])
            depths, slope = jax.lax.optimization_barrier(jax.vmap(problem.keep_outs.penetration)(spots))
            penetration = penetration + jnp.sum(depths, axis=0)
            leg_slope = jnp.sum(slope[1:], axis=0)
            fraction_slope = jnp.sum(slope[1:] * fractions[:, None, None], axis=0)
            for k in range(3):
                penetration_by = penetration_by + jnp.outer(slope[0, :, k], halfway_by[k])
                penetration_by = penetration_by + jnp.outer(leg_slope[:, k], leg_start_by[k])
                penetration_by = penetration_by + jnp.outer(fraction_slope[:, k], along_by[k])
        position, position_by = leg_start[:2] + leg_vector, leg_start_by[:2] + leg_vector_by
        length, length_by = leg_start[2] + leg, leg_start_by[2] + leg_by
        return _Flown(position, heading, length, penetration, position_by, heading_by, length_by, penetration_by), scale

    initial, volumes = roll_out(endpoints), problem.keep_outs.radii.shape[0]
    initial_state = _Flown(
        jnp.stack([jnp.real(initial.position), jnp.imag(initial.position)]),
        initial.heading,
        initial.length,
        jnp.zeros(volumes),
        jnp.zeros((2, _UNKNOWNS)),
        jnp.zeros(_UNKNOWNS),
        jnp.zeros(_UNKNOWNS),
        jnp.zeros((volumes, _UNKNOWNS)),
    )
    flown, scales = jax.lax.scan(fly, initial_state, turn_data)
    miss = jnp.stack([jnp.real(endpoints.end), jnp.imag(endpoints.end)]) - flown.position
    heading_error = jnp.mod(flown.heading - endpoints.end_heading + jnp.pi, 2 * jnp.pi) - jnp.pi
    heading_weight = jnp.where(endpoints.end_free, 0.0, 1.0 / jnp.pi)
    length_residual = (flown.length / target_length - 1.0)[None]
    heading_residual = (heading_weight * heading_error)[None]
    residuals = [miss / target_length, length_residual, heading_residual, _VOLUME_WEIGHT * flown.penetration]
    residuals_by = [
        -flown.position_by / target_length,
        flown.length_by[None] / target_length,
        heading_weight * flown.heading_by[None],
        _VOLUME_WEIGHT * flown.penetration_by,
    ]
    solved = TurnsAndLegs(angles, scales, legs[:LEGS], jnp.asarray(True))
    return _EvaluatedPath(jnp.concatenate(residuals), jnp.concatenate(residuals_by), solved)


def solve_turn_leg_paths(problem: TurnLegProblem, starts: Starts, max_paths: int | None = None) -> TurnsAndLegs:
    """Find turn-and-leg paths of a target length: one damped Gauss-Newton search from each of the `starts`.

    Returns one path per search (see `max_paths`), in no particular order. The flag `exists` of a path tells whether end
    position, end heading, length and turn angles are met, not whether the path avoids the keep-outs. Not
    differentiable.

    Parameters
    ----------
    max_paths
        Number of searches that are continued after the first steps, those with the smallest residuals; None: all.
    """
    problem = dataclasses.replace(jax.lax.stop_gradient(problem), target_length=jnp.maximum(problem.target_length, 1.0))
    count = 4 + problem.keep_outs.radii.shape[0]

    endpoints = problem.endpoints
    spare_length = jnp.maximum(problem.target_length - jnp.abs(endpoints.end - endpoints.start), 0.0)

    def initialize(senses: Array, unknowns: Unknowns, circling_fraction: Array) -> least_squares.SearchState:
        circles = FULL_TURN * jnp.floor(circling_fraction * spare_length * endpoints.curvature_max / FULL_TURN)
        # Leg lengths are fractions of the length not flown in circles.
        leg_fraction = 1.0 - jnp.sum(circles) / (endpoints.curvature_max * problem.target_length)
        scaled_unknowns = unknowns.at[TURNS : TURNS + LEGS].multiply(jnp.sqrt(leg_fraction))
        return least_squares.start_search((senses, circles), scaled_unknowns, initial_value)

    def evaluate(context: tuple[Array, Array], x: Unknowns) -> _EvaluatedPath:
        return _evaluate_path(x, problem, *context)

    no_path = TurnsAndLegs(jnp.zeros(TURNS), jnp.ones(TURNS), jnp.zeros(LEGS), jnp.asarray(False))
    initial_value = _EvaluatedPath(jnp.full(count, 1e6), jnp.zeros((count, _UNKNOWNS)), no_path)
    step_rule = least_squares.minimum_norm_step(_LONGEST_STEP)
    searches = jax.vmap(initialize)(*(jnp.asarray(x) for x in starts))
    searches = least_squares.search_steps(evaluate, step_rule, _DAMPING, _FIRST_STEPS, searches)
    if max_paths is not None and max_paths < searches.best.shape[0]:
        searches = least_squares.best_searches(searches, max_paths)
    searches = least_squares.search_steps(evaluate, step_rule, _DAMPING, _STEPS - _FIRST_STEPS, searches)
    _, circles = searches.context
    residuals, _, solved = searches.at
    converged = jnp.max(jnp.abs(residuals[:, :4]), axis=1) <= _RESIDUAL_TOLERANCE
    turns_allowed = jnp.all(jnp.abs(solved.angles) - circles <= _TURN_MAX, axis=1)
    return eqx.tree_at(lambda s: s.exists, solved, converged & turns_allowed)
