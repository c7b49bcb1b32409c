"""Step of a fleet: derivatives, batches, and failures of single aircraft."""

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
    final_state, _, history = simulation.fly(flight, state, jnp.asarray(0, dtype=jnp.int32), STEPS)
    return final_state, history


@pytest.fixture(scope="module")
def three():
    flight = build_flight(load(SCENARIOS / "three-aircraft.toml"))
    state = started(flight)
    return flight, state


@pytest.fixture(scope="module")
def fly_without_replanning(three):
    """`fly` without replanning, compiled: derivatives and batches of plans are tested in tests/planning.

    With replanning, the derivatives compile for minutes.
    """
    segment(*three)  # compiled before the patch, which the name under which a program is kept does not tell
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planner_module, "replan", lambda plan, *arguments: (plan, jnp.asarray(False)))
        compiled = eqx.filter_jit(lambda flight, state: fly(flight, state), compiler_options=PLAIN)
        compiled(*three)
        yield compiled


@pytest.fixture(scope="module")
def padded_flight():
    """The same fleet with a fourth, padding aircraft, as in `anser.run`: its programs are compiled already."""
    flight = build_flight(load(SCENARIOS / "three-aircraft.toml"), pad_fleet=True)
    return flight, started(flight)


@pytest.fixture(scope="module")
def first_segment(padded_flight):
    """State after the first segment, and its history."""
    return segment(*padded_flight)


def test_the_history_has_exactly_the_keys_of_the_catalogue(first_segment):
    _, history = first_segment
    assert set(history) == set(RECORDED_KEYS)
    assert all(values.shape == (SEGMENT_STEPS, 4) for values in history.values())


def test_the_first_row_is_the_start_of_the_scenario(padded_flight, first_segment):
    flight, _ = padded_flight
    _, history = first_segment
    np.testing.assert_allclose(history["north"][0], flight.groups[0].start_positions_n[:, 0], atol=1e-9)
    np.testing.assert_allclose(history["airspeed"][0], flight.groups[0].starts.speed, rtol=1e-12)
    np.testing.assert_allclose(history["course"][0], flight.groups[0].starts.course, atol=1e-12)
    np.testing.assert_allclose(history["path_angle"][0], 0.0, atol=1e-12)


def test_the_goals_velocities_are_recovered_from_the_line_of_sight(first_segment):
    _, history = first_segment
    # The scenario's boats go North at 25 m/s and East at 15 m/s; the sensor has no noise, rounding is left.
    moving = {"north": [25.0, 0.0, 0.0], "east": [0.0, 0.0, 15.0], "down": [0.0, 0.0, 0.0]}
    for axis, speeds in moving.items():
        expected = np.tile(speeds, (SEGMENT_STEPS, 1))
        np.testing.assert_allclose(history[f"goal_velocity_{axis}"][:, :3], expected, atol=1e-12)
        np.testing.assert_allclose(history[f"goal_estimate_velocity_{axis}"][:, :3], expected, atol=1e-9)


def test_a_non_finite_state_stops_only_its_aircraft(padded_flight, first_segment):
    flight, state = padded_flight
    good, _ = first_segment
    broken = with_own(lambda s: s.aircraft.power, state, own(state).aircraft.power.at[1].set(jnp.nan))
    final_state, history = segment(flight, broken)
    assert list(np.asarray(own(final_state).stopped)) == [False, True, False, True]
    assert int(own(final_state).status[1]) == NOT_FINITE
    assert "non-finite" in STATUS_MESSAGES[NOT_FINITE]
    for k in (0, 2):
        np.testing.assert_allclose(own(final_state).aircraft.position_n[k], own(good).aircraft.position_n[k], atol=1e-6)
    # It stands where it was.
    np.testing.assert_array_equal(history["north"][:, 1], history["north"][0, 1])


@pytest.mark.long
def test_a_step_compiled_as_one_kernel_is_the_same_step(three, fly_without_replanning):
    _, is_tracing_single_kernel = segment(*three)
    _, plain = fly_without_replanning(*three)
    for key, values in plain.items():
        scale = 1.0 + float(np.max(np.abs(np.asarray(values, dtype=float))))
        single_kernel = np.asarray(is_tracing_single_kernel[key][:STEPS], dtype=float)
        np.testing.assert_allclose(single_kernel, values, atol=1e-9 * scale, rtol=0.0, err_msg=key)


@pytest.mark.long
def test_batched_flights_equal_single_flights(three, fly_without_replanning):
    """Two different fleets, so that confusion of the rows would be noticed."""
    flight, state = three
    faster = with_own(lambda s: s.aircraft.velocity_b, state, 1.01 * own(state).aircraft.velocity_b)
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), (flight, state), (flight, faster))
    together = eqx.filter_jit(jax.vmap(fly), compiler_options=PLAIN)(*batch)[1]
    for k, start in enumerate((state, faster)):
        alone = fly_without_replanning(flight, start)[1]
        for key, values in alone.items():
            # Other fusions, other rounding: of distances of 10 km and angles alike, over four steps 1e-9 of the largest at most.
            values, scale = np.asarray(values, dtype=float), 1.0 + float(np.max(np.abs(values)))
            np.testing.assert_allclose(together[key][k], values, atol=1e-9 * scale, rtol=0.0, err_msg=key)
    assert float(jnp.max(jnp.abs(together["north"][0] - together["north"][1]))) > 1e-2


@pytest.mark.long
def test_derivatives_through_sensing_guidance_control_and_motion(three, fly_without_replanning):
    """Derivative of the closed loop in one direction of its numbers, against a finite difference."""
    flight, state = three
    numbers, static = eqx.partition(flight, eqx.is_inexact_array)
    random = np.random.default_rng(1)
    # A relative change of each number; the tables' extrapolation bounds are infinite and stay.
    direction = jax.tree.map(
        lambda leaf: jnp.where(jnp.isfinite(leaf), 1e-3 * leaf * random.normal(size=leaf.shape), 0.0), numbers
    )

    @functools.partial(jax.jit, compiler_options=PLAIN)
    def along(direction):
        return jax.jvp(lambda n: fly(eqx.combine(n, static), state)[1], (numbers,), (direction,))[1]

    tangent = along(direction)
    for key, values in tangent.items():
        if jnp.issubdtype(values.dtype, jnp.floating):
            assert bool(jnp.all(jnp.isfinite(values))), key

    def at(size):
        changed = jax.tree.map(lambda leaf, change: leaf + size * change, numbers, direction)
        return fly_without_replanning(eqx.combine(changed, static), state)[1]

    size = 1e-4
    forward, backward = at(size), at(-size)
    for key in ("north", "east", "altitude", "airspeed", "elevator_command", "bank_command"):
        difference = (forward[key] - backward[key]) / (2 * size)
        # Truncation of second order in changes of 1e-7; rounding 1e-12 of 1e4 over 2e-4 is 5e-5.
        np.testing.assert_allclose(tangent[key], difference, rtol=1e-3, atol=1e-3)
