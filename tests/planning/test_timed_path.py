"""Timed paths: exact quintics through the knots, smooth, straight beyond both ends."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import BPoly

from anser.compiling.options import compiled_quickly
from anser.compiling.single_kernel import as_single_kernel
from anser.numerics.arrays import cast_to_precision
from anser.planning import TimedPath
from anser.planning.timed_path import hermite_quintic

TIMES = np.array([10.0, 10.0, 11.5, 12.0, 12.0, 12.0, 15.5, 16.0, 16.0])
"""With empty cells at the beginning, in between and at the end."""


def quintics(seed=0):
    """Three random polynomials of degree 5, of magnitude 1 to 1000."""
    scale = np.array([1000.0, 150.0, 5.0, 0.3, 0.05, 0.01])
    return [Polynomial(c) for c in scale * np.random.default_rng(seed).normal(size=(3, 6))]


def knots_of(polynomials, times):
    """Values and two derivatives at times: (knot, order, axis)."""
    orders = [[p.deriv(k)(times - 10.0) if k else p(times - 10.0) for p in polynomials] for k in range(3)]
    return jnp.asarray(np.transpose(orders, (2, 0, 1)))


def random_path(seed=3):
    rng = np.random.default_rng(seed)
    scale = np.array([1000.0, 100.0, 10.0])[:, None]
    air, drift = (scale * rng.normal(size=(TIMES.size, 3, 3)) for _ in range(2))
    for k in np.flatnonzero(np.diff(TIMES) == 0.0):  # one knot has one state
        air[k + 1], drift[k + 1] = air[k], drift[k]
    return TimedPath(jnp.asarray(TIMES), jnp.asarray(air), jnp.asarray(drift))


def states(path, time):
    return (
        jnp.stack([path.position_n(time), path.velocity_n(time), path.acceleration_n(time)]),
        path.air_velocity_n(time),
        path.states_n(time),
        jax.jacfwd(path.position_n)(time),
    )


acceleration = jax.jit(lambda path, time: path.at(time).acceleration_n)
length_from = jax.jit(TimedPath.air_length)
quintic = jax.jit(hermite_quintic)
at_times = compiled_quickly(jax.vmap(states, in_axes=(None, 0)))


def sample(path, times):
    """Ground, air and drift (time, order, axis), slope of the air path, and derivative of the position."""
    return jax.tree.map(np.asarray, at_times(path, jnp.asarray(times)))


def test_a_path_reproduces_a_quintic_on_any_knots():
    air, drift = quintics(0), quintics(1)
    path = TimedPath(jnp.asarray(TIMES), knots_of(air, TIMES), knots_of(drift, TIMES))
    times = np.linspace(10.0, 16.0, 301)
    ground, slope, (through_air, drifted), derivative = sample(path, times)
    air_knots, drift_knots = (np.asarray(knots_of(p, times)) for p in (air, drift))
    # Values to 1e4 m; second derivatives lose two powers of the shortest cell, 0.5 s.
    for sampled, exact in ((ground, air_knots + drift_knots), (through_air, air_knots), (drifted, drift_knots)):
        np.testing.assert_allclose(sampled, exact, atol=1e-9)
    np.testing.assert_allclose(slope, air_knots[:, 1], atol=1e-10)
    np.testing.assert_allclose(derivative, ground[:, 1], atol=1e-9)


def test_a_path_equals_scipys_interpolant_of_the_knots():
    path = random_path()
    ground = np.asarray(path.air_n + path.drift_n)
    real = np.append(True, np.diff(TIMES) > 0.0)
    oracle = BPoly.from_derivatives(TIMES[real], ground[real])
    times = np.linspace(10.0, 15.9999, 301)
    values = sample(path, times)[0]
    for order in range(3):
        exact = oracle.derivative(order)(times) if order else oracle(times)
        # Rounding of 1e3 m, divided by up to (0.5 s)^2 and multiplied by 60.
        np.testing.assert_allclose(values[:, order], exact, rtol=1e-11, atol=1e-9)


def test_a_path_is_twice_continuously_differentiable_at_knots():
    path = random_path()
    inner = np.unique(TIMES)[1:-1]
    above, below = sample(path, inner)[0], sample(path, np.nextafter(inner, 0.0))[0]
    # A step of 2e-15 s times jerks of 1e5 m/s^3, and the rounding of the test above.
    np.testing.assert_allclose(above, below, rtol=1e-11, atol=1e-8)
    knots = np.asarray(path.air_n + path.drift_n)
    knot_indices = np.searchsorted(TIMES, inner)
    np.testing.assert_allclose(above, knots[knot_indices], rtol=1e-12, atol=1e-9)


def test_a_path_is_straight_before_the_start_and_after_the_arrival():
    path = random_path()
    ground = np.asarray(path.air_n + path.drift_n)
    for times, knot, edge in ((np.array([-5.0, 9.0, 9.999]), 0, 10.0), (np.array([16.001, 18.0, 50.0]), -1, 16.0)):
        values, slope, _, derivative = sample(path, times)
        value, velocity, _ = ground[knot]
        np.testing.assert_allclose(values[:, 0], value + (times - edge)[:, None] * velocity, rtol=1e-12)  # rounding
        np.testing.assert_allclose(values[:, 1], np.tile(velocity, (3, 1)), rtol=1e-10)
        np.testing.assert_array_equal(values[:, 2], 0.0)
        np.testing.assert_allclose(derivative, values[:, 1], rtol=1e-12)
        np.testing.assert_allclose(slope, np.tile(path.air_n[knot, 1], (3, 1)), rtol=1e-10)


def test_a_path_in_a_single_kernel_has_the_same_cells():
    """The single kernel searches the cell, the other programs compare the time with every knot."""
    path, times = random_path(), jnp.asarray(np.concatenate([TIMES, np.linspace(9.0, 17.0, 81)]))
    single = jax.jit(as_single_kernel(jax.vmap(lambda path, time: path.acceleration_n(time), in_axes=(None, 0))))
    expected = np.asarray(jax.jit(jax.vmap(path.acceleration_n))(times))
    np.testing.assert_allclose(single(path, times), expected, rtol=0.0, atol=1e-9 * np.max(np.abs(expected)))


def test_a_start_time_rounded_in_float32_gives_the_start():
    path = random_path()
    rounded = cast_to_precision(path, np.float32)
    first_position = np.asarray(path.air_n + path.drift_n)[0, 2]
    below = jnp.asarray(np.nextafter(np.float32(10.0), np.float32(0.0)))
    np.testing.assert_allclose(acceleration(rounded, below), first_position, rtol=1e-3)  # its change in a microsecond
    np.testing.assert_array_equal(acceleration(rounded, jnp.asarray(9.99, jnp.float32)), 0.0)
    np.testing.assert_array_equal(acceleration(path, jnp.asarray(np.nextafter(10.0, 0.0))), 0.0)


def test_the_ends_of_a_path_have_the_first_and_last_state():
    path = random_path()
    values = sample(path, np.array([10.0, 16.0]))[0]
    ground = np.asarray(path.air_n + path.drift_n)
    np.testing.assert_allclose(values, ground[[0, -1]], rtol=1e-11, atol=1e-9)  # as scipy's
    assert (path.start_time, path.arrival_time, path.duration) == (10.0, 16.0, 6.0)


@pytest.mark.long
def test_stacked_paths_equal_single_paths():
    paths = [random_path(seed) for seed in (1, 2)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *paths)
    times = jnp.array([9.0, 12.0, 14.2])
    together = jax.jit(jax.vmap(at_times, in_axes=(0, None)))(stacked, times)[0]
    for k, path in enumerate(paths):
        np.testing.assert_allclose(together[k], at_times(path, times)[0], rtol=1e-12, atol=1e-9)  # rounding


@pytest.mark.parametrize("span", [1e-2, 1.0, 100.0])
def test_a_cell_is_accurate_far_from_the_origin(span):
    # A steady turn 100 km away: the acceleration in a cell of a hundredth of a second is the difference of positions.
    def state(t):
        position_n = 1e5 + np.array([5000.0 * np.sin(0.03 * t), 5000.0 * np.cos(0.03 * t), -2.0 * t])
        rate = np.array([150.0 * np.cos(0.03 * t), -150.0 * np.sin(0.03 * t), -2.0])
        return jnp.asarray(
            np.stack([position_n, rate, np.array([-4.5 * np.sin(0.03 * t), -4.5 * np.cos(0.03 * t), 0.0])])
        )

    values = quintic(state(7.0), state(7.0 + span), span, 0.5)
    # Positions are rounded to 1.5e-11 m: divided by span^2, times 6. A quintic's own error: 5000 m (0.03 span)^6 / 46080.
    rounding = 1e-10 / span**2
    fit = 5000.0 * (0.03 * span) ** 6
    np.testing.assert_allclose(values[2], state(7.0 + 0.5 * span)[2], atol=rounding + 0.1 * fit / span**2 + 1e-13)
    np.testing.assert_allclose(values[0], state(7.0 + 0.5 * span)[0], atol=3e-11 + fit / 46080)


def test_the_length_is_measured_through_the_air_in_space():
    """A helix of 300 m radius descending at 20 m/s in drifting air: known length, in total and from a time on."""
    times, rate, sink = np.linspace(0.0, 60.0, 121), 0.5, 20.0
    angle = rate * times
    ring = 300.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    tangent_n = 300.0 * np.stack([-np.sin(angle), np.cos(angle), np.zeros_like(angle)])
    down = np.array([0.0, 0.0, 1.0])[:, None]
    knots = np.stack([ring + sink * times * down, rate * tangent_n + sink * down, -(rate**2) * ring])
    drift = np.zeros((121, 3, 3))
    drift[:, 0, 0], drift[:, 1, 0] = 15.0 * times, 15.0
    path = TimedPath(jnp.asarray(times), jnp.asarray(np.moveaxis(knots, 2, 0)), jnp.asarray(drift))
    speed = np.hypot(rate * 300.0, sink)
    # quintics through exact states every 0.25 rad: the speed is off by less than 1e-6 of itself
    assert float(length_from(path)) == pytest.approx(60.0 * speed, rel=1e-6)
    assert float(length_from(path, 12.3)) == pytest.approx(47.7 * speed, rel=1e-6)
    assert float(length_from(path, 70.0)) == 0.0
