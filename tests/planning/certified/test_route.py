"""Routes of turns and legs: where they lead, and that every point of them belongs to one smooth curve."""

import jax
import jax.numpy as jnp
import numpy as np

from anser.compiling.options import compiled_quickly
from anser.planning.certified.routes import LEGS, TURNS, PathEndpoints, TurnsAndLegs, chain_turns, roll_out, route
from support.certified_cases import integrated, number, picked, random_ends


def flown(ends, angles, legs):
    return route(ends, TurnsAndLegs(angles, jnp.ones(TURNS), legs, jnp.asarray(True)))


CASES = 12
ENDS = random_ends(5, CASES, 5.0, 20.0, curvature_use=1.0)
_RNG = np.random.default_rng(6)
ANGLES = _RNG.uniform(-4.0, 4.0, (CASES, TURNS))
ANGLES[:4, 1] = 0.0  # no turn
ANGLES[2:6, 2] = 1e-3  # one without an arc
LENGTHS = _RNG.uniform(0.0, 5000.0, (CASES, LEGS))
LENGTHS[:2, 0] = 0.0
ROUTES = compiled_quickly(jax.vmap(flown))(ENDS, jnp.asarray(ANGLES), jnp.asarray(LENGTHS))


def state(shape, length):
    place, heading, curvature = shape.at(length)
    return jnp.stack([jnp.real(place), jnp.imag(place), heading, curvature])


def states_and_slopes(shape, lengths):
    return jax.vmap(lambda s: jax.jvp(lambda x: state(shape, x), (s,), (jnp.ones_like(s),)))(lengths)


along = compiled_quickly(states_and_slopes)


def expected_pieces(k):
    """Pieces of a case (length, first and last curvature), from what a smooth turn is."""
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


def test_leads_where_its_curvature_does():
    for k in range(CASES):
        shape = picked(ROUTES, k)
        pieces = expected_pieces(k)
        marks = np.cumsum([0.0] + [piece[0] for piece in pieces])
        places, headings = integrated(ENDS.start[k], ENDS.heading[k], pieces)
        np.testing.assert_allclose(shape.marks, marks, rtol=1e-12)  # rounding
        np.testing.assert_allclose(shape.headings, headings, atol=1e-11)
        np.testing.assert_allclose(shape.positions, places, atol=1e-7)  # rounding of 1e5 m, a dozen times
        np.testing.assert_allclose(shape.length, marks[-1], rtol=1e-12)


def test_its_end_is_what_was_asked():
    after = np.asarray(ENDS.heading + 0.5 * ENDS.curvature * jnp.abs(ENDS.curvature) / ENDS.sharpness)
    np.testing.assert_allclose(ROUTES.headings[:, -1], after + np.sum(ANGLES, axis=1), atol=1e-12)  # rounding
    np.testing.assert_array_equal(ROUTES.curvatures[:, -1], 0.0)
    for k in range(CASES):
        shape = picked(ROUTES, k)
        (found, _) = along(shape, jnp.stack([number(0.0), shape.length]))
        ends = [complex(ENDS.start[k]), complex(shape.positions[-1])]
        np.testing.assert_allclose(found[:, 0] + 1j * found[:, 1], ends, atol=1e-8)
        np.testing.assert_allclose(found[:, 2], [float(ENDS.heading[k]), float(shape.headings[-1])], atol=1e-12)
        np.testing.assert_allclose(found[:, 3], [float(ENDS.curvature[k]), 0.0], atol=1e-12)


def test_every_point_is_on_a_curve_of_unit_speed_with_its_curvature():
    for k in range(CASES):
        shape = picked(ROUTES, k)
        lengths = float(shape.length) * np.linspace(0.0, 1.0, 801)[1:-1]
        value, slope = (np.asarray(x) for x in along(shape, jnp.asarray(lengths)))
        tangent = slope[:, 0] + 1j * slope[:, 1]
        # The series of a ramp is cut at 1e-10 of its length, 1e-14 here (0.125 rad).
        np.testing.assert_allclose(tangent, np.exp(1j * value[:, 2]), atol=1e-10)
        np.testing.assert_allclose(slope[:, 2], value[:, 3], atol=1e-13)
        limit, sharpness = float(ENDS.curvature_max[k]), float(ENDS.sharpness[k])
        assert np.max(np.abs(value[:, 3])) <= limit * (1 + 1e-9)  # rounding
        assert np.max(np.abs(slope[:, 3])) <= sharpness * (1 + 1e-9)


def test_place_heading_and_curvature_do_not_jump_at_the_marks():
    for k in range(CASES):
        shape = picked(ROUTES, k)
        marks = np.unique(np.asarray(shape.marks))[1:-1]
        after, before = (np.asarray(along(shape, jnp.asarray(s))[0]) for s in (marks, np.nextafter(marks, 0.0)))
        # 1e-11 m on, at unit speed, and rounding of 1e5 m.
        np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-8)
        # Curvature may change by sharpness x 1e-11 m.
        np.testing.assert_allclose(after[:, 3], before[:, 3], atol=1e-13)


def test_straight_on_after_its_end():
    shape = picked(ROUTES, 7)
    beyond = np.array([1e-3, 10.0, 4000.0])
    found, slope = (np.asarray(x) for x in along(shape, shape.length + jnp.asarray(beyond)))
    heading = float(shape.headings[-1])
    expected = complex(shape.positions[-1]) + beyond * np.exp(1j * heading)
    np.testing.assert_allclose(found[:, 0] + 1j * found[:, 1], expected, atol=1e-8)  # rounding of 1e5 m
    np.testing.assert_allclose(found[:, 2], heading, rtol=1e-14)
    np.testing.assert_array_equal(found[:, 3], 0.0)
    np.testing.assert_allclose(slope[:, 0] + 1j * slope[:, 1], np.exp(1j * heading), rtol=1e-12)


def test_four_turns_in_a_row_are_a_route_without_legs():
    def one(ends, angles):
        begun = roll_out(ends)
        move, length, after = chain_turns(ends, begun.heading, angles, jnp.ones(TURNS))
        return begun.position + move, begun.length + length, after, flown(ends, angles, jnp.zeros(LEGS))

    place, length, after, shape = compiled_quickly(jax.vmap(one))(ENDS, jnp.asarray(ANGLES))
    np.testing.assert_allclose(place, shape.positions[:, -1], atol=1e-8)  # rounding of 1e4 m
    np.testing.assert_allclose(length, shape.length, rtol=1e-13)
    # Headings after each turn: where a leg would begin, and at the end.
    np.testing.assert_allclose(after, shape.headings[:, [4, 8, 12, 16]], atol=1e-12)


def test_rolling_out_of_a_straight_start_is_nothing():
    straight = PathEndpoints(*jax.tree.leaves(picked(ENDS, 0)))
    begun = roll_out(PathEndpoints(**{**vars(straight), "curvature": number(0.0)}))
    assert begun.length == 0.0
    assert begun.position == straight.start
    assert begun.heading == straight.heading


def test_gradients_are_finite_with_a_turn_of_no_angle():
    def end(angles, legs, curvature):
        shape = flown(PathEndpoints(**{**vars(picked(ENDS, 0)), "curvature": curvature}), angles, legs)
        place, heading, _ = shape.at(0.4 * shape.length)
        return jnp.real(shape.positions[-1]) + jnp.imag(shape.positions[-1]) + jnp.real(place) + heading

    slopes = compiled_quickly(jax.grad(end, argnums=(0, 1, 2)))(jnp.asarray(ANGLES[0]), jnp.zeros(LEGS), number(0.0))
    assert all(np.all(np.isfinite(leaf)) for leaf in slopes)
