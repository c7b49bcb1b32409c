"""User-defined parts, made outside the package, fly through the public API without changes inside."""

from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser.numerics.arrays import Stacked
from anser.parts import AbstractPlanner, AbstractReference, AbstractSensors
from anser.scenario import build_flight, load
from anser.sensing import IdealSensors
from anser.shapes import Scalar
from anser.simulation import STATUS_MESSAGES, History, assemble, fly, start_flight
from anser.simulation.closed_loop import BREAKAWAY, PLAN_TOO_NEAR, TOO_NEAR
from support.proportional_control import Proportional
from support.straight_lines import Line, StraightLines

SCENARIO = Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml"
STEP, SECONDS = 0.01, 58.0
KEYS = (
    "north",
    "east",
    "altitude",
    "status",
    "clearance",
    "phase",
    "arrival_time",
    "goal_estimate_north",
    "goal_north",
)


class Biased(AbstractSensors):
    """Ideal sensors with a bias of the range to the goal, m."""

    bias: Scalar

    def init(self, truth, instant):
        return jnp.asarray(0)

    def read(self, memory, truth, instant):
        reading, _ = IdealSensors().read(None, truth, instant)
        return eqx.tree_at(lambda r: r.sight.range, reading, reading.sight.range + self.bias), memory + 1


def three():
    return build_flight(load(SCENARIO).replace("aircraft[aircraft-3].start.north_m", -8000.0))


def rebuilt(flight, planner=None, **parts):
    """The flight with other parts in every aircraft."""
    (kind,) = flight.groups
    aircraft = []
    for k in range(flight.count):
        vehicle, start, position_n = flight.aircraft(k)
        for name, part in parts.items():
            vehicle = eqx.tree_at(lambda v, name=name: getattr(v, name), vehicle, part)
        aircraft.append((vehicle, start, position_n))
    assert isinstance(kind.vehicles, Stacked)
    timing = flight.timing
    return assemble(
        flight.environment, aircraft, planner or flight.planner, timing.step, int(timing.replan_steps), timing.freeze
    )


@eqx.filter_jit
def _whole(flight):
    state, _ = start_flight(flight)
    return fly(flight, state, jnp.asarray(0, dtype=jnp.int32), round(SECONDS / STEP), History(keys=KEYS))


def flown(flight):
    state, _, history = _whole(flight)
    return state, {key: np.asarray(values) for key, values in history.items()}


def lines(error_n=(0.0, 0.0, 0.0), duration=50.0):
    return StraightLines(jnp.asarray(duration), jnp.asarray(error_n))


@pytest.fixture(scope="module")
def ordinary():
    return flown(rebuilt(three(), lines()))


@pytest.mark.long
def test_user_defined_planner_controller_and_sensor_fly_a_mission():
    """Straight lines from 9 km away, proportional control, a range 40 m too long."""
    flight = rebuilt(three(), lines(), controller=Proportional(), sensors=Biased(jnp.asarray(40.0)))
    state, history = flown(flight)
    np.testing.assert_array_equal(history["status"], 0)
    assert all(np.all(np.isfinite(values)) for values in history.values())
    # the sensors count their samples
    np.testing.assert_array_equal(state.vehicles[0].sensors, len(history["north"]))
    # Its goal is taken to be 40 m farther along the line of sight, by which its path ends elsewhere.
    assert np.max(np.abs(history["goal_estimate_north"] - history["goal_north"])[0]) > 10.0
    at = round(50.0 / STEP)
    assert np.all(history["phase"][at + 1] == 2)
    assert np.all(history["phase"][at - 1] < 2)
    assert np.all((history["altitude"] > 100.0) & (history["altitude"] < 1600.0))


@pytest.mark.long
def test_straight_lines_with_the_autopilot_meet_the_rendezvous(ordinary):
    _, history = ordinary
    np.testing.assert_array_equal(history["status"], 0)
    at = round(50.0 / STEP)
    # 300 m above the boat that each meets, to within what position feedback leaves of a start with another velocity
    np.testing.assert_allclose(history["clearance"][at], 300.0, atol=5.0)


@pytest.mark.long
def test_a_plan_that_ends_too_near_is_refused_for_a_hold():
    """The plan ends 149 m above the goal."""
    parts = {"controller": Proportional(), "sensors": Biased(jnp.asarray(0.0))}  # the program of the test above
    _, history = flown(rebuilt(three(), lines((0.0, 0.0, 151.0)), **parts))
    np.testing.assert_array_equal(history["status"], PLAN_TOO_NEAR)
    np.testing.assert_array_equal(history["phase"], 2)
    assert "refused" in STATUS_MESSAGES[PLAN_TOO_NEAR]
    assert history["clearance"].min() > 150.0


class Feint(AbstractReference):
    """A line through the goal with a false end point."""

    line: Line
    arrival: Scalar

    def at(self, time):
        planned = self.line.at(time)
        up_n = jnp.array([0.0, 0.0, -400.0])
        return eqx.tree_at(
            lambda p: p.position_n, planned, planned.position_n + jnp.where(time >= self.arrival, up_n, 0.0)
        )


class Feints(AbstractPlanner):
    """Paths straight through the goals, with end points reported 400 m above the goals."""

    duration: Scalar

    def first_plan(self, time, reports, performance):
        to_goal = StraightLines(self.duration, -reports.rendezvous.stand_off_n[0])
        plan = to_goal.first_plan(time, reports, performance)
        return eqx.tree_at(lambda p: p.trajectory, plan, Feint(plan.trajectory, plan.arrival_time))

    def replan(self, memory, time, reports):
        return memory

    def observe(self, memory, reports, number, step, randomness):
        return memory

    def plans(self, memory):
        return memory


def airborne(flight, altitude):
    """The flight with airborne goals, away from the ground."""
    aircraft = []
    for k in range(flight.count):
        vehicle, start, position_n = flight.aircraft(k)
        lifted = vehicle.mission.goal.positions_n.at[:, 2].set(-altitude)
        vehicle = eqx.tree_at(
            lambda v: (v.mission.goal.positions_n, v.mission.airborne), vehicle, (lifted, jnp.asarray(True))
        )
        aircraft.append((vehicle, start, position_n))
    timing = flight.timing
    return assemble(flight.environment, aircraft, flight.planner, timing.step, int(timing.replan_steps), timing.freeze)


@pytest.mark.long
@pytest.mark.parametrize("on_surface", [True, False])
def test_an_aircraft_led_to_its_goal_breaks_off_in_time(on_surface):
    """For any planner, the closed loop turns the aircraft away and sets the status."""
    flight = rebuilt(three(), Feints(jnp.asarray(50.0)))
    _, history = flown(flight if on_surface else airborne(flight, 900.0))
    status, clearance = history["status"], history["clearance"]
    broke = {BREAKAWAY, TOO_NEAR} if on_surface else {TOO_NEAR}
    for k in range(3):
        (event_indices,) = np.nonzero(status[:, k] != 0)
        assert set(status[event_indices, k]) <= broke
        assert np.array_equal(event_indices, np.arange(event_indices[0], len(status)))
        assert np.all(history["phase"][event_indices[0] :, k] == 2)
        assert clearance[:, k].min() > (150.0 if on_surface else 100.0)
