"""Reassignment of goals of departing aircraft: to the nearest aircraft in time, or to a spare aircraft with a plan."""

from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.missions import events as events_module
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
POSITIONS = {"a": (9000.0, 0.0), "b": (0.0, 9000.0), "c": (-9000.0, 2000.0), "d": (2000.0, -9000.0)}
GOALS = {"one": (500.0, 0.0), "two": (0.0, 3000.0), "three": (-3000.0, 0.0)}
GOAL_NAMES = {"a": "one", "b": "two", "c": "three", "d": "one"}


def text(*events):
    parts = [BASE]
    for k, (name, (north, east)) in enumerate(POSITIONS.items()):
        course = np.degrees(np.arctan2(-east, -north))
        parts.append(
            f'[[aircraft]]\nname = "{name}"\ngoal = "{GOAL_NAMES[name]}"\nstart = {{ north_m = {north}, east_m = {east}, '
            f"altitude_m = {1200.0 + 250.0 * k}, speed_m_s = 150.0, course_deg = {course:.1f} }}\n"
            f"rendezvous = {{ stand_off_up_m = {400.0 + 250.0 * k} }}\n"
        )
    for name, (north, east) in GOALS.items():
        parts.append(f'[[goal]]\nname = "{name}"\nkind = "surface"\nnorth_m = {north}\neast_m = {east}\n')
    for aircraft, rule in events:
        parts.append(
            f'[[event]]\ntime_s = 20.0\nkind = "aircraft-leaves"\naircraft = "{aircraft}"\ngoal_taken_over_by = "{rule}"\n'
        )
    return "".join(parts)


class Arrivals:
    arrival_times = np.full(4, 80.0)


def reassign(monkeypatch, events, refused=(), has_valid_plan=True):
    """Goals after the events, with a planner that finds a plan unless an aircraft goes to a goal refused to it.

    `has_valid_plan`: whether the fleet has a valid plan after the departures.
    """
    scenario = loads(text(*events))
    flight = build_flight(scenario)
    departing = {aircraft for aircraft, _ in events}
    names = list(POSITIONS)

    class Fleet:
        position_n = np.array([[*position, -1500.0] for position in POSITIONS.values()])
        active = np.array([0.0 if name in departing else 1.0 for name in names])
        goal_position_n = np.array([[*GOALS[GOAL_NAMES[name]], 0.0] for name in names])
        goal_velocity_n = np.zeros((4, 3))

        class rendezvous:
            stand_off_n = np.array([[0.0, 0.0, -400.0 - 250.0 * k] for k in range(4)])

        class limits:
            speed_max = np.full(4, 200.0)

    class FleetSnapshot:
        replannable_tasks = flying_tasks = Fleet

    class State:
        planner = CertifiedPlanState(Arrivals, None, None, None)

    tried = []

    def hand_over_goal(flight, state, giver, taker):
        tried[-1].append((names[taker], GOAL_NAMES[names[giver]]))
        return flight, state

    def replan_fleet(scenario, flight, state, number, on_progress):
        pairs, plan = tried[-1], not any(pair in refused for pair in tried[-1])
        tried.append([])
        assert pairs
        return state if plan else None

    tried.append([])
    monkeypatch.setattr(events_module, "snapshot_at", lambda *arguments: FleetSnapshot)
    monkeypatch.setattr(events_module, "_hand_over_goal", hand_over_goal)
    monkeypatch.setattr(events_module, "replan_fleet", replan_fleet)
    goals = tuple(GOAL_NAMES.values())
    return events_module.reassign_goals(scenario, flight, State, 2000, scenario.event, goals, has_valid_plan)


def test_the_nearest_aircraft_takes_over_the_goal(monkeypatch):
    _, _, goals, (outcome,) = reassign(monkeypatch, [("c", "nearest")])
    # a is 12.2 km from goal three, b 9.5, d 10.3
    assert goals == ("one", "three", "three", "one")
    assert outcome.has_valid_plan
    assert outcome.subject == "b"
    assert outcome.message == 'goes to the goal "three" of "c" instead of "two"'


def test_a_spare_aircraft_shares_its_goal_with_another_aircraft(monkeypatch):
    _, _, goals, (outcome,) = reassign(monkeypatch, [("c", "spare")])
    assert goals == ("one", "two", "three", "three")
    assert outcome.subject == "d"


def test_an_aircraft_without_a_plan_is_passed_over(monkeypatch):
    _, _, goals, (outcome,) = reassign(monkeypatch, [("c", "nearest")], refused=[("b", "three")])
    assert goals == ("one", "two", "three", "three")
    assert outcome.subject == "d"


@pytest.mark.parametrize("has_valid_plan", [False, True])
def test_a_goal_without_a_feasible_successor_is_reported(monkeypatch, has_valid_plan):
    """The plan in force is that after the departure."""
    refused = [(name, "three") for name in POSITIONS]
    _, _, goals, (outcome,) = reassign(monkeypatch, [("c", "nearest")], refused, has_valid_plan)
    assert goals == tuple(GOAL_NAMES.values())
    assert outcome.has_valid_plan is has_valid_plan
    assert outcome.message == 'no aircraft can take over its goal "three" in time'


def test_simultaneously_freed_goals_are_assigned_with_the_least_total_distance(monkeypatch):
    _, _, goals, outcomes = reassign(monkeypatch, [("c", "nearest"), ("b", "nearest")])
    # a to two 9.5 km and d to three 10.3, rather than a to three 12.2 and d to two 12.2
    assert goals == ("two", "two", "three", "three")
    assert {outcome.subject for outcome in outcomes} == {"a", "d"}


@pytest.mark.parametrize("has_valid_plan", [False, True])
def test_a_shared_goal_is_not_free(monkeypatch, has_valid_plan):
    _, _, goals, (outcome,) = reassign(monkeypatch, [("a", "nearest")], has_valid_plan=has_valid_plan)
    assert goals == tuple(GOAL_NAMES.values())
    assert outcome.has_valid_plan is has_valid_plan
    assert outcome.message == 'its goal "one" is not free: "d" flies to it'


def test_the_last_aircraft_of_a_goal_is_not_spare(monkeypatch):
    _, _, goals, outcomes = reassign(monkeypatch, [("a", "spare"), ("c", "spare")])
    assert goals == tuple(GOAL_NAMES.values())
    assert [outcome.goal for outcome in outcomes] == [None, None]
    assert "is not free" in outcomes[0].message
    assert "no aircraft can take over" in outcomes[1].message


def test_of_two_spare_aircraft_of_a_goal_one_stays(monkeypatch):
    """Both would be nearer to the free goals than nobody; but then nobody would fly to their own."""
    _, _, goals, outcomes = reassign(monkeypatch, [("b", "spare"), ("c", "spare")], has_valid_plan=False)
    assert "one" in goals
    assert sum(goal != former for goal, former in zip(goals, GOAL_NAMES.values(), strict=True)) == 1
    assert [outcome.goal is None for outcome in outcomes] == [False, True]
    assert all(outcome.has_valid_plan for outcome in outcomes)  # the plan of the new assignment


@pytest.mark.long
def test_goal_rendezvous_and_goal_estimate_are_handed_over():
    noisy = text(("c", "nearest")) + '[goal_sensor]\npreset = "ais"\n[navigation]\nsensors = "satellite-inertial"\n'
    flight = build_flight(loads(noisy))

    # nothing is flown, so that any numbers will do: those of no two aircraft are the same
    shapes = jax.eval_shape(trimmed_fleet, flight).vehicles
    vehicles = jax.tree.map(
        lambda leaf: jnp.arange(1, 1 + np.prod(leaf.shape, dtype=int)).reshape(leaf.shape).astype(leaf.dtype), shapes
    )

    state = FlightState(vehicles, None)
    reassigned, reassigned_state = events_module._hand_over_goal(flight, state, 2, 0)
    mission, giver_mission, taker_mission = (
        f.aircraft(k)[0].mission for f, k in ((reassigned, 0), (flight, 2), (flight, 0))
    )
    np.testing.assert_array_equal(mission.goal.positions_n, giver_mission.goal.positions_n)
    np.testing.assert_array_equal(mission.rendezvous.stand_off_n, giver_mission.rendezvous.stand_off_n)
    np.testing.assert_array_equal(mission.hold.speed, taker_mission.hold.speed)
    estimates_before, estimates_after = state.vehicles[0].estimator, reassigned_state.vehicles[0].estimator
    np.testing.assert_array_equal(estimates_after.goal.means[0], estimates_before.goal.means[2])
    np.testing.assert_array_equal(estimates_after.vehicle.position_n[0], estimates_before.vehicle.position_n[0])
    np.testing.assert_array_equal(
        estimates_after.goal.vehicle_motion.position_n[0], estimates_before.goal.vehicle_motion.position_n[0]
    )
    assert not jnp.any(reassigned_state.vehicles[0].sensors[1].queue.waiting[0])
    # the others are as they were
    np.testing.assert_array_equal(estimates_after.goal.means[1:], estimates_before.goal.means[1:])


@pytest.mark.long
def test_the_new_goal_is_met(tmp_path):
    # At the preferred arrival, at 61 s, the choice of one path depends on rounding, and one of the paths is hard to fly.
    flown = run(loads(text(("c", "spare")) + '[arrival]\nrule = "at"\ntime_s = 80.0\n'))
    assert flown.met
    entries = {entry["name"]: entry for entry in flown.summary["aircraft"]}
    assert entries["d"]["goal"] == "three"
    assert entries["d"]["miss_m"] < 1.0
    assert entries["c"]["arrival_s"] is None
    assert flown.summary["fleet"]["separation_ratio_min"] >= 1.0
    departure, handover = flown.summary["events"]
    assert (departure["kind"], handover["kind"]) == ("aircraft-leaves", "goal-taken-over")
    assert isinstance(flown.planned, FirstPlan)
    flown.save(Path(tmp_path) / "run")


def test_the_assignment_serves_the_most_goals_with_the_least_total_distance():
    """Of the two aircraft to each goal one must stay: the shortest pairs alone would leave a goal open."""
    far = events_module._INFEASIBLE_M
    distances = np.array([[100.0, 90.0], [far, 10.0], [far, 20.0], [far, far]])
    fleet = SimpleNamespace(goals=("G", "G", "H", "H"), aircraft_with_goal={"G": [0, 1], "H": [2, 3]}.get)
    departures = [SimpleNamespace(goal_taken_over_by="spare")] * 2
    assert sorted(events_module._least_assignment(fleet, distances, departures)) == [(0, 0), (2, 1)]
    nearest = [SimpleNamespace(goal_taken_over_by="nearest")] * 2
    assert sorted(events_module._least_assignment(fleet, distances, nearest)) == [(0, 0), (1, 1)]
    assert events_module._least_assignment(fleet, np.full((4, 2), far), departures) == []
    # the one that must not leave its goal alone stays, also beside a nearest taker
    mixed = [SimpleNamespace(goal_taken_over_by=rule) for rule in ("spare", "nearest")]
    distances = np.array([[100.0, far], [far, 100.0], [far, 5000.0], [far, far]])
    assert sorted(events_module._least_assignment(fleet, distances, mixed)) == [(0, 0), (2, 1)]
    # five spare aircraft of one goal for five goals: one of them stays, found at once
    five = SimpleNamespace(goals=("G",) * 5, aircraft_with_goal=lambda goal: list(range(5)))
    departures = [SimpleNamespace(goal_taken_over_by="spare")] * 5
    distances = np.random.default_rng(0).uniform(100.0, 900.0, (5, 5))
    assert len(events_module._least_assignment(five, distances, departures)) == 4
