"""Paths of a wanted length without a prescribed shape: four turns of any sense and radius, three legs, solved at once.

What detours cannot be is found here: three turns in a row, loops, turns wider than need be, turns that are tighter
once the aircraft is slower. Four equations (where the path ends, its last heading, its length) hold eleven unknowns:
from each of many starts, damped Gauss-Newton steps of least size lead to the solution nearest to it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.planning.certified.detours import Solved
from anser.planning.certified.profile import CURVATURE_KEPT, Timetable
from anser.planning.certified.route import LEGS, TURNS, Ends, tightness, unwind
from anser.planning.certified.smooth_turn import cis, displacement, smooth_turn
from anser.planning.limits import PathLimits
from anser.shapes import Scalar, ScalarLike

_STEPS = 24
_LONGEST_STEP = 0.7  # of all unknowns together, in their own units: square roots of radians and of leg / length
_SOLVED = 1e-10  # part of the path's length by which it may miss its end, radians for its heading
_TURN_MOST = 7.5  # rad
_UNKNOWNS = 2 * TURNS + LEGS
Unknowns = Float[Array, "11"]


class Pace(eqx.Module):
    """How tightly a path may turn by how far it has come.

    Attributes
    ----------
    lengths
        Along the path, m, increasing.
    scales
        Least radius there, in units of that which does for the whole path; see `tightness`.
    """

    lengths: Float[Array, " ticks"]
    scales: Float[Array, " ticks"]

    def least(self, length: ScalarLike, span: ScalarLike) -> Scalar:
        """Least radius of a turn that begins after a length (m) and takes another, in the same units."""
        places = length + span * jnp.array([0.0, 0.5, 1.0])
        return jnp.max(jnp.interp(places, self.lengths, self.scales))


def make_pace(table: Timetable, ends: Ends, limits: PathLimits, gravity: ScalarLike) -> Pace:
    """Pace of a timetable: by the airspeed, the climb and the push of each time, for bank angle and load factor."""
    profile = table.profile
    times = profile.duration * jnp.linspace(0.0, 1.0, table.lengths.shape[0])

    def one(t: Scalar) -> Scalar:
        now = profile.at(t)
        sine = jnp.minimum(jnp.abs(now.climb) / jnp.maximum(now.speed, 1.0), 0.9)
        level = jnp.sqrt(1.0 - sine**2) * (gravity + now.climb_dot)
        lift = level - sine * jnp.abs(now.speed_dot)
        most = level + sine * jnp.abs(now.speed_dot)
        total = jnp.minimum(limits.load_factor_max, 1e3) * gravity
        by_load = jnp.sqrt(jnp.maximum(total**2 - most**2, 0.01))
        sideways = jnp.minimum(jnp.maximum(lift, 0.1) * jnp.tan(limits.bank_max), by_load)
        return now.speed**2 / (CURVATURE_KEPT * sideways)

    return Pace(table.lengths, jax.vmap(one)(times) * ends.curvature_max)


def make_starts(count: int, seed: int = 0) -> tuple[Float[np.ndarray, "starts 4"], Float[np.ndarray, "starts 11"]]:
    """Senses of the turns, and first unknowns, of `count` starts; the same ones every time.

    Unknowns are square roots: of the sizes of the turns (rad), of the lengths of the legs as parts of the path, of how
    much wider than need be the turns are.
    """
    rng = np.random.default_rng([11, seed])
    senses = np.where(np.arange(count)[:, None] >> np.arange(TURNS) & 1, 1.0, -1.0)
    turns = np.pi * rng.random((count, TURNS)) ** 2
    legs = rng.dirichlet(np.full(LEGS, 0.7), count) * rng.uniform(0.1, 0.9, (count, 1))
    wider = np.where(rng.random((count, TURNS)) < 0.5, 0.02, rng.exponential(0.4, (count, TURNS)))
    return senses, np.sqrt(np.concatenate([turns, legs, wider], axis=1))


def _shape(x: Unknowns, senses: Float[Array, "4"], ends: Ends, pace: Pace, wanted: Scalar) -> tuple[Solved, Array]:
    """The path that unknowns stand for, and by how much it misses what is wanted, as parts of its length and rad."""
    squares = x * x
    angles = senses * squares[:TURNS]
    legs = wanted * squares[TURNS : TURNS + LEGS]
    wider = squares[TURNS + LEGS :]
    begun = unwind(ends)
    place, heading, length = begun.place, begun.heading, begun.length
    scales = []
    for k in range(TURNS):
        about = smooth_turn(angles[k], *tightness(ends, pace.least(length, 0.0)))
        scale = pace.least(length, about.length) * (1.0 + wider[k])
        curvature, sharpness = tightness(ends, scale)
        turn = smooth_turn(angles[k], curvature, sharpness)
        place = place + cis(heading) * displacement(turn, sharpness)
        heading, length = heading + angles[k], length + turn.length
        scales.append(scale)
        if k < LEGS:
            place, length = place + legs[k] * cis(heading), length + legs[k]
    off = (ends.end - place) / wanted
    turned = jnp.mod(heading - ends.end_heading + jnp.pi, 2 * jnp.pi) - jnp.pi
    missed = jnp.stack(
        [jnp.real(off), jnp.imag(off), length / wanted - 1.0, jnp.where(ends.end_free, 0.0, turned / jnp.pi)]
    )
    return Solved(angles, jnp.stack(scales), legs, jnp.asarray(True)), missed


def solve_freely(ends: Ends, pace: Pace, wanted: ScalarLike, senses: Float[Array, "4"], start: Unknowns) -> Solved:
    """A path of a wanted length (m) near a start; see `make_starts`.

    Not differentiated: plans are chosen, not tuned.
    """
    wanted = jnp.maximum(jnp.asarray(wanted, dtype=float), 1.0)
    ends, pace, wanted = jax.lax.stop_gradient((ends, pace, wanted))

    def evaluate(x: Unknowns) -> tuple[Array, Array]:
        missed, push = jax.linearize(lambda at: _shape(at, senses, ends, pace, wanted)[1], x)
        return missed, jax.vmap(push, out_axes=1)(jnp.eye(_UNKNOWNS))

    def step(_: object, carry: tuple[Array, ...]) -> tuple[Array, ...]:
        best, trial, missed, jacobian, damping = carry
        new_missed, new_jacobian = evaluate(trial)
        better = jnp.sum(new_missed**2) < jnp.sum(missed**2)
        best = jnp.where(better, trial, best)
        missed = jnp.where(better, new_missed, missed)
        jacobian = jnp.where(better, new_jacobian, jacobian)
        damping = jnp.clip(damping * jnp.where(better, 0.1, 20.0), 1e-14, 1e6)
        move = jacobian.T @ _solve(jacobian @ jacobian.T + damping * jnp.eye(4), missed)
        move = move * jnp.minimum(1.0, _LONGEST_STEP / jnp.maximum(jnp.sqrt(jnp.sum(move**2)), 1e-12))
        return best, best - move, missed, jacobian, damping

    far = jnp.full(4, 1e6)
    begin = (start, start, far, jnp.zeros((4, _UNKNOWNS)), jnp.asarray(1e-3))
    best, *_ = jax.lax.fori_loop(0, _STEPS, step, begin)
    solved, missed = _shape(best, senses, ends, pace, wanted)
    exists = (jnp.max(jnp.abs(missed)) <= _SOLVED) & jnp.all(jnp.abs(solved.angles) <= _TURN_MOST)
    return eqx.tree_at(lambda s: s.exists, solved, exists)


def _solve(matrix: Float[Array, "4 4"], vector: Float[Array, "4"]) -> Float[Array, "4"]:
    """Solution of a small positive definite system by elimination: a batch of them is one computation."""
    rows = jnp.concatenate([matrix, vector[:, None]], axis=1)
    for k in range(4):
        pivot = rows[k] / rows[k, k]
        rows = rows.at[k].set(pivot)
        for other in range(4):
            if other != k:
                rows = rows.at[other].add(-rows[other, k] * pivot)
    return rows[:, 4]
