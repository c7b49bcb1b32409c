"""Allocation over any number of surfaces: redundant ones share, those at a stop are relieved, no yaw is asked of none."""

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
    second = hasattr(airframe.actuators, "damping")
    moved = MovingDeflections(surfaces, jnp.zeros_like(surfaces)) if second else Deflections(surfaces)
    state = eqx.tree_at(lambda s: s.actuators, base, moved)
    return condition_of(airframe, ENVIRONMENT, 0.0, state), state


@eqx.filter_jit
def allocated(airframe, now, state, moment_b):
    """Demand for a moment, and the moment that it gives."""
    present = surface_moments(airframe, now, state.rates_b, state.surfaces)
    demand = allocate(airframe, now, state.rates_b, present, moment_b)
    given = airframe.aerodynamics(now.air_data, state.rates_b, demand.surfaces).moment_b + now.propulsive.moment_b
    return demand, given


def moment_of(airframe, now, state, surfaces):
    found = airframe.aerodynamics(now.air_data, state.rates_b, jnp.asarray(surfaces)).moment_b
    return found + now.propulsive.moment_b


def test_redundant_surfaces_share_and_give_the_moment():
    now, state = condition_with(SPLIT, [0.02, 0.1, -0.05, 0.03])
    wanted = moment_of(SPLIT, now, state, jnp.array([-4.0, 6.0, 2.0, -3.0]) * DEG_RAD)
    demand, given = allocated(SPLIT, now, state, wanted)
    assert not np.any(demand.saturated)
    # what cannot be had is weighed with 1e-6 of the square of the greatest moment: a share of 1e-5 at most
    np.testing.assert_allclose(given, wanted, atol=2e-5 * float(jnp.max(jnp.abs(wanted))))
    left, right = np.asarray(demand.surfaces)[1:3]
    np.testing.assert_allclose([left, right], 4.0 * DEG_RAD, rtol=1e-4)  # as little as will do: the same of both


def test_another_surface_takes_over_from_one_at_its_stop():
    tight = eqx.tree_at(
        lambda a: (a.actuators.lower, a.actuators.upper),
        SPLIT,
        (SPLIT.actuators.lower.at[1].set(-1 * DEG_RAD), SPLIT.actuators.upper.at[1].set(1 * DEG_RAD)),
    )
    now, state = condition_with(tight, [0.0, 0.0, 0.0, 0.0])
    wanted = moment_of(tight, now, state, jnp.array([0.0, 0.0, 15.0, 0.0]) * DEG_RAD)
    demand, given = allocated(tight, now, state, wanted)
    surfaces = np.asarray(demand.surfaces) / DEG_RAD
    assert surfaces[1] <= 1.0 + 1e-9
    np.testing.assert_allclose(given, wanted, atol=2e-5 * float(jnp.max(jnp.abs(wanted))))
    np.testing.assert_allclose(surfaces[1] + surfaces[2], 15.0, rtol=1e-3)


def test_beyond_all_stops_pitch_is_kept_before_roll():
    """Both elevons together cannot give that much of both: the pitch comes out, the roll is short."""
    now, state = condition_with(ELEVONS, [0.0, 0.0])
    wanted = moment_of(ELEVONS, now, state, jnp.array([-10.0 + 25.0, -10.0 - 25.0]) * DEG_RAD)
    demand, given = allocated(ELEVONS, now, state, wanted)
    assert np.all(np.abs(demand.surfaces) <= 25.0 * DEG_RAD + 1e-12)
    assert np.any(demand.saturated)
    plain = moment_of(ELEVONS, now, state, jnp.clip(jnp.array([15.0, -35.0]), -25.0, 25.0) * DEG_RAD)
    assert abs(given[1] - wanted[1]) < 0.5 * abs(plain[1] - wanted[1])
    assert abs(given[0]) < abs(wanted[0])


def test_two_elevons_give_roll_and_pitch_and_leave_the_yaw():
    now, state = condition_with(ELEVONS, [0.01, -0.01])
    assert not ELEVONS.actuators.controls_yaw
    aim = jnp.array([3.0, -5.0]) * DEG_RAD
    wanted = moment_of(ELEVONS, now, state, aim)
    demand, given = allocated(ELEVONS, now, state, wanted.at[2].add(100.0))
    np.testing.assert_allclose(given[:2], wanted[:2], rtol=2e-3)
    np.testing.assert_allclose(demand.surfaces, aim, atol=2e-3)


def test_one_for_each_axis_is_exact():
    now, state = condition_with(LIGHT, [0.0, 0.0, 0.0])
    wanted = moment_of(LIGHT, now, state, jnp.array([-3.0, 4.0, 2.0]) * DEG_RAD)
    _, given = allocated(LIGHT, now, state, wanted)
    np.testing.assert_allclose(given, wanted, atol=1e-9 * float(jnp.max(jnp.abs(wanted))))


@pytest.mark.parametrize("airframe", [SPLIT, ELEVONS, LIGHT])
def test_slopes_are_finite_inside_and_at_the_stops(airframe):
    count = len(airframe.actuators.names)
    now, state = condition_with(airframe, [0.0] * count)

    def total(moment_b):
        return jnp.sum(allocated(airframe, now, state, moment_b)[0].surfaces)

    for size in (0.0, 1e3, 1e6):
        assert np.all(np.isfinite(jax.grad(total)(jnp.full(3, size))))
