"""Allocation to any number of surfaces: redundant surfaces share, saturated ones are relieved, yaw may be free."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft.actuators import Deflections, MovingDeflections
from anser.control.allocation import allocate, surface_moments
from anser.environment import standard_environment
from anser.units import DEG_RAD
from support.light_aircraft import light_aircraft
from support.other_surfaces import elevon_aircraft, split_aileron_aircraft
from support.states import condition_of, make_state

ENVIRONMENT = standard_environment()
SPLIT, ELEVONS, LIGHT = split_aileron_aircraft(), elevon_aircraft(), light_aircraft()


def condition_with(airframe, surfaces):
    base = make_state(V=55.0, alpha=0.03, beta=0.0, rates=(0.0, 0.0, 0.0), altitude=500.0)
    surfaces = jnp.asarray(surfaces)
    is_second_order = hasattr(airframe.actuators, "damping")
    moved = MovingDeflections(surfaces, jnp.zeros_like(surfaces)) if is_second_order else Deflections(surfaces)
    state = eqx.tree_at(lambda s: s.actuators, base, moved)
    return condition_of(airframe, ENVIRONMENT, 0.0, state), state


@eqx.filter_jit
def allocated(airframe, condition, state, target_b):
    """Demand for a moment, and the resulting moment."""
    present = surface_moments(airframe, condition, state.rates_b, state.surfaces)
    demand = allocate(airframe, condition, state.rates_b, present, target_b)
    moment_b = (
        airframe.aerodynamics(condition.air_data, state.rates_b, demand.surfaces).moment_b
        + condition.propulsive.moment_b
    )
    return demand, moment_b


@eqx.filter_jit
def moment_of(airframe, condition, state, surfaces):
    aerodynamic_b = airframe.aerodynamics(condition.air_data, state.rates_b, surfaces).moment_b
    return aerodynamic_b + condition.propulsive.moment_b


def test_redundant_surfaces_share_and_give_the_moment():
    condition, state = condition_with(SPLIT, [0.02, 0.1, -0.05, 0.03])
    target_b = moment_of(SPLIT, condition, state, jnp.array([-4.0, 6.0, 2.0, -3.0]) * DEG_RAD)
    demand, moment_b = allocated(SPLIT, condition, state, target_b)
    assert not np.any(demand.saturated)
    # what cannot be had is weighed with 1e-6 of the square of the greatest moment: a share of 1e-5 at most
    np.testing.assert_allclose(moment_b, target_b, atol=2e-5 * np.max(np.abs(target_b)))
    left_aileron, right_aileron = np.asarray(demand.surfaces)[1:3]
    np.testing.assert_allclose(
        [left_aileron, right_aileron], 4.0 * DEG_RAD, rtol=1e-4
    )  # as little as will do: the same of both


def test_a_redundant_surface_compensates_for_a_surface_at_its_stop():
    tight = eqx.tree_at(
        lambda a: (a.actuators.lower, a.actuators.upper),
        SPLIT,
        (SPLIT.actuators.lower.at[1].set(-1 * DEG_RAD), SPLIT.actuators.upper.at[1].set(1 * DEG_RAD)),
    )
    condition, state = condition_with(tight, [0.0, 0.0, 0.0, 0.0])
    target_b = moment_of(tight, condition, state, jnp.array([0.0, 0.0, 15.0, 0.0]) * DEG_RAD)
    demand, moment_b = allocated(tight, condition, state, target_b)
    surfaces = np.asarray(demand.surfaces) / DEG_RAD
    assert surfaces[1] <= 1.0 + 1e-9
    np.testing.assert_allclose(moment_b, target_b, atol=2e-5 * np.max(np.abs(target_b)))
    np.testing.assert_allclose(surfaces[1] + surfaces[2], 15.0, rtol=1e-3)


def test_pitch_has_priority_over_roll_beyond_the_stops():
    """Both elevons together cannot give both moments: pitch is nearly met, roll falls short."""
    condition, state = condition_with(ELEVONS, [0.0, 0.0])
    target_b = moment_of(ELEVONS, condition, state, jnp.array([-10.0 + 25.0, -10.0 - 25.0]) * DEG_RAD)
    demand, moment_b = allocated(ELEVONS, condition, state, target_b)
    assert np.all(np.abs(demand.surfaces) <= 25.0 * DEG_RAD + 1e-12)
    assert np.any(demand.saturated)
    plain = moment_of(ELEVONS, condition, state, jnp.clip(jnp.array([15.0, -35.0]), -25.0, 25.0) * DEG_RAD)
    assert abs(moment_b[1] - target_b[1]) < 0.5 * abs(plain[1] - target_b[1])
    assert abs(moment_b[0]) < abs(target_b[0])


def test_two_elevons_give_roll_and_pitch_and_leave_the_yaw():
    condition, state = condition_with(ELEVONS, [0.01, -0.01])
    assert not ELEVONS.actuators.controls_yaw
    aim = jnp.array([3.0, -5.0]) * DEG_RAD
    target_b = moment_of(ELEVONS, condition, state, aim)
    demand, moment_b = allocated(ELEVONS, condition, state, target_b.at[2].add(100.0))
    np.testing.assert_allclose(moment_b[:2], target_b[:2], rtol=2e-3)
    np.testing.assert_allclose(demand.surfaces, aim, atol=2e-3)


def test_one_surface_per_axis_is_exact():
    condition, state = condition_with(LIGHT, [0.0, 0.0, 0.0])
    target_b = moment_of(LIGHT, condition, state, jnp.array([-3.0, 4.0, 2.0]) * DEG_RAD)
    _, moment_b = allocated(LIGHT, condition, state, target_b)
    np.testing.assert_allclose(moment_b, target_b, atol=1e-9 * np.max(np.abs(target_b)))


@pytest.mark.long
@pytest.mark.parametrize("airframe", [SPLIT, ELEVONS, LIGHT])
def test_slopes_are_finite_inside_and_at_the_stops(airframe):
    count = len(airframe.actuators.names)
    condition, state = condition_with(airframe, [0.0] * count)

    def total(moment_b):
        return jnp.sum(allocated(airframe, condition, state, moment_b)[0].surfaces)

    slopes_of = jax.jit(jax.grad(total))
    for size in (0.0, 1e3, 1e6):
        assert np.all(np.isfinite(slopes_of(jnp.full(3, size))))
