"""Height needed to end a descent: against integrated motion, and special cases."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.constants import STANDARD_GRAVITY_M_S2 as GRAVITY
from anser.control.ground_clearance import REACTION_S, level_off_height, required_pull

height, pull_for = jax.jit(level_off_height), jax.jit(required_pull)
values_and_slopes = {
    function: jax.jit(jax.value_and_grad(lambda x, f=function: f(*x))) for function in (level_off_height, required_pull)
}
heights = jax.jit(jax.vmap(level_off_height, in_axes=(None, 0, None, None, None)))


def integrated(speed, gamma, pull, step=1e-4):
    """Height lost until level: reaction time at constant sink without thrust or drag, then V gamma_dot = pull."""
    fallen = speed * math.sin(gamma) * REACTION_S
    V, angle, lost = math.sqrt(speed**2 + 2 * GRAVITY * fallen), 0.0, fallen
    angle = math.asin(speed * math.sin(gamma) / V)
    while angle > 0.0:
        middle = angle - 0.5 * step * pull / V
        lost += step * V * math.sin(middle)
        V += step * GRAVITY * math.sin(middle)
        angle -= step * pull / V
    return lost


@pytest.mark.parametrize("speed", [95.0, 150.0, 240.0])
@pytest.mark.parametrize("gamma_deg", [5.0, 20.0, 45.0, 70.0])
@pytest.mark.parametrize("pull", [6.0, 20.0])
def test_the_height_equals_that_of_the_integrated_motion(speed, gamma_deg, pull):
    gamma = np.radians(gamma_deg)
    # Euler steps of 0.1 ms: 1e-4 of the height
    assert height(speed, speed * np.sin(gamma), 0.0, 0.0, pull) == pytest.approx(
        integrated(speed, gamma, pull), rel=1e-3
    )


def test_a_short_arc_is_a_circle():
    speed, gamma, pull = 150.0, np.radians(3.0), 10.0
    sink = speed * np.sin(gamma)
    # what is left out is the speed gained on the way: 2 g of 15 m over V^2, and half of that of the arc
    assert height(speed, sink, 0.0, 0.0, pull) == pytest.approx(
        sink * REACTION_S + speed**2 * (1 - np.cos(gamma)) / pull, rel=5e-3
    )


def test_an_aircraft_without_sink_needs_no_height():
    for sink, bank in ((0.0, 0.0), (-20.0, 0.0), (0.0, 1.0), (-30.0, 2.0)):
        assert height(150.0, sink, 0.0, bank, 5.0) == 0.0


def test_bank_push_and_weak_pull_cost_height():
    nominal_height = height(150.0, 30.0, 0.0, 0.0, 20.0)
    assert height(150.0, 30.0, 0.0, 1.0, 20.0) > nominal_height + 29.9  # a second more of sinking
    assert height(150.0, 30.0, 5.0, 0.0, 20.0) > nominal_height + 2.5
    assert height(150.0, 30.0, 0.0, 0.0, 10.0) > nominal_height
    # on its back: 4 s, of which all without lift
    assert height(150.0, 30.0, 0.0, np.pi, 20.0) > 30.0 * 4.1 + 0.5 * GRAVITY * 4.1**2


@pytest.mark.parametrize("bank", [0.0, 0.8])
def test_the_required_pull_ends_the_descent_within_the_height(bank):
    speed, sink, room = 150.0, 40.0, 250.0
    pull = pull_for(speed, sink, bank, room)
    # without the speed that is gained on the way, which the pull of the next instant makes up for
    assert height(speed, sink, 0.0, bank, pull) == pytest.approx(room, rel=0.1)
    assert pull_for(speed, 0.0, bank, room) == 0.0
    assert pull_for(speed, -10.0, bank, -5.0) == 0.0
    assert np.isfinite(pull_for(speed, sink, bank, -100.0))


@pytest.mark.parametrize("sink", [0.0, -10.0, 40.0, 150.0, 200.0])
def test_values_and_gradients_are_finite(sink):
    numbers = [jnp.asarray(x) for x in (150.0, sink, 0.0, 0.0, 0.0)]
    for function, count in ((level_off_height, 5), (required_pull, 4)):
        value, slope = values_and_slopes[function](numbers[:count])
        assert np.isfinite(value)
        assert np.isfinite(slope).all()
    batch = heights(150.0, jnp.array([10.0, sink]), 1.0, 0.2, 9.0)
    np.testing.assert_allclose(batch[1], height(150.0, sink, 1.0, 0.2, 9.0), rtol=1e-12)
