"""The fleet's step: gradients through everything, and failures that stay with their aircraft."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser.simulation.flight as flight_module
from anser.scenario import build_flight, load
from anser.simulation import STATUS_MESSAGES, start_flight, step_flight
from anser.simulation.status import NOT_FINITE
from anser.variables import RECORDED_KEYS

SCENARIOS = Path(__file__).parents[2] / "scenarios"
STEPS = 4


def fly(flight, state):
    return jax.lax.scan(lambda carry, _: step_flight(flight, carry), state, length=STEPS)


@pytest.fixture(scope="module")
def three():
    flight = build_flight(load(SCENARIOS / "three-aircraft.toml"))
    state, _ = eqx.filter_jit(start_flight)(flight)
    return flight, state


@pytest.fixture(scope="module")
def compiled():
    return eqx.filter_jit(fly)


def test_history_holds_exactly_the_catalogue(three, compiled):
    _, history = compiled(*three)
    assert set(history) == set(RECORDED_KEYS)
    assert all(values.shape == (STEPS, 3) for values in history.values())


def test_first_row_is_the_scenario_start(three, compiled):
    flight, _ = three
    _, history = compiled(*three)
    np.testing.assert_allclose(history["north"][0], flight.fleet.start_positions_n[:, 0], atol=1e-9)
    np.testing.assert_allclose(history["airspeed"][0], flight.fleet.starts.speed, rtol=1e-12)
    np.testing.assert_allclose(history["course"][0], flight.fleet.starts.course, atol=1e-12)
    np.testing.assert_allclose(history["path_angle"][0], 0.0, atol=1e-12)


def test_a_number_that_is_none_stops_its_aircraft_alone(three, compiled):
    flight, state = three
    good, _ = compiled(flight, state)
    broken = eqx.tree_at(lambda s: s.aircraft.power, state, state.aircraft.power.at[1].set(jnp.nan))
    # No planning: the fleet's plan is common, and a planner fed with a state that is none has nothing to say.
    once = eqx.tree_at(lambda f: f.timing.replan_steps, flight, jnp.zeros_like(flight.timing.replan_steps))
    after, history = compiled(once, broken)
    assert list(np.asarray(after.stopped)) == [False, True, False]
    assert int(after.status[1]) == NOT_FINITE
    assert "number" in STATUS_MESSAGES[NOT_FINITE]
    for k in (0, 2):
        np.testing.assert_allclose(after.aircraft.position_n[k], good.aircraft.position_n[k], atol=1e-6)
    # It stands where it was.
    np.testing.assert_array_equal(history["north"][:, 1], history["north"][0, 1])


def test_derivatives_through_sensing_guidance_control_and_motion(three, monkeypatch):
    """Of the closed loop along one direction in all its numbers at once, against a finite difference.

    The plan stands still here (its own derivatives are tested in tests/planning): through it, this compiles for minutes.
    """
    monkeypatch.setattr(flight_module, "renew", lambda plan, *others: plan)
    flight, state = three
    compiled = eqx.filter_jit(lambda flight, state: fly(flight, state))
    numbers, rest = eqx.partition(flight, eqx.is_inexact_array)
    random = np.random.default_rng(1)
    # A relative change of each number; the tables' extrapolation bounds are infinite and stay.
    direction = jax.tree.map(
        lambda leaf: jnp.where(jnp.isfinite(leaf), 1e-3 * leaf * random.normal(size=leaf.shape), 0.0), numbers
    )

    @jax.jit
    def along(direction):
        return jax.jvp(lambda n: fly(eqx.combine(n, rest), state)[1], (numbers,), (direction,))[1]

    tangent = along(direction)
    for key, values in tangent.items():
        if jnp.issubdtype(values.dtype, jnp.floating):
            assert bool(jnp.all(jnp.isfinite(values))), key

    def at(size):
        moved = jax.tree.map(lambda leaf, way: leaf + size * way, numbers, direction)
        return compiled(eqx.combine(moved, rest), state)[1]

    size = 1e-4
    ahead, behind = at(size), at(-size)
    for key in ("north", "east", "altitude", "airspeed", "elevator_command", "bank_command"):
        difference = (ahead[key] - behind[key]) / (2 * size)
        # Truncation of second order in changes of 1e-7; rounding 1e-12 of 1e4 over 2e-4 is 5e-5.
        np.testing.assert_allclose(tangent[key], difference, rtol=1e-3, atol=1e-3)
