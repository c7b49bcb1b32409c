"""A fleet continues without its stopped aircraft."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.scenario import build_flight, load, loads
from anser.simulation.closed_loop import AT_GROUND, NO_TRIM
from support.fleet_flight import own, segments, started, with_own

pytestmark = pytest.mark.long


THREE = Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml"
ARRIVAL_S = 60.36
OTHERS = np.array([1, 2])


@pytest.fixture(scope="module")
def three():
    flight = build_flight(load(THREE))
    return flight, started(flight)


def check_arrivals(history):
    """The two active aircraft are at their rendezvous at the planned time, within the scenario's requirements."""
    step = 0.01
    at = round(history["arrival_time"][-1, 1] / step)
    axes = ("north", "east", "altitude")
    distance = np.stack([history[f"rendezvous_{axis}"][at] - history[axis][at] for axis in axes], axis=-1)
    assert np.max(np.linalg.norm(distance, axis=-1)[OTHERS]) < 3.0 + 150.0 * step
    assert all(np.all(np.isfinite(values)) for values in history.values())


def test_a_crash_of_the_farthest_aircraft_keeps_the_arrival_time_of_the_fleet(three):
    flight, state = three
    assert state.planner.plan.farthest == 0
    # Half a metre above the sea, sinking at 30 m/s: it is there within a few hundredths of a second.
    low = own(state).aircraft.position_n.at[0, 2].set(-0.5)
    sinking = own(state).aircraft.velocity_b.at[0, 2].add(30.0)
    state = with_own(lambda s: (s.aircraft.position_n, s.aircraft.velocity_b), state, (low, sinking))
    final_state, history = segments(flight, state, 14)
    assert list(np.asarray(own(final_state).stopped)) == [True, False, False]
    assert set(history["status"][10:, 0]) == {AT_GROUND}
    assert set(history["status"][:, OTHERS].ravel()) == {0}
    # Before its end the plan was made with it; then that stands, and nothing of the plan waits for what lies there.
    np.testing.assert_allclose(history["arrival_time"][:, OTHERS], ARRIVAL_S, atol=0.5)
    assert np.ptp(history["arrival_time"][500:, OTHERS]) < 0.1
    check_arrivals(history)
    # It shows the arrival time of the last plan that was made with it, and flies no farther.
    np.testing.assert_array_equal(history["arrival_time"][10:, 0], history["arrival_time"][10, 0])
    assert final_state.planner.flown_length[0] < 10.0


def test_a_fleet_starts_without_an_untrimmed_aircraft():
    # 95 m/s at 14 km: no steady flight; from there it would also be the farthest.
    text = THREE.read_text().replace("altitude_m = 1000.0, speed_m_s = 150.0", "altitude_m = 14000.0, speed_m_s = 95.0")
    flight = build_flight(loads(text))
    state = started(flight)
    assert own(state).status.tolist() == [NO_TRIM, 0, 0]
    assert state.planner.plan.farthest in OTHERS
    # The two others are nearer than the first of the shipped scenario, which takes 60.36 s.
    assert float(state.planner.plan.arrival_time) < ARRIVAL_S - 1.0
    final_state, history = segments(flight, state, 14)
    np.testing.assert_array_equal(history["status"], np.tile([[NO_TRIM, 0, 0]], (len(history["status"]), 1)))
    np.testing.assert_allclose(history["arrival_time"], state.planner.plan.arrival_time, atol=0.1)
    check_arrivals(history)
    assert final_state.planner.flown_length[0] == 0.0


def test_a_stopped_fleet_is_recorded_without_planning(three):
    flight, state = three
    all_stopped = jnp.ones_like(own(state).stopped), jnp.full_like(own(state).status, AT_GROUND)
    ended = with_own(lambda s: (s.stopped, s.status), state, all_stopped)
    final_state, history = segments(flight, ended, 1)
    assert set(history["status"].ravel()) == {AT_GROUND}
    for key in ("north", "east", "altitude", "arrival_time"):
        np.testing.assert_array_equal(history[key], np.tile(history[key][:1], (len(history[key]), 1)))
    for leaf, previous_leaf in zip(jax.tree.leaves(final_state.planner), jax.tree.leaves(state.planner), strict=True):
        np.testing.assert_array_equal(leaf, previous_leaf)
    assert all(np.all(np.isfinite(values)) for values in history.values())
