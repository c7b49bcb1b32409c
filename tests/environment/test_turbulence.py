"""Turbulence at an aircraft: intensities and scales of the documents, rates from gradients, axes by height."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.environment import DiscreteGust, Turbulence
from anser.environment.gusts import AirFlow, NoGusts, SummedGusts
from anser.environment.turbulence import roll_sigma, turbulence_levels
from anser.scenario.build_environment import exceedance_table

FOOT, KNOT = 0.3048, 1852.0 / 3600.0
SPAN = 9.144


def turbulence(family="dryden", log_probability=-3.0, wind=30.0 * KNOT):
    return Turbulence(
        jnp.asarray(wind), jnp.asarray(log_probability), exceedance_table(), jnp.asarray(SPAN), family=family
    )


def flow(height=3000.0, airspeed=150.0, time=0.0, heading=0.0):
    c, s = np.cos(heading), np.sin(heading)
    rotation = jnp.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return AirFlow(jnp.asarray(airspeed), jnp.asarray(height), rotation, jnp.zeros(3), jnp.asarray(time))


def level(height_ft, probability=1e-3, wind=30.0, family="dryden"):
    return _LEVELS(height_ft * FOOT, wind * KNOT, np.log10(probability), exceedance_table(), family)


_LEVELS = jax.jit(turbulence_levels, static_argnums=4)


@eqx.filter_jit
def start(gusts, normals, conditions):
    return gusts.init(normals, conditions)


@eqx.filter_jit
def advance(gusts, memory, normals, conditions, step):
    return gusts.advance(memory, normals, conditions, step)


@eqx.filter_jit
def gust_at(gusts, memory, conditions):
    return gusts.at(memory, conditions)


@eqx.filter_jit
def levels_at(gusts, conditions):
    return gusts.levels(conditions)


@pytest.mark.parametrize(
    ("height_ft", "probability", "sigma_ft_s"),
    [(3750, 1e-2, 7.4), (7500, 1e-3, 10.1), (25000, 1e-5, 20.0), (45000, 1e-2, 0.0), (80000, 1e-6, 7.2)],
)
def test_intensities_are_those_of_the_table(height_ft, probability, sigma_ft_s):
    """MIL-F-8785C, figure 7."""
    levels = level(height_ft, probability)
    np.testing.assert_allclose(levels.sigmas, sigma_ft_s * FOOT, atol=1e-9)
    np.testing.assert_allclose(levels.lengths, 1750.0 * FOOT)
    assert float(level(height_ft, probability, family="von-karman").lengths[0]) == pytest.approx(2500.0 * FOOT)


def test_turbulence_at_low_altitude_depends_on_the_height():
    """MIL-F-8785C, 3.7.3: at 200 ft and 30 kt."""
    levels = level(200.0)
    shape = 0.177 + 0.000823 * 200.0
    np.testing.assert_allclose(levels.lengths, np.array([200.0 / shape**1.2] * 2 + [200.0]) * FOOT)
    sigma = 0.1 * 30.0 * KNOT
    np.testing.assert_allclose(levels.sigmas, [sigma / shape**0.4] * 2 + [sigma])
    assert levels.altitude_blend == 0.0
    np.testing.assert_allclose(level(2.0).sigmas, level(10.0).sigmas)


def test_turbulence_at_medium_altitude_is_interpolated():
    low, middle, high = level(1000.0), level(1500.0), level(2000.0)
    np.testing.assert_allclose(middle.lengths, 0.5 * (low.lengths + high.lengths))
    np.testing.assert_allclose(middle.sigmas, 0.5 * (low.sigmas + high.sigmas))
    assert float(middle.altitude_blend) == pytest.approx(0.5)


@pytest.mark.parametrize("family", ["dryden", "von-karman"])
def test_gusts_have_the_published_intensity_and_rates_are_gradients(family):
    """Standard deviations over many flights; q is minus the low-passed gradient of w along the flight."""
    gusts, count, step = turbulence(family), 400, 0.05
    rng = np.random.default_rng(1)
    conditions = flow()

    def flight(initial, noise):
        def forward(memory, normals):
            return gusts.advance(memory, normals, conditions, step), gusts.at(memory, conditions)

        return jax.lax.scan(forward, gusts.init(initial, conditions), noise)[1]

    drawn = rng.normal(size=(count, 401, gusts.normals))
    gust = jax.jit(jax.vmap(flight))(jnp.asarray(drawn[:, 0]), jnp.asarray(drawn[:, 1:]))
    levels = levels_at(gusts, conditions)
    sigma = float(levels.sigmas[0])
    velocity, rates = np.asarray(gust.velocity_b), np.asarray(gust.rates_b)
    expected = 1.0 if family == "dryden" else np.sqrt(0.945)
    np.testing.assert_allclose(velocity.std(axis=(0, 1)) / sigma, expected, rtol=0.06)
    length = float(levels.lengths[2])
    np.testing.assert_allclose(rates[..., 0].std(), roll_sigma(length, sigma, SPAN), rtol=0.06)
    correlation = np.corrcoef(velocity.reshape(-1, 3).T)
    assert np.max(np.abs(correlation - np.eye(3))) < 0.1
    # the low-passed gradient integrates to the gust, seen through the same low-pass
    lag = 4.0 * SPAN / (np.pi * 150.0)
    w, q = velocity[..., 2], rates[..., 1]
    passed = np.zeros_like(w)
    passed[:, 0] = w[:, 0] + 150.0 * lag * q[:, 0]
    decay = np.exp(-step / lag)
    mean = (1.0 - decay) * lag / step
    for k in range(w.shape[1] - 1):
        passed[:, k + 1] = decay * passed[:, k] + (mean - decay) * w[:, k] + (1.0 - mean) * w[:, k + 1]
    np.testing.assert_allclose(q, (passed - w) / (150.0 * lag), atol=1e-9)
    # r has the opposite sign, and a shorter low-pass
    lag_r = 3.0 * SPAN / (np.pi * 150.0)
    r, v = rates[..., 2], velocity[..., 1]
    assert np.corrcoef((v[:, 1:] - v[:, :-1]).ravel(), r[:, 1:].ravel())[0, 1] > 0.5
    assert abs(r).max() < 4.0 * abs(v).max() / (150.0 * lag_r)
    # The tail, 7.5 m behind, meets the air 0.05 s later: what it meets is the motion of air that rotates by q and r.
    behind = 150.0 * step
    of_tail = (w[:, :-1] - w[:, 1:]) / behind, (v[:, 1:] - v[:, :-1]) / behind
    for rate, fitted in zip((q[:, 1:], r[:, 1:]), of_tail, strict=True):
        assert np.corrcoef(rate.ravel(), fitted.ravel())[0, 1] > 0.8  # a low-pass over the span remains


def test_gust_axes_are_level_at_low_and_body_axes_at_high_altitude():
    gusts = turbulence()
    memory = start(gusts, jnp.ones(gusts.normals), flow())
    nose_up = eqx.tree_at(
        lambda f: f.R_bn, flow(height=100.0), jnp.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    )
    high = eqx.tree_at(lambda f: f.height, nose_up, jnp.asarray(3000.0))
    w = float(gust_at(gusts, memory, high).velocity_b[2])
    np.testing.assert_allclose(w, float(gust_at(gusts, memory, flow()).velocity_b[2]))
    low = np.asarray(gust_at(gusts, memory, nose_up).velocity_b)
    sigma = np.asarray(levels_at(gusts, nose_up).sigmas)
    np.testing.assert_allclose(low[0], -sigma[2] * float(gusts.filters[1].output(memory.w)), rtol=1e-12)


@pytest.mark.long
def test_gusts_of_zero_intensity_vanish_with_finite_gradients():
    calm = turbulence(wind=0.0, log_probability=-1.0)
    memory = start(calm, jnp.ones(calm.normals), flow(height=100.0))
    np.testing.assert_array_equal(gust_at(calm, memory, flow(height=100.0)).velocity_b, np.zeros(3))

    def met(airspeed, wind):
        gusts, conditions = turbulence(wind=wind), flow(height=200.0, airspeed=airspeed)
        memory = gusts.init(jnp.ones(gusts.normals), conditions)
        gust = gusts.at(gusts.advance(memory, jnp.ones(gusts.normals), conditions, 0.01), conditions)
        return jnp.sum(gust.velocity_b) + jnp.sum(gust.rates_b)

    assert np.all(np.isfinite(jax.jit(jax.grad(met, argnums=(0, 1)))(150.0, 10.0)))


@pytest.mark.parametrize(("returns", "last"), [(True, 0.0), (False, 6.0)])
def test_a_discrete_gust_is_one_minus_cosine(returns, last):
    """MIL-F-8785C, 3.7.1.3: half amplitude at half the length, full amplitude at the length."""
    gust = DiscreteGust(jnp.array([0.0, 2.0, 6.0]), jnp.asarray(120.0), jnp.asarray(1.0), jnp.asarray(returns))

    def step(memory, time):
        velocity_b = gust.at(memory, flow(time=time)).velocity_b
        return gust.advance(memory, jnp.zeros(0), flow(time=time), 0.01), velocity_b

    initial = gust.init(jnp.zeros(0), flow())
    velocities = np.asarray(jax.jit(lambda times: jax.lax.scan(step, initial, times)[1])(0.01 * np.arange(500)))
    np.testing.assert_allclose(velocities[:101], 0.0)
    np.testing.assert_allclose(velocities[140], [0.0, 1.0, 3.0], atol=1e-9)  # 60 m on
    np.testing.assert_allclose(velocities[180], [0.0, 2.0, 6.0], atol=1e-9)
    np.testing.assert_allclose(velocities[-1, 2], last, atol=1e-9)


def test_the_sum_of_gusts_adds_the_parts():
    gust = DiscreteGust(jnp.array([0.0, 2.0, 6.0]), jnp.asarray(120.0), jnp.asarray(0.0), jnp.asarray(False))
    total = SummedGusts((turbulence(), gust, NoGusts()))
    normals = jnp.asarray(np.random.default_rng(0).normal(size=total.normals))
    memory = advance(total, start(total, normals, flow()), normals, flow(), 0.5)
    alone = turbulence()
    state = advance(alone, start(alone, normals, flow()), normals, flow(), 0.5)
    single = gust.at(gust.advance(gust.init(jnp.zeros(0), flow()), jnp.zeros(0), flow(), 0.5), flow())
    expected = gust_at(alone, state, flow()).velocity_b + single.velocity_b
    np.testing.assert_allclose(gust_at(total, memory, flow()).velocity_b, expected, rtol=1e-12)
