"""Gusts: smooth air, the discrete gust of the standards, and sums."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.environment import AbstractGusts, DiscreteGust
from anser.environment.gusts import AirFlow, NoGusts, SummedGusts

NONE_DRAWN = jnp.zeros(0)


def flow(airspeed=150.0, time=0.0):
    return AirFlow(jnp.asarray(airspeed), jnp.asarray(500.0), jnp.eye(3), jnp.zeros(3), jnp.asarray(time))


def discrete(amplitudes=(0.0, 2.0, 6.0), length=120.0, start=0.0, returns=False):
    return DiscreteGust(jnp.array(amplitudes), jnp.asarray(length), jnp.asarray(start), jnp.asarray(returns))


def test_smooth_air_draws_no_numbers_and_has_no_gusts():
    calm = NoGusts()
    assert calm.normals == 0
    memory = calm.advance(calm.init(NONE_DRAWN, flow()), NONE_DRAWN, flow(), 0.01)
    assert memory is None
    gust = calm.at(memory, flow())
    np.testing.assert_array_equal(gust.velocity_b, np.zeros(3))
    np.testing.assert_array_equal(gust.rates_b, np.zeros(3))


_MET = jax.jit(lambda gust, way: gust.at(way, flow()))
_ADVANCE = jax.jit(lambda gust, way, air_flow, step: gust.advance(way, NONE_DRAWN, air_flow, step))


@settings(deadline=None, max_examples=80)
@given(st.tuples(*[st.floats(-30.0, 30.0)] * 3), st.floats(1.0, 2000.0), st.floats(0.0, 6000.0), st.booleans())
def test_a_discrete_gust_has_the_published_form(amplitudes, length, way, returns):
    """MIL-F-8785C, 3.7.1.3: V_m/2 (1 - cos(pi x/d_m)) up to d_m, beyond V_m, or back to zero at 2 d_m."""
    gust = _MET(discrete(amplitudes, length, returns=returns), jnp.asarray(way))
    end = 2.0 * length if returns else length
    expected = np.array(amplitudes) / 2.0 * (1.0 - np.cos(np.pi * min(way, end) / length))
    np.testing.assert_allclose(gust.velocity_b, expected, atol=1e-12)  # the cosine at up to 2 pi rounds by 1e-15
    np.testing.assert_array_equal(gust.rates_b, np.zeros(3))


@settings(deadline=None, max_examples=40)
@given(st.floats(0.0, 300.0), st.floats(0.001, 0.1))
def test_the_gust_distance_is_flown_through_the_air_from_the_start(airspeed, step):
    gust = discrete(start=1.0)
    initial = _ADVANCE(gust, gust.init(NONE_DRAWN, flow(airspeed)), flow(airspeed, 0.999), step)
    assert float(initial) == 0.0
    distance = _ADVANCE(gust, initial, flow(airspeed, 1.0), step)
    np.testing.assert_allclose(distance, airspeed * step, atol=1e-300)  # below it, JAX counts numbers as none


def test_the_sum_divides_the_normals_in_order():
    """Each part with random numbers gets a separate section of the normals."""

    class Drawn(AbstractGusts):
        count: int

        @property
        def normals(self):
            return self.count

        def init(self, normals, flow):
            return normals

        def at(self, memory, flow):
            return NoGusts().at(None, flow)

        def advance(self, memory, normals, flow, step):
            return memory + step * normals

    total = SummedGusts((Drawn(2), NoGusts(), discrete(), Drawn(3)))
    assert total.normals == 5
    drawn = jnp.arange(5.0)
    memory = total.init(drawn, flow())
    np.testing.assert_array_equal(memory[0], [0.0, 1.0])
    np.testing.assert_array_equal(memory[3], [2.0, 3.0, 4.0])
    new_state = total.advance(memory, 10.0 * drawn, flow(), 0.1)
    np.testing.assert_allclose(new_state[3], [4.0, 6.0, 8.0])
    np.testing.assert_allclose(new_state[2], 15.0)


@pytest.mark.parametrize("part", [0.25, 0.5, 1.0])
def test_two_discrete_gusts_add_up(part):
    gust_1, gust_2 = discrete((1.0, 0.0, 0.0), 100.0), discrete((3.0, 0.0, -4.0), 100.0)
    distance = jnp.asarray(100.0 * part)
    total = SummedGusts((gust_1, gust_2)).at((distance, distance), flow())
    share = 0.5 * (1.0 - np.cos(np.pi * part))
    np.testing.assert_allclose(total.velocity_b, share * np.array([4.0, 0.0, -4.0]), atol=1e-15)


def test_gusts_support_gradients_and_batches():
    """Derivative by the length: -V_m/2 sin(pi x/d) pi x/d^2; finite at the start, peak and end of the gust."""
    gust = discrete((0.0, 0.0, 6.0), 120.0, returns=True)

    def w(length, distance):
        return discrete((0.0, 0.0, 6.0), length, returns=True).at(distance, flow()).velocity_b[2]

    slope = jax.jit(jax.grad(w))(120.0, jnp.asarray(60.0))
    np.testing.assert_allclose(slope, -3.0 * np.pi * 60.0 / 120.0**2, rtol=1e-12)
    distances = jnp.array([0.0, 60.0, 120.0, 240.0, 1e4])
    slopes = jax.jit(jax.vmap(jax.grad(w, argnums=(0, 1)), in_axes=(None, 0)))(120.0, distances)
    assert np.all(np.isfinite(slopes))
    batch = jax.jit(jax.vmap(lambda way: gust.at(way, flow()).velocity_b))(distances)
    np.testing.assert_allclose(batch[:, 2], [0.0, 3.0, 6.0, 0.0, 0.0], atol=1e-12)
