"""The fleet's step: gradients through everything, batches, and failures that stay with their aircraft."""

import functools
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser.planning.published.planner as planner_module
from anser import simulation
from anser.scenario import build_flight, load
from anser.simulation import STATUS_MESSAGES
from anser.simulation.closed_loop import NOT_FINITE
from anser.simulation.flight import SEGMENT_STEPS
from anser.variables import RECORDED_KEYS
from support.fleet_flight import own, segment, started, with_own

SCENARIOS = Path(__file__).parents[2] / "scenarios"
STEPS = 4
# Programs that fly four steps a few times: XLA's optimizer takes longer than it saves.
PLAIN = {"xla_backend_optimization_level": 0}


def fly(flight, state):
    after, _, history = simulation.fly(flight, state, jnp.asarray(0, dtype=jnp.int32), STEPS)
    return after, history


@pytest.fixture(scope="module")
def three():
    flight = build_flight(load(SCENARIOS / "three-aircraft.toml"))
    state = started(flight)
    return flight, state


@pytest.fixture(scope="module")
def with_the_plan_standing(three):
    """`fly` without renewal, compiled: a plan's own derivatives and batches are tested in tests/planning.

    Through the renewal, the derivatives compile for minutes.
    """
    segment(*three)  # compiled before the patch, which the name under which a program is kept does not tell
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planner_module, "replan", lambda plan, *others: (plan, jnp.asarray(False)))
        compiled = eqx.filter_jit(lambda flight, state: fly(flight, state), compiler_options=PLAIN)
        compiled(*three)
        yield compiled


@pytest.fixture(scope="module")
def filled_up():
    """The same with a fourth that does not fly, as `anser.run` has it: these programs are compiled already."""
    flight = build_flight(load(SCENARIOS / "three-aircraft.toml"), pad_fleet=True)
    return flight, started(flight)


@pytest.fixture(scope="module")
def begun(filled_up):
    """State after the first segment, and its history."""
    return segment(*filled_up)


def test_history_holds_exactly_the_catalogue(begun):
    _, history = begun
    assert set(history) == set(RECORDED_KEYS)
    assert all(values.shape == (SEGMENT_STEPS, 4) for values in history.values())


def test_first_row_is_the_scenario_start(filled_up, begun):
    flight, _ = filled_up
    _, history = begun
    np.testing.assert_allclose(history["north"][0], flight.groups[0].start_positions_n[:, 0], atol=1e-9)
    np.testing.assert_allclose(history["airspeed"][0], flight.groups[0].starts.speed, rtol=1e-12)
    np.testing.assert_allclose(history["course"][0], flight.groups[0].starts.course, atol=1e-12)
    np.testing.assert_allclose(history["path_angle"][0], 0.0, atol=1e-12)


def test_the_goals_velocities_are_recovered_from_the_line_of_sight(begun):
    _, history = begun
    # The scenario's boats go North at 25 m/s and East at 15 m/s; the sensor has no noise, rounding is left.
    moving = {"north": [25.0, 0.0, 0.0], "east": [0.0, 0.0, 15.0], "down": [0.0, 0.0, 0.0]}
    for axis, speeds in moving.items():
        wanted = np.tile(speeds, (SEGMENT_STEPS, 1))
        np.testing.assert_allclose(history[f"goal_velocity_{axis}"][:, :3], wanted, atol=1e-12)
        np.testing.assert_allclose(history[f"goal_estimate_velocity_{axis}"][:, :3], wanted, atol=1e-9)


def test_a_number_that_is_none_stops_its_aircraft_alone(filled_up, begun):
    flight, state = filled_up
    good, _ = begun
    broken = with_own(lambda s: s.aircraft.power, state, own(state).aircraft.power.at[1].set(jnp.nan))
    after, history = segment(flight, broken)
    assert list(np.asarray(own(after).stopped)) == [False, True, False, True]
    assert int(own(after).status[1]) == NOT_FINITE
    assert "number" in STATUS_MESSAGES[NOT_FINITE]
    for k in (0, 2):
        np.testing.assert_allclose(own(after).aircraft.position_n[k], own(good).aircraft.position_n[k], atol=1e-6)
    # It stands where it was.
    np.testing.assert_array_equal(history["north"][:, 1], history["north"][0, 1])


@pytest.mark.long
def test_a_step_compiled_as_one_kernel_is_the_same_step(three, with_the_plan_standing):
    _, is_tracing_single_kernel = segment(*three)
    _, plain = with_the_plan_standing(*three)
    for key, values in plain.items():
        scale = 1.0 + float(np.max(np.abs(np.asarray(values, dtype=float))))
        found = np.asarray(is_tracing_single_kernel[key][:STEPS], dtype=float)
        np.testing.assert_allclose(found, values, atol=1e-9 * scale, rtol=0.0, err_msg=key)


@pytest.mark.long
def test_flights_in_a_batch_are_the_flights_alone(three, with_the_plan_standing):
    """Of two unlike fleets, so that neither can be taken for the other."""
    flight, state = three
    faster = with_own(lambda s: s.aircraft.velocity_b, state, 1.01 * own(state).aircraft.velocity_b)
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), (flight, state), (flight, faster))
    together = eqx.filter_jit(jax.vmap(fly), compiler_options=PLAIN)(*batch)[1]
    for k, start in enumerate((state, faster)):
        alone = with_the_plan_standing(flight, start)[1]
        for key, values in alone.items():
            # Other fusions, other rounding: of distances of 10 km and angles alike, over four steps 1e-9 of the largest at most.
            values, scale = np.asarray(values, dtype=float), 1.0 + float(np.max(np.abs(values)))
            np.testing.assert_allclose(together[key][k], values, atol=1e-9 * scale, rtol=0.0, err_msg=key)
    assert float(jnp.max(jnp.abs(together["north"][0] - together["north"][1]))) > 1e-2


@pytest.mark.long
def test_derivatives_through_sensing_guidance_control_and_motion(three, with_the_plan_standing):
    """Of the closed loop along one direction in all its numbers at once, against a finite difference."""
    flight, state = three
    numbers, rest = eqx.partition(flight, eqx.is_inexact_array)
    random = np.random.default_rng(1)
    # A relative change of each number; the tables' extrapolation bounds are infinite and stay.
    direction = jax.tree.map(
        lambda leaf: jnp.where(jnp.isfinite(leaf), 1e-3 * leaf * random.normal(size=leaf.shape), 0.0), numbers
    )

    @functools.partial(jax.jit, compiler_options=PLAIN)
    def along(direction):
        return jax.jvp(lambda n: fly(eqx.combine(n, rest), state)[1], (numbers,), (direction,))[1]

    tangent = along(direction)
    for key, values in tangent.items():
        if jnp.issubdtype(values.dtype, jnp.floating):
            assert bool(jnp.all(jnp.isfinite(values))), key

    def at(size):
        moved = jax.tree.map(lambda leaf, way: leaf + size * way, numbers, direction)
        return with_the_plan_standing(eqx.combine(moved, rest), state)[1]

    size = 1e-4
    ahead, behind = at(size), at(-size)
    for key in ("north", "east", "altitude", "airspeed", "elevator_command", "bank_command"):
        difference = (ahead[key] - behind[key]) / (2 * size)
        # Truncation of second order in changes of 1e-7; rounding 1e-12 of 1e4 over 2e-4 is 5e-5.
        np.testing.assert_allclose(tangent[key], difference, rtol=1e-3, atol=1e-3)
