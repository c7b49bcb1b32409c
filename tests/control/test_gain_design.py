"""Gains from bandwidth and damping: the published gains are reproduced, and the poles are as required."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.control import published_gains
from anser.control.gains import design_gains
from anser.control.loop_separations import LOOP_SEPARATION_MIN
from support.loops import loop_bandwidth, separations_of

three = jnp.ones(3)


@pytest.mark.parametrize(
    ("loop", "bandwidth", "damping", "derivative"),
    [("rates", 5.0, np.sqrt(50.0), 1.0), ("attitude", 2.0, np.inf, 0.0), ("velocity", 1.0, np.sqrt(10.0), 0.0)],
)
def test_published_gains_follow_from_bandwidth_and_damping(loop, bandwidth, damping, derivative):
    designed, published = design_gains(bandwidth * three, damping * three, derivative), getattr(published_gains(), loop)
    for name in ("proportional", "integral", "derivative", "feed_forward"):
        np.testing.assert_allclose(getattr(designed, name), getattr(published, name), rtol=1e-14, err_msg=name)
    np.testing.assert_allclose(loop_bandwidth(published), bandwidth)


@settings(deadline=None, max_examples=30)
@given(st.floats(0.1, 50.0), st.floats(0.2, 10.0), st.floats(0.0, 3.0))
def test_poles_have_the_required_sum_and_damping(bandwidth, damping, derivative):
    gains = design_gains(bandwidth * three, damping * three, derivative)
    poles = np.roots([1.0 + derivative, float(gains.proportional[0]), float(gains.integral[0])])
    assert -np.sum(poles).real == pytest.approx(bandwidth, rel=1e-9)
    frequency = np.sqrt(np.prod(poles).real)
    assert -np.sum(poles).real / (2 * frequency) == pytest.approx(damping, rel=1e-9)


def test_published_loops_are_separated():
    ratios = {(pair.outer, pair.inner): float(pair.ratio) for pair in separations_of(published_gains())}
    expected = {
        ("V", "engine"): 5.0,
        ("gamma", "alpha"): 2.0,
        ("chi", "mu"): 2.0,
        ("mu", "P"): 2.5,
        ("Q", "surfaces"): 8.0,
    }
    for pair, ratio in expected.items():
        assert ratios[pair] == pytest.approx(ratio), pair
    assert min(ratios.values()) == LOOP_SEPARATION_MIN
    open_loop = eqx.tree_at(lambda g: g.velocity.proportional, published_gains(), jnp.zeros(3))
    assert float(separations_of(open_loop)[1].ratio) == np.inf
