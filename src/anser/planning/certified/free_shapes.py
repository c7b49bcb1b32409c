"""Paths of a wanted length without a prescribed shape: four turns of any sense and radius, three legs, solved at once.

What detours cannot be is found here: three turns in a row, loops, turns wider than need be, turns that are tighter
once the aircraft is slower, ways around closed volumes. Four equations (where the path ends, its last heading, its
length) and one for each volume hold eleven unknowns: from each of many starts, damped Gauss-Newton steps of least size
lead to the solution nearest to it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from anser.planning.certified.detours import Solved
from anser.planning.certified.profile import CURVATURE_KEPT, Timetable
from anser.planning.certified.request import KeepOuts
from anser.planning.certified.route import LEGS, TURNS, Ends, tightness, unwind
from anser.planning.certified.smooth_turn import Plane, cis, displacement, smooth_turn
from anser.planning.limits import PathLimits
from anser.shapes import Count, Scalar, ScalarLike

_STEPS = 24
_LONGEST_STEP = 0.7  # of all unknowns together, in their own units: square roots of radians and of leg / length
_SOLVED = 1e-10  # part of the path's length by which it may miss its end, radians for its heading
_TURN_MOST = 7.5  # rad
_UNKNOWNS = 2 * TURNS + LEGS
_RESERVE_M, _RESERVE_UP_M = 30.0, 5.0  # from closed volumes
_ON_LEGS = (0.2, 0.4, 0.6, 0.8)  # where legs are looked at, besides their ends
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


class Closed(eqx.Module):
    """Closed volumes, as a path in the drifting air meets them.

    Attributes
    ----------
    lengths
        Along the path, m, increasing.
    centres
        Of each volume when the path has come so far, in the air's frame: north + i east, m.
    radii
        m, a reserve included.
    matters
        1 where the path is then between bottom and top, else 0.
    """

    lengths: Float[Array, " ticks"]
    centres: Complex[Array, "volumes ticks"]
    radii: Float[Array, " volumes"]
    matters: Float[Array, "volumes ticks"]

    def entered(self, length: Scalar, place: Plane) -> Float[Array, " volumes"]:
        """How deep inside each volume a place is, reached after a length (m), in units of its radius."""
        at = jnp.interp(length, self.lengths, jnp.arange(self.lengths.shape[0], dtype=float))
        k = jnp.clip(jnp.floor(at).astype(int), 0, self.lengths.shape[0] - 2)
        part = at - k
        centre = (1.0 - part) * self.centres[:, k] + part * self.centres[:, k + 1]
        matters = jnp.maximum(self.matters[:, k], self.matters[:, k + 1])
        off = place - centre
        distance = jnp.sqrt(jnp.real(off) ** 2 + jnp.imag(off) ** 2 + 1.0)
        return matters * jnp.maximum(1.0 - distance / self.radii, 0.0)


def make_closed(table: Timetable, volumes: KeepOuts) -> Closed:
    """Closed volumes as the path of a timetable meets them."""
    profile = table.profile
    times = profile.duration * jnp.linspace(0.0, 1.0, table.lengths.shape[0])
    drift = jax.lax.complex(table.drifts_n[:, 0], table.drifts_n[:, 1])
    begin = jax.lax.complex(volumes.position_n[:, 0], volumes.position_n[:, 1])
    moving = jax.lax.complex(volumes.velocity_n[:, 0], volumes.velocity_n[:, 1])
    altitudes = jax.vmap(lambda t: profile.at(t).altitude)(times)
    altitudes, times = altitudes[None, :], times[None, :]
    inside = (altitudes > volumes.bottom[:, None] - _RESERVE_UP_M) & (altitudes < volumes.top[:, None] + _RESERVE_UP_M)
    return Closed(
        table.lengths,
        begin[:, None] + moving[:, None] * times - drift[None, :],
        volumes.radius + _RESERVE_M,
        inside.astype(float),
    )


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
    legs = rng.dirichlet(np.full(LEGS, 1.5), count) * rng.uniform(0.1, 0.9, (count, 1))
    wider = np.where(rng.random((count, TURNS)) < 0.5, 0.02, rng.exponential(0.4, (count, TURNS)))
    return senses, np.sqrt(np.concatenate([turns, legs, wider], axis=1))


class Task(eqx.Module):
    """What a free shape has to keep."""

    ends: Ends
    pace: Pace
    closed: Closed
    wanted: Scalar
    """Length of the whole path, m."""
    senses: Float[Array, "4"]


def _shape(x: Unknowns, task: Task) -> tuple[Solved, Float[Array, " equations"]]:
    """The path that unknowns stand for, and by how much it misses what is wanted, as parts of its length and rad."""
    ends, wanted = task.ends, task.wanted
    squares = x * x
    angles = task.senses * squares[:TURNS]
    legs = wanted * squares[TURNS : TURNS + LEGS]
    begun = unwind(ends)

    def turn_and_leg(
        carry: tuple[Plane, Scalar, Scalar, Array], own: tuple[Scalar, Scalar, Scalar]
    ) -> tuple[tuple[Plane, Scalar, Scalar, Array], Scalar]:
        place, heading, length, entered = carry
        angle, wider, leg = own
        about = smooth_turn(angle, *tightness(ends, task.pace.least(length, 0.0)))
        scale = task.pace.least(length, about.length) * (1.0 + wider)
        curvature, sharpness = tightness(ends, scale)
        turn = smooth_turn(angle, curvature, sharpness)
        move = cis(heading) * displacement(turn, sharpness)
        after = cis(heading + angle)
        if entered.shape[0]:
            # The middle of a turn bulges to its outer side: by a quarter of its chord for each tangent of a quarter.
            bulge = -0.5j * jnp.sin(0.25 * angle) / jnp.maximum(jnp.cos(0.25 * angle), 0.2)
            entered = entered + task.closed.entered(length + 0.5 * turn.length, place + (0.5 + bulge) * move)
            entered = entered + task.closed.entered(length + turn.length, place + move)
        place, heading, length = place + move, heading + angle, length + turn.length
        if entered.shape[0]:
            on_leg = jax.vmap(lambda u: task.closed.entered(length + u * leg, place + u * leg * after))
            entered = entered + jnp.sum(on_leg(jnp.array(_ON_LEGS)), axis=0)
        return (place + leg * after, heading, length + leg, entered), scale

    begin = (begun.place, begun.heading, begun.length, jnp.zeros(task.closed.radii.shape[0]))
    each = (angles, squares[TURNS + LEGS :], jnp.append(legs, 0.0))
    (place, heading, length, entered), scales = jax.lax.scan(turn_and_leg, begin, each)
    off = (ends.end - place) / wanted
    turned = jnp.mod(heading - ends.end_heading + jnp.pi, 2 * jnp.pi) - jnp.pi
    missed = jnp.stack(
        [jnp.real(off), jnp.imag(off), length / wanted - 1.0, jnp.where(ends.end_free, 0.0, turned / jnp.pi)]
    )
    return Solved(angles, scales, legs, jnp.asarray(True)), jnp.concatenate([missed, 0.1 * entered])


def solve_freely(task: Task, start: Unknowns) -> Solved:
    """A path of a wanted length near a start; see `make_starts`.

    Closed volumes are looked at where turns begin, are half over and end, and at four places of each leg: what comes of
    it is to be checked for them. Not differentiated: plans are chosen, not tuned.
    """
    task = eqx.tree_at(lambda t: t.wanted, jax.lax.stop_gradient(task), jnp.maximum(task.wanted, 1.0))
    count = 4 + task.closed.radii.shape[0]

    def evaluate(x: Unknowns) -> tuple[Array, Array]:
        missed, push = jax.linearize(lambda at: _shape(at, task)[1], x)
        return missed, jax.vmap(push, out_axes=1)(jnp.eye(_UNKNOWNS))

    def step(_: object, carry: tuple[Array, ...]) -> tuple[Array, ...]:
        best, trial, missed, jacobian, damping = carry
        new_missed, new_jacobian = evaluate(trial)
        better = jnp.sum(new_missed**2) < jnp.sum(missed**2)
        best = jnp.where(better, trial, best)
        missed = jnp.where(better, new_missed, missed)
        jacobian = jnp.where(better, new_jacobian, jacobian)
        damping = jnp.clip(damping * jnp.where(better, 0.1, 20.0), 1e-14, 1e6)
        move = jacobian.T @ _solve(jacobian @ jacobian.T + damping * jnp.eye(count), missed)
        move = move * jnp.minimum(1.0, _LONGEST_STEP / jnp.maximum(jnp.sqrt(jnp.sum(move**2)), 1e-12))
        return best, best - move, missed, jacobian, damping

    far = jnp.full(count, 1e6)
    begin = (start, start, far, jnp.zeros((count, _UNKNOWNS)), jnp.asarray(1e-3))
    best, *_ = jax.lax.fori_loop(0, _STEPS, step, begin)
    solved, missed = _shape(best, task)
    exists = (jnp.max(jnp.abs(missed[:4])) <= _SOLVED) & jnp.all(jnp.abs(solved.angles) <= _TURN_MOST)
    return eqx.tree_at(lambda s: s.exists, solved, exists)


def _solve(matrix: Float[Array, "n n"], vector: Float[Array, " n"]) -> Float[Array, " n"]:
    """Solution of a small positive definite system by elimination: a batch of them is one computation."""
    count = vector.shape[0]

    def eliminate(k: Count, rows: Array) -> Array:
        pivot = rows[k] / rows[k, k]
        return (rows - rows[:, k, None] * pivot[None, :]).at[k].set(pivot)

    return jax.lax.fori_loop(0, count, eliminate, jnp.concatenate([matrix, vector[:, None]], axis=1))[:, count]
