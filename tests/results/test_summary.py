"""Summary of a flight with closed-form numbers."""

import json

import numpy as np
import pytest

from anser.results import read_summary, summarize, write_summary
from anser.results.documents import software_versions
from anser.simulation import STATUS_MESSAGES
from support.made_scenario import made_scenario

TIME = np.arange(0.0, 80.0 + 1e-9, 0.25)
SPEED = 100.0


def flight(arrivals=(50.1, 50.3), misses=(3.0, 4.0)):
    """Aircraft that fly north at 100 m/s, 2 km apart, past rendezvous at rest at the latitude of the origin.

    Aircraft i is nearest to its rendezvous at `arrivals[i]`, `misses[i]` to the east.
    """
    columns = []
    for index, (at, miss) in enumerate(zip(arrivals, misses, strict=True)):
        zero = np.zeros_like(TIME)
        columns.append(
            {
                "north": SPEED * (TIME - at),
                "east": zero + 2000.0 * index + miss,
                "altitude": zero + 300.0,
                "rendezvous_north": zero,
                "rendezvous_east": zero + 2000.0 * index,
                "rendezvous_altitude": zero + 300.0,
                "clearance": np.hypot(SPEED * (TIME - at), 300.0),
                # A ramp from 90 to 110 m/s over 50 s, then faster than ever before.
                "airspeed": np.where(TIME <= 60.0, 90.0 + 0.4 * TIME, 200.0),
                "position_error": np.where(TIME < 50.0, 2.0 + index, 500.0),
                "phase": np.where(TIME < 50.0, 0, 2),  # they arrive after their planned time, in the hold
                "lateral_bend": np.where(TIME < 20.0, 400.0 * index, 50.0),
                "outside_tables": (TIME >= 10.0) & (TIME < 11.5) & (index == 1),
                "arrival_time": zero + 50.0,
                "status": zero.astype(int),
            }
        )
    return {key: np.stack([column[key] for column in columns], axis=1) for key in columns[0]}


def scenario(count=2, **tables):
    names, goals, kinds = ("anna", "bert"), ("buoy", "tanker"), ("surface", "airborne")
    return made_scenario(names[:count], goals[:count], kinds[:count], "two", **tables)


def test_the_summary_has_exactly_the_keys_of_the_contract():
    summary = summarize(TIME, flight(), scenario(), wall_s=1.5)
    assert list(summary) == [
        "format_version",
        "scenario",
        "versions",
        "seed",
        "aircraft",
        "arrival",
        "fleet",
        "requirements",
    ]
    assert summary["format_version"] == 1
    assert summary["scenario"] == {"name": "two", "hash": scenario().hash}
    assert summary["versions"] == software_versions()
    assert set(software_versions()) == {"anser", "anser_commit", "jax", "equinox", "numpy", "python"}
    assert set(summary["fleet"]) == {"arrival_spread_s", "separation_min_m", "wall_s", "simulated_s"}
    for entry in summary["aircraft"]:
        assert set(entry) == {
            "name",
            "goal",
            "planned_arrival_s",
            "arrival_s",
            "miss_m",
            "speed_mean_m_s",
            "speed_min_m_s",
            "speed_max_m_s",
            "clearance_min_m",
            "tables_left",
            "tables_left_s",
            "position_error_max_m",
            "path",
            "nominal",
            "lateral_bend_m",
            "status",
        }


def test_the_numbers_of_a_known_flight_are_exact():
    summary = summarize(TIME, flight(), scenario(), wall_s=1.5)
    anna, bert = summary["aircraft"]
    # The record is linear between samples, so that only rounding of 5 km coordinates remains: relative 1e-6 (pytest's
    # own) is ample.
    assert (anna["name"], anna["goal"], anna["status"]) == ("anna", "buoy", "arrived")
    assert (anna["planned_arrival_s"], anna["arrival_s"]) == (50.0, pytest.approx(50.1))
    assert (anna["miss_m"], bert["miss_m"]) == (pytest.approx(3.0), pytest.approx(4.0))
    assert anna["speed_min_m_s"] == 90.0
    assert anna["speed_max_m_s"] == pytest.approx(90.0 + 0.4 * 50.1)
    assert anna["speed_mean_m_s"] == pytest.approx(90.0 + 0.2 * 50.1)
    assert (anna["position_error_max_m"], bert["position_error_max_m"]) == (2.0, 3.0)
    assert (anna["nominal"], anna["lateral_bend_m"]) == (True, 0.0)
    assert (bert["nominal"], bert["lateral_bend_m"]) == (False, 400.0)
    entries = summarize(TIME, flight(), scenario(), 0.0, ("nominal", "turns 83 deg"))["aircraft"]
    assert [entry["path"] for entry in entries] == ["nominal", "turns 83 deg"]
    assert (anna["tables_left"], anna["tables_left_s"]) == (False, 0.0)
    assert (bert["tables_left"], bert["tables_left_s"]) == (True, pytest.approx(1.5))
    fleet = summary["fleet"]
    assert fleet["arrival_spread_s"] == pytest.approx(0.2)
    # 2001 m apart across, 20 m apart along the track.
    assert fleet["separation_min_m"] == pytest.approx(np.hypot(2001.0, 20.0))
    assert (fleet["wall_s"], fleet["simulated_s"]) == (1.5, 80.0)


def test_each_goal_of_an_aircraft_is_judged_by_its_own_distance():
    """Bert comes within 120 m of the tanker (100 m are required), then takes over the buoy (150 m are required)."""
    history = flight()
    history["clearance"][:, 1] = np.where(TIME < 20.0, 120.0, 310.0)
    taken = [
        {"time_s": 20.0, "kind": "goal-taken-over", "whom": "bert", "planned": True, "message": "", "goal": "buoy"}
    ]
    summary = summarize(TIME, history, scenario(), 0.0, events=taken, goals=("buoy", "buoy"))
    judged = {entry["name"]: entry for entry in summary["requirements"] if entry["name"].startswith("clearance")}
    assert judged["clearance_airborne_min_m"] == {
        "name": "clearance_airborne_min_m",
        "limit": 100.0,
        "value": 120.0,
        "met": True,
    }
    assert judged["clearance_surface_min_m"]["value"] == pytest.approx(300.0, abs=0.5)
    assert judged["clearance_surface_min_m"]["met"]
    without = summarize(TIME, history, scenario(), 0.0)["requirements"]
    assert [entry["value"] for entry in without if entry["name"] == "clearance_airborne_min_m"] == [120.0]


def test_the_separation_is_minimized_between_samples():
    history = flight()
    # They cross head on at 40.125 s, half way between two samples, 7 m apart.
    history["north"] = np.stack([200.0 * (TIME - 40.125), -200.0 * (TIME - 40.125)], axis=1)
    history["east"] = np.stack([0.0 * TIME, 0.0 * TIME + 7.0], axis=1)
    assert summarize(TIME, history, scenario(), 0.0)["fleet"]["separation_min_m"] == pytest.approx(7.0)


def test_one_aircraft_has_no_separation():
    single = scenario(1, requirements={"separation_min_m": 100.0})
    summary = summarize(TIME, flight((50.1,), (3.0,)), single, 0.0)
    assert summary["fleet"]["separation_min_m"] is None
    assert summary["fleet"]["arrival_spread_s"] == 0.0
    entry = {"name": "separation_min_m", "limit": 100.0, "value": None, "met": True}
    assert entry in summary["requirements"]


def test_keep_outs_are_judged_over_the_whole_record_those_of_events_from_their_time_on():
    # At 300 m anna flies north along east = 3 m, bert along east = 2004 m.
    cells = [
        # moves with bert, 500 m ahead: 300 m from its rim
        {"name": "ahead", "north_m": 500 - 50.3 * SPEED, "east_m": 2004, "radius_m": 200, "speed_m_s": SPEED},
        # over both, 100 m higher
        {"name": "above", "north_m": 0, "east_m": 0, "radius_m": 5000, "bottom_m": 400, "top_m": 900},
    ]
    cell = {"name": "late", "north_m": 0, "east_m": 3, "radius_m": 150}
    in_time, after = ({"time_s": at, "kind": "keep-out-appears", "keep_out": cell} for at in (40.0, 80.0))
    for expected, tables in (
        ((100.0, 100.0), {"keep_out": cells}),
        # at the sample 0.1 s before anna crosses the axis, 10 m from it
        ((-140.0, 100.0), {"keep_out": cells, "event": [in_time]}),
        ((2990.0 - 150.0, np.hypot(2970.0, 2001.0) - 150.0), {"event": [after]}),
    ):
        summary = summarize(TIME, flight(), scenario(fleet={"speed_m_s": 100, "planner": "certified"}, **tables), 0.0)
        rooms = [entry["keep_out_room_min_m"] for entry in summary["aircraft"]]
        assert rooms == pytest.approx(expected)
        (entry,) = (entry for entry in summary["requirements"] if entry["name"] == "keep_out_room_min_m")
        assert entry == {"name": "keep_out_room_min_m", "limit": 0.0, "value": min(rooms), "met": min(rooms) >= 0.0}


def test_the_status_has_the_first_and_the_last_failure():
    history = flight()
    history["status"][100:, 1] = 3
    history["status"][200:, 1] = 5
    entries = summarize(TIME, history, scenario(), 0.0)["aircraft"]
    assert [entry["status"] for entry in entries] == ["arrived", f"{STATUS_MESSAGES[3]}; then {STATUS_MESSAGES[5]}"]


@pytest.mark.parametrize("arrivals", [(50.1, 90.0), (50.1, 65.0)])
def test_an_aircraft_that_is_still_closing_has_not_arrived(arrivals):
    # The one beyond the end of the record, the other beyond 10 s after its planned arrival.
    entry = summarize(TIME, flight(arrivals), scenario(), 0.0)["aircraft"][1]
    assert entry["status"].startswith("not arrived")


def test_missing_values_are_null():
    history = flight()
    for key in ("north", "airspeed", "clearance", "position_error", "lateral_bend"):
        history[key][:, 1] = np.nan
    history["arrival_time"][:, 1] = np.nan
    summary = summarize(TIME, history, scenario(), 0.0)
    aircraft = summary["aircraft"][1]
    for key in ("planned_arrival_s", "arrival_s", "miss_m", "speed_mean_m_s", "clearance_min_m", "lateral_bend_m"):
        assert aircraft[key] is None
    assert aircraft["nominal"] is None  # a path without such a bend is not unbent, it has none
    assert aircraft["path"] is None
    assert aircraft["status"].startswith("not arrived")
    assert summary["fleet"]["arrival_spread_s"] is None
    assert [(entry["value"], entry["met"]) for entry in summary["requirements"][:2]] == [(None, False), (None, False)]
    json.dumps(summary, allow_nan=False)


def test_the_record_must_match_the_scenario():
    with pytest.raises(ValueError, match="shape"):
        summarize(TIME, flight(), scenario(1), 0.0)
    with pytest.raises(ValueError, match="zip"):
        summarize(TIME, flight(), scenario(), 0.0, ("nominal",))


def test_a_summary_survives_the_file_and_is_not_overwritten(tmp_path):
    summary = summarize(TIME, flight(), scenario(seed=5), 1.5)
    path = tmp_path / "summary.json"
    write_summary(summary, path)
    assert read_summary(path) == summary
    with pytest.raises(FileExistsError, match="not overwritten"):
        write_summary({}, path)
    assert read_summary(path) == summary


def test_nan_is_refused_in_a_file(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_summary({"miss_m": float("nan")}, tmp_path / "summary.json")
    assert list(tmp_path.iterdir()) == []


def test_another_format_is_refused(tmp_path):
    path = tmp_path / "summary.json"
    path.write_text('{"format_version": 2}')
    with pytest.raises(ValueError, match="format_version 2"):
        read_summary(path)


def test_each_aircraft_has_the_travel_of_its_surfaces():
    """Up and down by 2 deg and 3 deg; surfaces missing on an aircraft have no travel."""
    history, none = flight(), np.full(TIME.size, np.nan)
    zero = np.zeros_like(TIME)
    swing = np.radians(np.interp(TIME, [0.0, 20.0, 40.0, 80.0], [0.0, 2.0, -1.0, -1.0]))
    for key in ("gust_u", "gust_v", "gust_w", "load_factor"):
        history[key] = np.stack([zero, zero], axis=1)
    history["surfaces_limited"] = np.zeros((TIME.size, 2), dtype=bool)
    history |= {"flap": np.stack([swing, none], axis=1), "rudder": np.stack([none, 2.0 * swing], axis=1)}
    anna, bert = summarize(TIME, history, scenario(), 0.0, surfaces=[("flap",), ("rudder",)])["aircraft"]
    # the sum of 320 steps in rad
    assert anna["flap_travel_deg"] == pytest.approx(5.0, rel=1e-12)
    assert bert["rudder_travel_deg"] == pytest.approx(10.0, rel=1e-12)
    assert [key for entry in (anna, bert) for key in entry if key.endswith("_travel_deg")] == [
        "flap_travel_deg",
        "rudder_travel_deg",
    ]
    with pytest.raises(ValueError, match="surfaces are those of 1 aircraft; there are 2"):
        summarize(TIME, history, scenario(), 0.0, surfaces=[("flap",)])
