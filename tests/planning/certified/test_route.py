"""Routes of turns and legs: end points, and smoothness of the curve."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.routes import LEGS, TURNS, PathEndpoints, TurnsAndLegs, chain_turns, roll_out, route
from support.certified_cases import integrated, number, picked, random_ends


def flown(endpoints, angles, legs):
    return route(endpoints, TurnsAndLegs(angles, jnp.ones(TURNS), legs, jnp.asarray(True)))


CASES = 12
ENDS = random_ends(5, CASES, 5.0, 20.0, curvature_use=1.0)
_RNG = np.random.default_rng(6)
ANGLES = _RNG.uniform(-4.0, 4.0, (CASES, TURNS))
ANGLES[:4, 1] = 0.0  # no turn
ANGLES[2:6, 2] = 1e-3  # one without an arc
LENGTHS = _RNG.uniform(0.0, 5000.0, (CASES, LEGS))
LENGTHS[:2, 0] = 0.0


@functools.cache
def routes():
    return compiled_quickly(jax.vmap(flown))(ENDS, jnp.asarray(ANGLES), jnp.asarray(LENGTHS))


def state(shape, length):
    position, heading, curvature = shape.at(length)
    return jnp.stack([jnp.real(position), jnp.imag(position), heading, curvature])


def states_and_slopes(shape, lengths):
    return jax.vmap(lambda s: jax.jvp(lambda x: state(shape, x), (s,), (jnp.ones_like(s),)))(lengths)


along = compiled_quickly(states_and_slopes)


def expected_pieces(k):
    """Pieces of a case (length, first and last curvature), from the definition of a smooth turn."""
    curvature, limit, sharpness = (float(x[k]) for x in (ENDS.curvature, ENDS.curvature_max, ENDS.sharpness))
    pieces = [(abs(curvature) / sharpness, curvature, 0.0)]
    for turn in range(TURNS):
        angle = ANGLES[k, turn]
        ramp = min(np.sqrt(abs(angle) / sharpness), limit / sharpness)
        peak = np.sign(angle) * sharpness * ramp
        arc = max(abs(angle) - limit**2 / sharpness, 0.0) / limit
        pieces += [(ramp, 0.0, peak), (arc, peak, peak), (ramp, peak, 0.0)]
        if turn < LEGS:
            pieces.append((LENGTHS[k, turn], 0.0, 0.0))
    return pieces


def test_a_route_follows_its_curvature():
    for k in range(CASES):
        shape = picked(routes(), k)
        pieces = expected_pieces(k)
        marks = np.cumsum([0.0] + [piece[0] for piece in pieces])
        positions, headings = integrated(ENDS.start[k], ENDS.heading[k], pieces)
        np.testing.assert_allclose(shape.marks, marks, rtol=1e-12)  # rounding
        np.testing.assert_allclose(shape.headings, headings, atol=1e-11)
        np.testing.assert_allclose(shape.positions, positions, atol=1e-7)  # rounding of 1e5 m, a dozen times
        np.testing.assert_allclose(shape.length, marks[-1], rtol=1e-12)


def test_a_route_has_the_prescribed_end():
    start_headings = np.asarray(ENDS.heading + 0.5 * ENDS.curvature * jnp.abs(ENDS.curvature) / ENDS.sharpness)
    np.testing.assert_allclose(
        routes().headings[:, -1], start_headings + np.sum(ANGLES, axis=1), atol=1e-12
    )  # rounding
    np.testing.assert_array_equal(routes().curvatures[:, -1], 0.0)
    for k in range(CASES):
        shape = picked(routes(), k)
        (end_states, _) = along(shape, jnp.stack([number(0.0), shape.length]))
        expected_positions = [complex(ENDS.start[k]), complex(shape.positions[-1])]
        np.testing.assert_allclose(end_states[:, 0] + 1j * end_states[:, 1], expected_positions, atol=1e-8)
        np.testing.assert_allclose(end_states[:, 2], [float(ENDS.heading[k]), float(shape.headings[-1])], atol=1e-12)
        np.testing.assert_allclose(end_states[:, 3], [float(ENDS.curvature[k]), 0.0], atol=1e-12)


def test_every_point_is_on_a_curve_of_unit_speed_with_its_curvature():
    for k in range(CASES):
        shape = picked(routes(), k)
        lengths = float(shape.length) * np.linspace(0.0, 1.0, 801)[1:-1]
        value, slope = (np.asarray(x) for x in along(shape, jnp.asarray(lengths)))
        tangent = slope[:, 0] + 1j * slope[:, 1]
        # The series of a ramp is cut at 1e-10 of its length, 1e-14 here (0.125 rad).
        np.testing.assert_allclose(tangent, np.exp(1j * value[:, 2]), atol=1e-10)
        np.testing.assert_allclose(slope[:, 2], value[:, 3], atol=1e-13)
        limit, sharpness = float(ENDS.curvature_max[k]), float(ENDS.sharpness[k])
        assert np.max(np.abs(value[:, 3])) <= limit * (1 + 1e-9)  # rounding
        assert np.max(np.abs(slope[:, 3])) <= sharpness * (1 + 1e-9)


def test_position_heading_and_curvature_are_continuous_at_the_marks():
    for k in range(CASES):
        shape = picked(routes(), k)
        marks = np.unique(np.asarray(shape.marks))[1:-1]
        right_limit, left_limit = (
            np.asarray(along(shape, jnp.asarray(s))[0]) for s in (marks, np.nextafter(marks, 0.0))
        )
        # 1e-11 m on, at unit speed, and rounding of 1e5 m.
        np.testing.assert_allclose(right_limit, left_limit, rtol=0.0, atol=1e-8)
        # Curvature may change by sharpness x 1e-11 m.
        np.testing.assert_allclose(right_limit[:, 3], left_limit[:, 3], atol=1e-13)


def test_a_route_continues_straight_after_its_end():
    shape = picked(routes(), 7)
    distances = np.array([1e-3, 10.0, 4000.0])
    states, slope = (np.asarray(x) for x in along(shape, shape.length + jnp.asarray(distances)))
    heading = float(shape.headings[-1])
    expected = complex(shape.positions[-1]) + distances * np.exp(1j * heading)
    np.testing.assert_allclose(states[:, 0] + 1j * states[:, 1], expected, atol=1e-8)  # rounding of 1e5 m
    np.testing.assert_allclose(states[:, 2], heading, rtol=1e-14)
    np.testing.assert_array_equal(states[:, 3], 0.0)
    np.testing.assert_allclose(slope[:, 0] + 1j * slope[:, 1], np.exp(1j * heading), rtol=1e-12)


def test_four_turns_in_a_row_are_a_route_without_legs():
    def chain(endpoints, angles):
        initial = roll_out(endpoints)
        move, length, headings = chain_turns(endpoints, initial.heading, angles, jnp.ones(TURNS))
        return initial.position + move, initial.length + length, headings, flown(endpoints, angles, jnp.zeros(LEGS))

    end_position, length, headings, shape = compiled_quickly(jax.vmap(chain))(ENDS, jnp.asarray(ANGLES))
    np.testing.assert_allclose(end_position, shape.positions[:, -1], atol=1e-8)  # rounding of 1e4 m
    np.testing.assert_allclose(length, shape.length, rtol=1e-13)
    # Headings after each turn: where a leg would begin, and at the end.
    np.testing.assert_allclose(headings, shape.headings[:, [4, 8, 12, 16]], atol=1e-12)


def test_rolling_out_of_a_straight_start_has_no_length():
    straight = PathEndpoints(*jax.tree.leaves(picked(ENDS, 0)))
    initial = roll_out(PathEndpoints(**{**vars(straight), "curvature": number(0.0)}))
    assert initial.length == 0.0
    assert initial.position == straight.start
    assert initial.heading == straight.heading


@pytest.mark.long
def test_gradients_are_finite_with_a_turn_of_no_angle():
    def end(angles, legs, curvature):
        shape = flown(PathEndpoints(**{**vars(picked(ENDS, 0)), "curvature": curvature}), angles, legs)
        position, heading, _ = shape.at(0.4 * shape.length)
        return jnp.real(shape.positions[-1]) + jnp.imag(shape.positions[-1]) + jnp.real(position) + heading

    slopes = compiled_quickly(jax.grad(end, argnums=(0, 1, 2)))(jnp.asarray(ANGLES[0]), jnp.zeros(LEGS), number(0.0))
    assert all(np.all(np.isfinite(leaf)) for leaf in slopes)
