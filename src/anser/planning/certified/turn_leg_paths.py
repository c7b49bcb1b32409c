"""Turn-and-leg paths of a wanted length: four turns of any sense and radius and three legs, solved at once.

What detours cannot be is found here: three turns in a row, loops, turns wider than need be, turns that are tighter
once the aircraft is slower, ways around keep-outs. Four equations (where the path ends, its last heading, its
length) and one for each volume hold eleven unknowns: from each of many starts, damped Gauss-Newton steps of least size
lead to the solution nearest to it.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from anser.numerics import least_squares
from anser.planning.certified.detours import FULL_TURN
from anser.planning.certified.profile import CURVATURE_KEPT, TabulatedProfile
from anser.planning.certified.routes import (
    LEGS,
    TURNS,
    PathEndpoints,
    TurnsAndLegs,
    displacement,
    roll_out,
    smooth_turn,
    tightness,
)
from anser.planning.certified.task import KeepOuts
from anser.planning.demand import side_force_max
from anser.planning.limits import PathLimits
from anser.shapes import Count, Scalar, ScalarLike

_FIRST_STEPS, _STEPS = 10, 24
_DAMPING = least_squares.Damping(lambda _: jnp.asarray(1e-4), 0.1, 20.0, 1e-14, 1e6)
_LONGEST_STEP = 0.7  # of all unknowns together, in their own units: square roots of radians and of leg / length
_RESIDUAL_TOLERANCE = 1e-10  # part of the path's length by which it may miss its end, radians for its heading
_TURN_MOST = 7.5  # rad, beside whole circles
_UNKNOWNS = 2 * TURNS + LEGS
_RESERVE_M, _RESERVE_UP_M = 30.0, 5.0  # from keep-outs
_VOLUME_WEIGHT = 0.1
_RADIUS_ROUNDS = 4
_ON_LEGS = (0.0, 0.2, 0.4, 0.6, 0.8)  # where legs are looked at, besides their ends
Unknowns = Float[Array, "11"]
Spot = Float[Array, "3"]
"""A place on a path: north and east, m, and the length flown to it, m."""


def _grid_index(length: Scalar, step: Scalar, count: int) -> tuple[Count, Scalar]:
    """Where a length lies among `count` values at equal steps from zero: the one before it, and how far beyond."""
    at = jnp.clip(length / step, 0.0, count - 1.0)
    k = jnp.minimum(at.astype(jnp.int32), count - 2)
    return k, at - k


class RadiusSchedule(eqx.Module):
    """How tightly a path may turn by how far it has come.

    Attributes
    ----------
    step
        Length along the path from one value to the next, m.
    scales
        Least radius there, in units of that which does for the whole path; see `tightness`.
    """

    step: Scalar
    scales: Float[Array, " intervals"]

    def least_radius(self, length: ScalarLike, span: ScalarLike) -> Scalar:
        """Least radius of a turn that begins after a length (m) and takes another, in the same units."""

        def one(position: Scalar) -> Scalar:
            k, part = _grid_index(position, self.step, self.scales.shape[0])
            return (1.0 - part) * self.scales[k] + part * self.scales[k + 1]

        return jnp.max(jax.vmap(one)(length + span * jnp.array([0.0, 0.5, 1.0])))


class KeepOutsAlongPath(eqx.Module):
    """Keep-outs, as a path in the drifting air meets them.

    Attributes
    ----------
    step
        Length along the path from one value to the next, m.
    norths, easts
        Of each volume's centre when the path has come so far, in the air's frame, m.
    radii
        m, a reserve included.
    in_altitude_band
        1 where the path is then between bottom and top, else 0.
    """

    step: Scalar
    norths: Float[Array, "volumes intervals"]
    easts: Float[Array, "volumes intervals"]
    radii: Float[Array, " volumes"]
    in_altitude_band: Float[Array, "volumes intervals"]

    def penetration(self, spot: Spot) -> tuple[Float[Array, " volumes"], Float[Array, "volumes 3"]]:
        """How deep a path is inside each volume at a spot, in units of its radius, and how that changes there."""
        k, part = _grid_index(spot[2], self.step, self.in_altitude_band.shape[1])
        here, there = (jnp.stack([self.norths[:, j], self.easts[:, j]], axis=1) for j in (k, k + 1))
        apart = spot[None, :2] - (1.0 - part) * here - part * there
        distance = jnp.sqrt(jnp.sum(apart**2, axis=1) + 1.0)
        in_altitude_band = jnp.maximum(self.in_altitude_band[:, k], self.in_altitude_band[:, k + 1])
        deep = in_altitude_band * jnp.maximum(1.0 - distance / self.radii, 0.0)
        slope = jnp.where(deep > 0.0, -1.0 / (self.radii * distance), 0.0)[:, None] * apart
        moving = jnp.sum(slope * (there - here), axis=1) / self.step
        return deep, jnp.concatenate([slope, -moving[:, None]], axis=1)


def _even_times(table: TabulatedProfile) -> tuple[Scalar, Float[Array, " intervals"]]:
    """An even step along the path of a tabulated profile, m, and when each is reached, s."""
    count = table.lengths.shape[0]
    even = jnp.linspace(0.0, 1.0, count)
    times = jnp.interp(even * table.length, table.lengths, even * table.profile.duration)
    return jnp.maximum(table.length, 1.0) / (count - 1), times


def keep_outs_along_path(table: TabulatedProfile, volumes: KeepOuts) -> KeepOutsAlongPath:
    """Keep-outs as the path of a tabulated profile meets them."""
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
    """Least radii within bank and load factor, by the airspeed, the climb and their rates at each time."""
    step, times = _even_times(table)

    def one(t: Scalar) -> Scalar:
        now = table.profile.at(t)
        sine = jnp.minimum(jnp.abs(now.climb) / jnp.maximum(now.speed, 1.0), 0.9)
        level = jnp.sqrt(1.0 - sine**2) * (gravity + now.climb_dot)
        share = sine * jnp.abs(now.speed_dot)  # of the longitudinal acceleration, up or down
        return now.speed**2 / (CURVATURE_KEPT * side_force_max(level - share, level + share, limits, gravity))

    return RadiusSchedule(step, jax.vmap(one)(times) * endpoints.curvature_max)


class Starts(NamedTuple):
    """Where to begin looking.

    Attributes
    ----------
    senses
        Of the turns: 1 right, -1 left.
    unknowns
        Square roots: of the sizes of the turns (rad), of the lengths of the legs as parts of the path, of how much
        wider than need be the turns are.
    waiting
        What part of the length that is not needed each turn takes up in whole circles.
    """

    senses: Float[ArrayLike, "*starts 4"]
    unknowns: Float[ArrayLike, "*starts 11"]
    circling_fraction: Float[ArrayLike, "*starts 4"]


def make_starts(count: int, seed: int = 0) -> Starts:
    """`count` starts; the same ones every time. Every second waits in circles, where there is time for them."""
    rng = np.random.default_rng([11, seed])
    number = np.arange(count)
    senses = np.where(number[:, None] >> np.arange(TURNS) & 1, 1.0, -1.0)
    turns = np.pi * rng.random((count, TURNS)) ** 2
    legs = rng.dirichlet(np.full(LEGS, 1.5), count) * rng.uniform(0.1, 0.9, (count, 1))
    wider = np.where(rng.random((count, TURNS)) < 0.5, 0.02, rng.exponential(0.4, (count, TURNS)))
    waiting = np.zeros((count, TURNS))
    waiting[number, rng.integers(0, TURNS, count)] = np.where(rng.random(count) < 0.5, 0.0, rng.random(count))
    return Starts(senses, np.sqrt(np.concatenate([turns, legs, wider], axis=1)), waiting)


class TurnLegProblem(eqx.Module):
    """What a turn-and-leg path has to keep."""

    endpoints: PathEndpoints
    schedule: RadiusSchedule
    keep_outs: KeepOutsAlongPath
    target_length: Scalar
    """Length of the whole path, m."""


class _Flown(eqx.Module):
    """What has been flown of a path, and how it changes with the unknowns (last axis)."""

    position: Float[Array, "2"]
    """North and east, m."""
    heading: Scalar
    length: Scalar
    penetration: Float[Array, " volumes"]
    """How deep it was inside keep-outs, summed over the spots looked at."""
    place_by: Float[Array, "2 11"]
    heading_by: Float[Array, "11"]
    length_by: Float[Array, "11"]
    penetration_by: Float[Array, "volumes 11"]


def _rotate(heading: Scalar, vector: Float[Array, "2 ..."]) -> Float[Array, "2 ..."]:
    cosine, sine = jnp.cos(heading), jnp.sin(heading)
    return jnp.stack([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])


def _perpendicular(vector: Float[Array, "2"]) -> Float[Array, "2"]:
    """How a vector changes as it turns."""
    return jnp.stack([-vector[1], vector[0]])


def _path_and_residuals(
    x: Unknowns, problem: TurnLegProblem, senses: Float[Array, "4"], circles: Float[Array, "4"]
) -> tuple[TurnsAndLegs, Float[Array, " equations"], Float[Array, "equations 11"]]:
    """The path that unknowns stand for, and by how much it misses what is wanted, with the derivatives of that.

    Parts of the path's length, of half a turn, and for each keep-out how deep the path is inside. The derivatives
    are composed by hand: what is within a turn depends on three numbers only, not on all eleven.
    """
    ends, wanted = problem.endpoints, problem.target_length
    squares, slopes = x * x, 2.0 * x
    rows = jnp.eye(_UNKNOWNS) * slopes[:, None]
    whole = senses * circles
    angles = senses * squares[:TURNS] + whole
    legs = jnp.append(wanted * squares[TURNS : TURNS + LEGS], 0.0)
    legs_by = jnp.concatenate([wanted * rows[TURNS : TURNS + LEGS], jnp.zeros((1, _UNKNOWNS))])
    wider, wider_by = squares[TURNS + LEGS :], rows[TURNS + LEGS :]
    each = (angles, whole, wider, legs, senses[:, None] * rows[:TURNS], wider_by, legs_by)

    def turn(own: Float[Array, "3"], circled: Scalar) -> tuple[Array, tuple[Array, Scalar]]:
        """By its angle, how much wider it is than need be and where it begins: ends, middle, length; scale."""
        angle, wider, length = own
        # A turn that begins before the aircraft is faster ends later than one that does not: its radius is the end's.
        scale = problem.schedule.least_radius(length, 0.0)
        for _ in range(_RADIUS_ROUNDS):
            about = smooth_turn(angle, *tightness(ends, scale))
            scale = problem.schedule.least_radius(length, about.length)
        scale = scale * (1.0 + wider)
        curvature, sharpness = tightness(ends, scale)
        made = smooth_turn(angle, curvature, sharpness)
        move = displacement(made, sharpness)
        # The middle of a turn bulges to its outer side: by a quarter of its chord for each tangent of a quarter.
        quarter = 0.25 * (angle - circled)
        middle = (0.5 - 0.5j * jnp.sin(quarter) / jnp.maximum(jnp.cos(quarter), 0.2)) * move
        found = jnp.stack([jnp.real(move), jnp.imag(move), jnp.real(middle), jnp.imag(middle), made.length])
        return found, (found, scale)

    def fly(flown: _Flown, own: tuple[Array, ...]) -> tuple[_Flown, Scalar]:
        angle, circled, wider, leg, angle_by, wider_by, leg_by = own
        local, (found, scale) = jax.jacfwd(turn, has_aux=True)(jnp.stack([angle, wider, flown.length]), circled)
        local, found = jax.lax.optimization_barrier((local, found))
        found_by = jnp.outer(local[:, 0], angle_by) + jnp.outer(local[:, 1], wider_by)
        found_by = found_by + jnp.outer(local[:, 2], flown.length_by)
        move, middle = _rotate(flown.heading, found[:2]), _rotate(flown.heading, found[2:4])
        move_by = _rotate(flown.heading, found_by[:2]) + jnp.outer(_perpendicular(move), flown.heading_by)
        middle_by = _rotate(flown.heading, found_by[2:4]) + jnp.outer(_perpendicular(middle), flown.heading_by)
        heading, heading_by = flown.heading + angle, flown.heading_by + angle_by
        ahead = jnp.stack([jnp.cos(heading), jnp.sin(heading)])
        on, on_by = leg * ahead, jnp.outer(ahead, leg_by) + leg * jnp.outer(_perpendicular(ahead), heading_by)
        begun = jnp.append(flown.position + move, flown.length + found[4])
        begun_by = jnp.concatenate([flown.place_by + move_by, (flown.length_by + found_by[4])[None]])
        along, along_by = jnp.append(on, leg), jnp.concatenate([on_by, leg_by[None]])
        penetration, penetration_by = flown.penetration, flown.penetration_by
        if penetration.shape[0]:
            halfway = jnp.append(flown.position + middle, flown.length + 0.5 * found[4])
            halfway_by = jnp.concatenate([flown.place_by + middle_by, (flown.length_by + 0.5 * found_by[4])[None]])
            parts = jnp.array(_ON_LEGS)
            spots = jnp.concatenate([halfway[None], begun[None] + jnp.outer(parts, along)])
            deep, slope = jax.lax.optimization_barrier(jax.vmap(problem.keep_outs.penetration)(spots))
            penetration = penetration + jnp.sum(deep, axis=0)
            begin, on_leg = jnp.sum(slope[1:], axis=0), jnp.sum(slope[1:] * parts[:, None, None], axis=0)
            for k in range(3):
                penetration_by = penetration_by + jnp.outer(slope[0, :, k], halfway_by[k])
                penetration_by = penetration_by + jnp.outer(begin[:, k], begun_by[k])
                penetration_by = penetration_by + jnp.outer(on_leg[:, k], along_by[k])
        place, place_by = begun[:2] + on, begun_by[:2] + on_by
        length, length_by = begun[2] + leg, begun_by[2] + leg_by
        return _Flown(place, heading, length, penetration, place_by, heading_by, length_by, penetration_by), scale

    begun, volumes = roll_out(ends), problem.keep_outs.radii.shape[0]
    first = _Flown(
        jnp.stack([jnp.real(begun.position), jnp.imag(begun.position)]),
        begun.heading,
        begun.length,
        jnp.zeros(volumes),
        jnp.zeros((2, _UNKNOWNS)),
        jnp.zeros(_UNKNOWNS),
        jnp.zeros(_UNKNOWNS),
        jnp.zeros((volumes, _UNKNOWNS)),
    )
    flown, scales = jax.lax.scan(fly, first, each)
    off = jnp.stack([jnp.real(ends.end), jnp.imag(ends.end)]) - flown.position
    turned = jnp.mod(flown.heading - ends.end_heading + jnp.pi, 2 * jnp.pi) - jnp.pi
    asked = jnp.where(ends.end_free, 0.0, 1.0 / jnp.pi)
    length_off, heading_off = (flown.length / wanted - 1.0)[None], (asked * turned)[None]
    residuals = [off / wanted, length_off, heading_off, _VOLUME_WEIGHT * flown.penetration]
    residuals_by = [
        -flown.place_by / wanted,
        flown.length_by[None] / wanted,
        asked * flown.heading_by[None],
        _VOLUME_WEIGHT * flown.penetration_by,
    ]
    solved = TurnsAndLegs(angles, scales, legs[:LEGS], jnp.asarray(True))
    return solved, jnp.concatenate(residuals), jnp.concatenate(residuals_by)


def solve_turn_leg_paths(problem: TurnLegProblem, starts: Starts, max_paths: int | None = None) -> TurnsAndLegs:
    """Paths of a wanted length, each near a start; see `make_starts`.

    Keep-outs are looked for where turns begin, are half over and end, and at four places of each leg: what comes
    of it is to be checked for them. Not differentiated: plans are chosen, not tuned.

    Parameters
    ----------
    problem
        What they have to keep.
    starts
        Where to begin, stacked.
    kept
        After a first few steps only so many go on, those that miss the least; None: all.

    Returns
    -------
    One for each that went on to the last step, in no particular order.
    """
    problem = eqx.tree_at(
        lambda t: t.target_length, jax.lax.stop_gradient(problem), jnp.maximum(problem.target_length, 1.0)
    )
    count = 4 + problem.keep_outs.radii.shape[0]

    ends = problem.endpoints
    spare = jnp.maximum(problem.target_length - jnp.abs(ends.end - ends.start), 0.0)

    def begin(senses: Array, unknowns: Unknowns, circling_fraction: Array) -> least_squares.SearchState:
        circles = FULL_TURN * jnp.floor(circling_fraction * spare * ends.curvature_max / FULL_TURN)
        # The legs are parts of what is left beside the circles.
        left = 1.0 - jnp.sum(circles) / (ends.curvature_max * problem.target_length)
        parts = unknowns.at[TURNS : TURNS + LEGS].multiply(jnp.sqrt(left))
        return least_squares.start_search((senses, circles), parts, unknown)

    def missed_at(about: tuple[Array, Array], x: Unknowns) -> least_squares.Linearized:
        return least_squares.Linearized(*_path_and_residuals(x, problem, *about)[1:])

    unknown, move = (
        least_squares.Linearized(jnp.full(count, 1e6), jnp.zeros((count, _UNKNOWNS))),
        least_squares.minimum_norm_step(_LONGEST_STEP),
    )
    searches = jax.vmap(begin)(*(jnp.asarray(x) for x in starts))
    searches = least_squares.search_steps(missed_at, move, _DAMPING, _FIRST_STEPS, searches)
    if max_paths is not None and max_paths < searches.best.shape[0]:
        searches = least_squares.best_searches(searches, max_paths)
    searches = least_squares.search_steps(missed_at, move, _DAMPING, _STEPS - _FIRST_STEPS, searches)
    senses, circles = searches.context
    solved, missed, _ = jax.vmap(_path_and_residuals, (0, None, 0, 0))(searches.best, problem, senses, circles)
    met = jnp.max(jnp.abs(missed[:, :4]), axis=1) <= _RESIDUAL_TOLERANCE
    turned = jnp.all(jnp.abs(solved.angles) - circles <= _TURN_MOST, axis=1)
    return eqx.tree_at(lambda s: s.exists, solved, met & turned)
