"""Plan as dataset, summary and table: units, labels, gaps after the arrival, margins, refusals."""

import csv
import dataclasses
import io
import json

import numpy as np
import pytest

from anser.planning.limits import LIMITS
from anser.results import plan_dataset, plan_summary, write_summary
from anser.results.plan_outputs import TRAJECTORY_COLUMNS, plan_margins, write_trajectories
from anser.variables import CATALOGUE, PLAN_VARIABLES
from support.plan_case import CELL, SPEED, plan_case


def _limits(summary, k):
    return {entry["name"]: entry for entry in summary["aircraft"][k]["limits"]}


def test_variables_have_the_labels_of_the_catalogue():
    samples, details = plan_case(separation_m=(500.0, 150.0))
    dataset = plan_dataset(samples, details)
    by_name = {variable.name: variable for variable in (*CATALOGUE, *PLAN_VARIABLES)}
    for name in (*TRAJECTORY_COLUMNS, "goal_north_m", "distance_min_m", "separation_m", "arrival_time_s"):
        variable = by_name[name]
        assert dataset[name].attrs["units"] == variable.unit
        assert dataset[name].attrs["long_name"] == variable.long_name
    assert all("long_name" in values.attrs for values in dataset.data_vars.values())
    # 0.2 rad is 11.46 deg; the first sine of the samples is 0
    np.testing.assert_allclose(dataset["bank_deg"].values[20, 0], np.degrees(0.2 * np.sin(1.0)), rtol=1e-12)
    assert dataset["limit_bank_max_deg"].values == pytest.approx([45.0] * 3, rel=1e-12)


def test_plan_variables_do_not_collide_with_the_catalogue():
    for field in ("name", "key", "symbol", "long_name"):
        values = [getattr(variable, field) for variable in (*CATALOGUE, *PLAN_VARIABLES)]
        assert len(set(values)) == len(values), field


def test_values_after_an_arrival_are_missing():
    dataset = plan_dataset(*plan_case())
    times = dataset["time"].values
    for name in (*TRAJECTORY_COLUMNS, "goal_north_m"):
        is_finite = np.isfinite(dataset[name].values)
        np.testing.assert_array_equal(is_finite[:, 2], times <= 40.25)
        assert is_finite[:, 0].all()


def test_the_summary_has_margins_and_the_closest_pair():
    samples, details = plan_case(separation_m=(500.0, 150.0), keep_outs=(CELL,), distance_min_m=100.0)
    summary = plan_summary(plan_dataset(samples, details))
    entry = summary["aircraft"][2]
    assert (entry["name"], entry["goal"], entry["arrival_s"], entry["length_m"]) == (
        "carl",
        "buoy-1",
        40.25,
        SPEED * 40.25,
    )
    assert entry["status"] == summary["status"] == "planned"
    limits = _limits(summary, 2)
    assert limits["airspeed_min_m_s"]["margin"] == SPEED - 90.0
    assert limits["airspeed_max_m_s"]["margin"] == 240.0 - SPEED
    assert limits["altitude_min_m"]["margin"] == 1100.0
    assert limits["bank_max_deg"]["margin"] == pytest.approx(45.0 - np.degrees(0.2), rel=1e-12)
    assert limits["thrust_surplus_max_m_s2"]["margin"] == 2.0
    assert "thrust_deficit_max_m_s2" not in limits  # no limit is known
    assert summary["separation"]["pair"] == ["anna", "bert"]
    assert summary["separation"]["margin_m"] == 12.5
    assert summary["least_distance"]["required_m"] == 100.0
    assert summary["keep_outs"] == [{"name": "cell", "aircraft": "anna", "room_m": 250.0, "time_s": 12.0}]
    assert summary["bounds"] == "sampled"
    assert summary["arrival"] == {"rule": "together", "first_s": 40.25, "last_s": 60.0}


def test_margins_refer_to_proven_bounds():
    bounds = {limit.key: np.full(3, 100.0) for limit in LIMITS if limit.key == "airspeed_min"}
    samples, details = plan_case(
        keep_outs=(CELL,), bounds=bounds, separation_bound=1.25, keep_out_bounds_m=np.array([[240.0], [230.0], [260.0]])
    )
    dataset = plan_dataset(samples, details)
    assert plan_margins(dataset)["airspeed_min_m_s"] == pytest.approx([10.0] * 3)
    summary = plan_summary(dataset)
    assert summary["bounds"] == "proven"
    assert (
        _limits(summary, 0)["airspeed_min_m_s"] | {"planned": 150.0, "bound": 100.0}
        == _limits(summary, 0)["airspeed_min_m_s"]
    )
    assert summary["keep_outs"][0]["bound_m"] == 230.0
    assert summary["separation"] is None


def test_a_defective_plan_is_reported_with_valid_json(tmp_path):
    samples, details = plan_case(messages=("too slow", None, None), problems=('aircraft "anna": too slow',))
    samples.extremes.values["bank_max"][0] = np.nan
    summary = plan_summary(plan_dataset(samples, details))
    assert summary["status"] == "not flyable"
    assert summary["problems"] == ['aircraft "anna": too slow']
    assert [entry["status"] for entry in summary["aircraft"]] == ["too slow", "planned", "planned"]
    assert _limits(summary, 0)["bank_max_deg"]["margin"] is None
    write_summary(summary, tmp_path / "plan.json")
    stored = json.loads((tmp_path / "plan.json").read_text())
    assert stored.pop("sha256")  # of the content
    assert stored == summary


def test_one_aircraft_has_no_pair():
    summary = plan_summary(plan_dataset(*plan_case(names=("anna",), arrivals=(20.0,))))
    assert summary["least_distance"]["pair"] is None
    assert summary["least_distance"]["value_m"] is None


def test_the_table_has_every_regular_instant_and_the_arrival(tmp_path):
    samples, details = plan_case(names=("anna", "a, b", "carl"))
    dataset, path = plan_dataset(samples, details), tmp_path / "trajectories.csv"
    write_trajectories(dataset, path)
    text = path.read_bytes().decode()
    assert text.count("\r\n") == text.count("\n")  # RFC 4180
    table = list(csv.DictReader(io.StringIO(text, newline="")))
    assert tuple(table[0]) == ("time_s", "aircraft", *TRAJECTORY_COLUMNS)
    times = {
        name: [float(entry["time_s"]) for entry in table if entry["aircraft"] == name]
        for name in ("anna", "a, b", "carl")
    }
    assert times["anna"] == list(np.arange(0.0, 60.25, 0.5))  # not at the arrival of carl
    assert times["carl"] == [*np.arange(0.0, 40.25, 0.5), 40.25]
    last_entry = table[-1]
    for name in TRAJECTORY_COLUMNS:
        # six decimals are written
        assert float(last_entry[name]) == pytest.approx(dataset[name].sel(time=40.25).values[2], abs=1e-6)
    assert all(value not in ("", "nan") for entry in table for value in entry.values())
    with pytest.raises(FileExistsError):
        write_trajectories(dataset, path)


def test_inconsistent_samples_are_refused():
    samples, details = plan_case()
    with pytest.raises(ValueError, match="altitud"):
        plan_dataset(dataclasses.replace(samples, history={"altitud": samples.history["altitude"]}), details)
    with pytest.raises(ValueError, match="shape"):
        plan_dataset(dataclasses.replace(samples, history={"altitude": samples.history["altitude"][1:]}), details)
    with pytest.raises(ValueError, match="paths has 2 entries for 3 aircraft"):
        plan_dataset(samples, dataclasses.replace(details, paths=("nominal", "nominal")))
    with pytest.raises(ValueError, match="separation"):
        plan_dataset(samples, plan_case(separation_m=(500.0, 0.0))[1])
