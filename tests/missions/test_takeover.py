"""A goal that is left goes to the nearest that can be there in time, or to a spare one; who has no plan for it is passed over."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.missions import events as takeover
from anser.missions import run
from anser.missions.first_plan import FirstPlan
from anser.planning.certified.planner import CertifiedPlanState
from anser.scenario import build_flight, loads
from anser.simulation import FlightState
from anser.simulation.start import trimmed_fleet

BASE = """
format = 2
name = "four"
[timing]
duration_s = 200.0
[fleet]
speed_m_s = 150.0
[separation]
horizontal_m = 300.0
vertical_m = 150.0
"""
PLACES = {"a": (9000.0, 0.0), "b": (0.0, 9000.0), "c": (-9000.0, 2000.0), "d": (2000.0, -9000.0)}
GOALS = {"one": (500.0, 0.0), "two": (0.0, 3000.0), "three": (-3000.0, 0.0)}
OF = {"a": "one", "b": "two", "c": "three", "d": "one"}


def text(*events):
    parts = [BASE]
    for k, (name, (north, east)) in enumerate(PLACES.items()):
        course = np.degrees(np.arctan2(-east, -north))
        parts.append(
            f'[[aircraft]]\nname = "{name}"\ngoal = "{OF[name]}"\nstart = {{ north_m = {north}, east_m = {east}, '
            f"altitude_m = {1200.0 + 250.0 * k}, speed_m_s = 150.0, course_deg = {course:.1f} }}\n"
            f"rendezvous = {{ stand_off_up_m = {400.0 + 250.0 * k} }}\n"
        )
    for name, (north, east) in GOALS.items():
        parts.append(f'[[goal]]\nname = "{name}"\nkind = "surface"\nnorth_m = {north}\neast_m = {east}\n')
    for aircraft, how in events:
        parts.append(
            f'[[event]]\ntime_s = 20.0\nkind = "aircraft-leaves"\naircraft = "{aircraft}"\ngoal_taken_over_by = "{how}"\n'
        )
    return "".join(parts)


class Arrivals:
    arrival_times = np.full(4, 80.0)


def taken_over(monkeypatch, events, refused=()):
    """Who goes where after the events, with a planner that has a plan unless some go to goals refused to them."""
    scenario = loads(text(*events))
    flight = build_flight(scenario)
    leavers = {aircraft for aircraft, _ in events}
    names = list(PLACES)

    class Fleet:
        position_n = np.array([[*place, -1500.0] for place in PLACES.values()])
        active = np.array([0.0 if name in leavers else 1.0 for name in names])
        goal_position_n = np.array([[*GOALS[OF[name]], 0.0] for name in names])
        goal_velocity_n = np.zeros((4, 3))

        class rendezvous:
            stand_off_n = np.array([[0.0, 0.0, -400.0 - 250.0 * k] for k in range(4)])

        class limits:
            speed_max = np.full(4, 200.0)

    class FleetSnapshot:
        tasks = seen = Fleet

    class State:
        planner = CertifiedPlanState(Arrivals, None, None, None)

    tried = []

    def handed(flight, state, giver, taker):
        tried[-1].append((names[taker], OF[names[giver]]))
        return flight, state

    def anew(scenario, flight, state, number, told):
        pairs, plan = tried[-1], not any(pair in refused for pair in tried[-1])
        tried.append([])
        assert pairs
        return state if plan else None

    tried.append([])
    monkeypatch.setattr(takeover, "snapshot_at", lambda *of: FleetSnapshot)
    monkeypatch.setattr(takeover, "_hand_over_goal", handed)
    monkeypatch.setattr(takeover, "replan_fleet", anew)
    return takeover.reassign_goals(scenario, flight, State, 2000, scenario.event, tuple(OF.values()))


def test_the_nearest_takes_it_over(monkeypatch):
    _, _, goals, (done,) = taken_over(monkeypatch, [("c", "nearest")])
    # a is 12.2 km from goal three, b 9.5, d 10.3
    assert goals == ("one", "three", "three", "one")
    assert done.planned
    assert done.whom == "b"
    assert done.message == 'goes to the goal "three" of "c" instead of "two"'


def test_a_spare_one_is_one_whose_goal_another_flies_to_as_well(monkeypatch):
    _, _, goals, (done,) = taken_over(monkeypatch, [("c", "spare")])
    assert goals == ("one", "two", "three", "three")
    assert done.whom == "d"


def test_who_has_no_plan_is_passed_over(monkeypatch):
    _, _, goals, (done,) = taken_over(monkeypatch, [("c", "nearest")], refused=[("b", "three")])
    assert goals == ("one", "two", "three", "three")
    assert done.whom == "d"


def test_nobody_can(monkeypatch):
    refused = [(name, "three") for name in PLACES]
    _, _, goals, (done,) = taken_over(monkeypatch, [("c", "nearest")], refused=refused)
    assert goals == tuple(OF.values())
    assert not done.planned
    assert done.message == 'nobody can take over its goal "three" in time'


def test_goals_left_at_once_are_assigned_with_the_shortest_ways_in_all(monkeypatch):
    _, _, goals, done = taken_over(monkeypatch, [("c", "nearest"), ("b", "nearest")])
    # a to two 9.5 km and d to three 10.3, rather than a to three 12.2 and d to two 12.2
    assert goals == ("two", "two", "three", "three")
    assert {one.whom for one in done} == {"a", "d"}


def test_a_goal_to_which_another_flies_as_well_is_not_free(monkeypatch):
    _, _, goals, (done,) = taken_over(monkeypatch, [("a", "nearest")])
    assert goals == tuple(OF.values())
    assert done.planned
    assert done.message == 'its goal "one" is not free: "d" flies to it'


def test_who_is_alone_with_its_goal_once_another_has_left_is_not_spare(monkeypatch):
    _, _, goals, done = taken_over(monkeypatch, [("a", "spare"), ("c", "spare")])
    assert goals == tuple(OF.values())
    assert [one.planned for one in done] == [True, False]


@pytest.mark.long
def test_goal_rendezvous_and_what_is_known_of_it_are_handed_over():
    noisy = text(("c", "nearest")) + '[goal_sensor]\npreset = "ais"\n[navigation]\nsensors = "satellite-inertial"\n'
    flight = build_flight(loads(noisy))

    # nothing is flown, so that any numbers will do: those of no two aircraft are the same
    shapes = jax.eval_shape(trimmed_fleet, flight).vehicles
    vehicles = jax.tree.map(
        lambda leaf: jnp.arange(1, 1 + np.prod(leaf.shape, dtype=int)).reshape(leaf.shape).astype(leaf.dtype), shapes
    )

    state = FlightState(vehicles, None)
    after, moved = takeover._hand_over_goal(flight, state, 2, 0)
    mission, given, own = (f.aircraft(k)[0].mission for f, k in ((after, 0), (flight, 2), (flight, 0)))
    np.testing.assert_array_equal(mission.goal.positions_n, given.goal.positions_n)
    np.testing.assert_array_equal(mission.rendezvous.stand_off_n, given.rendezvous.stand_off_n)
    np.testing.assert_array_equal(mission.hold.speed, own.hold.speed)
    before, there = state.vehicles[0].estimator, moved.vehicles[0].estimator
    np.testing.assert_array_equal(there.goal.means[0], before.goal.means[2])
    np.testing.assert_array_equal(there.own.position_n[0], before.own.position_n[0])
    np.testing.assert_array_equal(there.goal.own.position_n[0], before.goal.own.position_n[0])
    assert not jnp.any(moved.vehicles[0].sensors[1].queue.waiting[0])
    # the others are as they were
    np.testing.assert_array_equal(there.goal.means[1:], before.goal.means[1:])


@pytest.mark.long
def test_it_is_flown_there(tmp_path):
    flown = run(loads(text(("c", "spare"))))
    assert flown.met
    rows = {row["name"]: row for row in flown.summary["aircraft"]}
    assert rows["d"]["goal"] == "three"
    assert rows["d"]["miss_m"] < 1.0
    assert rows["c"]["arrival_s"] is None
    assert flown.summary["fleet"]["separation_ratio_min"] >= 1.0
    left, taken = flown.summary["events"]
    assert (left["kind"], taken["kind"]) == ("aircraft-leaves", "goal-taken-over")
    assert isinstance(flown.planned, FirstPlan)
    flown.save(Path(tmp_path) / "run")
