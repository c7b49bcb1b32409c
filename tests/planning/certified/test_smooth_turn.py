"""Smooth turns: angle, curvature and displacement."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from anser.compiling.options import compiled_quickly
from anser.planning.certified.routes import along_arc, along_ramp, cis, displacement, smooth_turn
from support.certified_cases import integrated


def turn_and_move(angle, curvature, sharpness):
    turn = smooth_turn(angle, curvature, sharpness)
    return turn, turn.length, displacement(turn, sharpness)


def parts(angle):
    turn, length, move = turn_and_move(angle, 1e-3, 1e-6)
    return jnp.stack([turn.ramp, turn.arc, turn.peak, length, jnp.real(move), jnp.imag(move)])


resolve = compiled_quickly(turn_and_move)
all_parts = compiled_quickly(jax.vmap(parts))
slopes = compiled_quickly(jax.vmap(jax.jacfwd(parts)))
backward = compiled_quickly(jax.vmap(jax.grad(lambda angle: jnp.sum(parts(angle)))))
ramps = compiled_quickly(jax.vmap(along_ramp))
arcs = compiled_quickly(jax.vmap(along_arc))


@settings(deadline=None, max_examples=60)
@given(
    angle=st.floats(-12.0, 12.0),
    radius=st.floats(200.0, 2e4),
    # Heading change of a whole ramp, rad; the series is made for up to 1.5.
    ramp_angle=st.floats(1e-3, 1.5),
)
@example(angle=0.0, radius=1000.0, ramp_angle=0.2)
@example(angle=3.0, radius=1000.0, ramp_angle=1.5)
@example(angle=1e-9, radius=1000.0, ramp_angle=0.2)
@example(angle=-np.pi, radius=500.0, ramp_angle=0.2)
def test_a_turn_has_the_prescribed_angle_limits_and_end(angle, radius, ramp_angle):
    limit, sharpness = 1.0 / radius, 0.5 / (radius**2 * ramp_angle)
    turn, length, move = resolve(*(jnp.asarray(x) for x in (angle, limit, sharpness)))
    ramp, arc, peak = float(turn.ramp), float(turn.arc), float(turn.peak)
    assert min(ramp, arc) >= 0.0
    assert abs(peak) <= limit * (1 + 1e-12)  # rounding
    np.testing.assert_allclose(abs(peak), sharpness * ramp, rtol=1e-12)
    np.testing.assert_allclose((ramp + arc) * peak, angle, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(length, 2 * ramp + arc, rtol=1e-15)
    # The shortest: at the greatest curvature, or without an arc.
    assert arc == 0.0 or abs(peak) >= limit * (1 - 1e-12)
    positions, heading = integrated(0.0, 0.0, [(ramp, 0.0, peak), (arc, peak, peak), (ramp, peak, 0.0)])
    np.testing.assert_allclose(heading[-1], angle, rtol=1e-12, atol=1e-15)
    # The series leaves out 1e-10 of a ramp of 1.5 rad, less of a shorter one.
    np.testing.assert_allclose(complex(move), positions[-1], atol=2e-10 * ramp + 1e-12 * (float(length) + 1.0))


def test_a_turn_of_no_angle_has_no_length_and_finite_derivatives():
    angles = jnp.array([0.0, -0.0, 1e-300, 0.1, -3.0])
    values = all_parts(angles)
    np.testing.assert_array_equal(values[0], 0.0)
    assert np.all(np.isfinite(slopes(angles)))
    assert np.all(np.isfinite(backward(angles)))


@pytest.mark.parametrize("angle", [0.3, -0.9, 2.5, -7.0])
def test_derivatives_are_those_of_the_values(angle):
    # One turn without an arc and some with; centred differences: (1e-5)^2 of third derivatives, rounding 1e-16 / 1e-5.
    h, point = 1e-5, jnp.asarray([angle])
    differences = (np.asarray(all_parts(point + h)) - np.asarray(all_parts(point - h))) / (2 * h)
    np.testing.assert_allclose(slopes(point), differences, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("length", [0.0, -300.0, 700.0])
def test_a_ramp_equals_fresnel_integrals(length):
    from scipy.special import fresnel

    sharpness = np.array([3e-6, -2e-6])  # up to 0.74 rad
    scale = np.sqrt(np.pi / np.abs(sharpness))
    sine, cosine = fresnel(length / scale)
    exact = scale * (cosine + 1j * np.sign(sharpness) * sine)
    displacements = ramps(jnp.full(2, length), jnp.asarray(sharpness))
    np.testing.assert_allclose(displacements, exact, rtol=1e-11, atol=1e-12)  # the series' next term there: 1e-14


def test_an_arc_is_a_circle_with_a_smooth_limit_to_a_line():
    curvature = np.array([2e-3, -1e-3, 1e-10, -1e-13, 0.0, 3.9e-11, 4.1e-11])
    length = 500.0
    displacements = np.asarray(arcs(jnp.full(curvature.size, length), jnp.asarray(curvature)))
    angle = curvature * length
    # (exp(i a) - 1) / (i a), by its series where a is small.
    small = np.abs(angle) < 1e-4
    circle = np.where(
        small, 1 + 0.5j * angle - angle**2 / 6, (np.exp(1j * angle) - 1) / (1j * np.where(small, 1.0, angle))
    )
    np.testing.assert_allclose(displacements, length * circle, rtol=1e-12)  # (1e-4)^3 / 24
    slopes_by_curvature = compiled_quickly(jax.vmap(jax.grad(lambda k: jnp.imag(along_arc(length, k)))))
    slopes_there = slopes_by_curvature(jnp.asarray(curvature[2:]))
    np.testing.assert_allclose(slopes_there, 0.5 * length**2, rtol=1e-6)


def test_a_heading_is_a_unit_vector_north_then_east():
    np.testing.assert_allclose(cis(jnp.array([0.0, 0.5 * np.pi, np.pi])), [1, 1j, -1], atol=1e-15)
