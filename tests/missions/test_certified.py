"""The certified planner through public functions: a small fleet is planned, flown past a turning goal, and refused."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

import anser
from anser.cli.commands import app
from anser.missions import NoPlanError, run
from anser.missions.first_plan import arrival_request
from anser.planning.certified.replanning import CORRECTED, REPLANNED, UNCHANGED
from anser.scenario import load, loads
from anser.simulation.closed_loop import AT_GROUND
from support.fleet_flight import own, segment, with_own
from trials.check import dense_check
from trials.data import ArrivalRule, FleetLimits, Goals, KeepOutCylinders, Paths, PlanCase, Starts
from trials.data import WindProfile as CheckedWind

pytestmark = pytest.mark.long


_TURN_S = 30.0

_SCENARIO = f"""
format = 1
name = "two-certified"

[timing]
duration_s = 85.0

[fleet]
speed_m_s = 150.0
planner = "certified"

[wind]
speed_m_s = 10.0
from_deg = 250.0

[separation]
horizontal_m = 500.0
vertical_m = 150.0

[[aircraft]]
name = "one"
goal = "boat"
start = {{ north_m = -9000.0, east_m = 0.0, altitude_m = 700.0, speed_m_s = 150.0, course_deg = 10.0 }}

[[aircraft]]
name = "two"
goal = "buoy"
start = {{ north_m = 500.0, east_m = 8500.0, altitude_m = 650.0, speed_m_s = 150.0, course_deg = -100.0 }}

[[goal]]
name = "boat"
kind = "surface"
waypoints = [
  {{ time_s = 0.0, north_m = 0.0, east_m = 0.0, altitude_m = 0.0 }},
  {{ time_s = {_TURN_S}, north_m = 150.0, east_m = 0.0, altitude_m = 0.0 }},
  {{ time_s = 200.0, north_m = 150.0, east_m = -510.0, altitude_m = 0.0 }},
]

[[goal]]
name = "buoy"
kind = "surface"
north_m = 1500.0
east_m = 1500.0
"""


def _write_scenario(folder: Path, text: str = _SCENARIO) -> Path:
    path = folder / "scenario.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory):
    return run(load(_write_scenario(tmp_path_factory.mktemp("certified"))))


def test_the_fleet_arrives_together_with_separation_and_within_its_limits(flown):
    # The issue asks 5 m and 0.1 s of twenty aircraft; these two have the requirements of every scenario, 3 m and 0.05 s.
    entries, fleet = flown.summary["aircraft"], flown.summary["fleet"]
    assert [entry["status"] for entry in entries] == ["arrived", "arrived"]
    assert max(entry["miss_m"] for entry in entries) < 3.0
    assert fleet["arrival_spread_s"] < 0.05
    assert fleet["separation_ratio_min"] >= 1.0
    assert flown.met, flown.summary["requirements"]
    data, limits = flown.dataset, flown.scenario.limits
    approach = data.sel(time=data.time <= max(entry["arrival_s"] for entry in entries))
    assert float(np.abs(approach.bank_deg).max()) < limits.bank_max_deg
    assert float(approach.load_factor.max()) < limits.load_factor_max
    assert float(np.abs(approach.velocity_down_m_s).max()) < limits.climb_rate_max_m_s


def test_the_plan_follows_a_turning_goal_and_records_the_replanning(flown):
    data = flown.dataset
    replanning = data.renewal.isel(aircraft=0).values
    time = data.time.values
    before_turn, after_turn = replanning[(time > 2.0) & (time < _TURN_S)], replanning[(time > _TURN_S + 1.5)]
    assert set(before_turn) <= {CORRECTED}
    assert set(after_turn) <= {CORRECTED, REPLANNED}
    # Without a renewal the boat's turn would be missed by what it moves off its old way: 5 m/s for half a minute.
    assert flown.summary["aircraft"][0]["miss_m"] < 3.0
    # No jerk: the command's rate of turn never jumps by what a bank of 60 deg in one recorded step (0.1 s) would be.
    banks = data.bank_deg.isel(aircraft=0).values[time < flown.summary["aircraft"][0]["arrival_s"]]
    assert np.max(np.abs(np.diff(banks))) < 6.0
    assert UNCHANGED not in set(replanning)


def test_a_stopped_aircraft_is_excluded_from_replanning(flown):
    """The first aircraft is stopped from the start: the turn of its boat no longer causes replanning."""
    planned, count = flown.planned, 2
    state = planned.initial_state()
    is_stopped = jnp.arange(planned.flight.count) == 0  # two fill the fleet up
    statuses = jnp.where(is_stopped, AT_GROUND, own(state).status).astype(jnp.int32)
    stopped = with_own(lambda s: (s.stopped, s.status), state, (is_stopped | own(state).stopped, statuses))
    replanning_statuses = set()
    for number in range(17):
        stopped, history = segment(planned.flight, stopped, number)
        replanning_statuses |= set(np.asarray(history["renewal"])[200:, 1].tolist())
        assert np.all(np.isfinite(history["north"]))
    assert replanning_statuses == {CORRECTED}
    assert own(stopped).status.tolist()[:count] == [AT_GROUND, 0]
    assert np.array_equal(stopped.planner.plan.arrival_times[:count], planned.plan.arrival_times)
    # The path of the one that stands is the first plan's; the other's is too, as its buoy lies where it lay.
    assert np.array_equal(stopped.planner.plan.paths.air_n[0], planned.plan.paths.air_n[0])
    np.testing.assert_allclose(stopped.planner.plan.paths.air_n[1], planned.plan.paths.air_n[1], atol=1e-3)


def test_the_independent_checker_finds_no_breach_at_any_millisecond(flown):
    planned = flown.planned
    plan, limits = planned.plan, jax.tree.map(np.asarray, planned.tasks.limits)
    tasks = planned.tasks
    count = 2
    wind = np.asarray(planned.airspace.wind.velocity_n)
    case = PlanCase(
        Starts(
            0.0,
            np.asarray(tasks.position_n),
            np.asarray(tasks.air_velocity_n) + wind,
            np.asarray(tasks.air_acceleration_n),
        ),
        Goals(
            times=np.zeros((count, 1)),
            positions_n=np.asarray(tasks.goal_position_n)[:, None],
            velocity_after_n=np.asarray(tasks.goal_velocity_n),
            stand_off_n=np.asarray(tasks.rendezvous.stand_off_n),
            course=np.full(count, np.nan),
            path_angle=np.full(count, np.nan),
        ),
        FleetLimits(
            limits.speed_min,
            limits.speed_max,
            limits.bank_max,
            limits.climb_rate_max,
            limits.altitude_min,
            limits.altitude_max,
            limits.load_factor_max,
            limits.acceleration_max,
            limits.deceleration_max,
        ),
        CheckedWind(np.zeros(1), wind[None]),
        KeepOutCylinders(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0)),
        float(planned.airspace.separation.horizontal),
        float(planned.airspace.separation.vertical),
        ArrivalRule("together", np.full(count, np.nan), np.full((count, 2), np.nan), float("nan"), np.arange(count)),
        150.0,
        float(planned.airspace.gravity),
    )
    paths = Paths(*(np.asarray(leaf) for leaf in (plan.paths.times, plan.paths.air_n, plan.paths.drift_n)))
    report = dense_check(paths, case, np.asarray(plan.arrival_times))
    assert report.passes, report.breaches


def test_anser_plan_uses_the_planner_of_the_scenario():
    """Paths cross, and a keep-out covers one: the published planner would have 487 m separation, 580 m intrusion."""
    crossing = _SCENARIO.replace('goal = "boat"', 'goal = "buoy-"').replace('goal = "buoy"', 'goal = "boat"')
    storm = '[[keep_out]]\nname = "storm"\nnorth_m = -4000.0\neast_m = 700.0\nradius_m = 1000.0\n'
    planned = anser.plan(loads(f"{crossing.replace('buoy-', 'buoy')}\n{storm}"))
    assert (planned.refusals, planned.problems()) == ((), ())
    assert np.all(planned.plan.feasible)
    summary = planned.record().summary
    assert (summary["planner"], summary["bounds"]) == ("certified", "proven")
    assert summary["separation"]["value_m"] >= 500.0
    assert summary["separation"]["bound_ratio"] >= 1.0
    assert summary["keep_outs"][0]["room_m"] > 0.0
    head, *notes = str(planned).splitlines()
    assert head == f"two-certified, certified planner: all arrive at {summary['arrival']['last_s']:.2f} s"
    assert all("mean airspeeds other than the preferred" in note for note in notes)


def test_length_and_path_have_the_meaning_of_the_published_planner(flown):
    """The length is measured through the air, from the last replanning on; lateral bend and nominal path are absent."""
    plan, data = flown.planned.plan, flown.dataset
    times = np.linspace(0.0, float(plan.arrival_times[0]), 4001)
    for k, entry in enumerate(flown.summary["aircraft"]):
        path = jax.tree.map(lambda leaf, k=k: leaf[k], plan.paths)
        air_n = np.asarray(jax.vmap(path.air_velocity_n)(times))
        length = np.trapezoid(np.linalg.norm(air_n, axis=1), times)
        level_length = np.trapezoid(np.linalg.norm(air_n[:, :2], axis=1), times)
        assert length > level_length + 5.0  # it comes down 350 to 400 m
        assert float(plan.lengths[k]) == pytest.approx(length, abs=0.01)
        aircraft = data.isel(aircraft=k)
        # the rest of the way: recorded at 40 s, when the path had just been renewed
        arrival_s, remaining_m = (
            float(aircraft.arrival_time_s.sel(time=40.0)),
            float(aircraft.planned_length_m.sel(time=40.0)),
        )
        assert remaining_m == pytest.approx(150.0 * (arrival_s - 40.0), rel=0.05)
        assert np.all(np.isnan(aircraft.lateral_bend_m))
        assert (entry["lateral_bend_m"], entry["nominal"]) == (None, None)
        assert entry["path"] == f"turns {np.degrees(float(plan.total_turn[k])):.0f} deg"
    assert [entry["length_m"] for entry in flown.planned.record().summary["aircraft"]] == list(np.asarray(plan.lengths))
    assert "NaN" in data.lateral_bend_m.attrs["long_name"]


def test_anser_run_flies_the_plan_of_anser_plan(flown):
    planned = anser.plan(flown.scenario)
    for planned_leaf, flown_leaf in zip(
        jax.tree.leaves(planned.plan), jax.tree.leaves(flown.planned.plan), strict=True
    ):
        np.testing.assert_array_equal(planned_leaf, flown_leaf)


def test_an_early_arrival_time_is_refused_with_the_feasible_times(tmp_path):
    early = _SCENARIO.replace("[separation]", '[arrival]\nrule = "at"\ntime_s = 40.0\n\n[separation]')
    result = CliRunner().invoke(app, ["plan", str(_write_scenario(tmp_path, early)), "--out", str(tmp_path / "out")])
    assert result.exit_code == 1
    assert 'aircraft "one" cannot arrive at 40.0 s' in result.stderr
    assert "by itself it can from" in result.stderr
    assert not (tmp_path / "out").exists()
    planned = anser.plan(loads(early))
    assert 'aircraft "one" cannot arrive at 40.0 s' in planned.refusals[0]
    assert planned.problems() == planned.refusals
    assert str(planned).startswith('two-certified, certified planner: no plan\n  aircraft "one" cannot arrive')
    with pytest.raises(NoPlanError, match=r"cannot arrive at 40\.0 s"):
        _ = planned.plan
    with pytest.raises(NoPlanError, match=r"cannot arrive at 40\.0 s"):
        run(loads(early))


def test_a_sequence_rule_becomes_arrival_offsets(tmp_path):
    sequence = _SCENARIO.replace(
        "[separation]", '[arrival]\nrule = "sequence"\nspacing_s = 7.0\norder = ["two", "one"]\n\n[separation]'
    )
    request = arrival_request(load(_write_scenario(tmp_path, sequence)))
    assert request.rule == "sequence"
    np.testing.assert_array_equal(request.offsets_s, [7.0, 0.0])
    assert request.latest_s == 84.0
