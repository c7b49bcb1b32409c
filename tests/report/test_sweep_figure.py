"""The figure of a sweep: drawn against numbers only, one line for each combination of the rest."""

import numpy as np

from anser.missions.sweeps import sweep_dataset
from anser.report.campaign_figures import draw_sweep
from anser.results.flight_rows import FlightRow


def flight(arrival_s, miss_m):
    """One aircraft that arrives; none where it could not begin."""
    if arrival_s is None:
        return FlightRow.failed_start("no plan")
    aircraft = [{"arrival_s": arrival_s, "miss_m": miss_m, "status": "arrived"}]
    unmet = [{"name": "miss_max_m", "met": miss_m < 1.0}]
    return FlightRow(aircraft, {}, unmet, met=miss_m < 1.0)


def swept(paths, flights):
    return sweep_dataset(paths, ["one"], flights, {"title": "test"})


def test_labels_what_came_of_each_flight():
    data = swept(
        {"a": [1, 2], "b": ["left", "right"]}, [flight(60.0, 0.5), flight(None, 0), flight(61, 2), flight(62, 0)]
    )
    assert data["arrival_s"].dims == ("a", "b", "aircraft")
    np.testing.assert_array_equal(data["arrival_s"].values[..., 0], [[60.0, np.nan], [61.0, 62.0]])
    assert data["met"].values.tolist() == [[True, False], [False, True]]
    assert data["reason"].sel(a=1, b="right").item() == "no plan"
    assert data["status"].sel(a=1, b="right").item() == "no flight"
    assert data["unmet"].sel(a=2, b="left").item() == "miss_max_m"
    assert "arrival_spread_s" not in data


def test_draws_a_line_for_each_combination_of_the_rest(tmp_path):
    data = swept(
        {"a": [1, 2], "b": ["left", "right"]}, [flight(60.0, 0.5), flight(None, 0), flight(61, 2), flight(62, 0)]
    )
    paths = draw_sweep(data, tmp_path)
    assert {path.name for path in paths} == {"sweep.svg", "sweep.png"}
    drawn = (tmp_path / "sweep.svg").read_text()
    for words in ("last arrival (s)", "greatest miss (m)", "b = left", "b = right", ">a<"):
        assert words in drawn


def test_draws_nothing_where_no_number_is_swept(tmp_path):
    data = swept({"b": ["left", "right"]}, [flight(60.0, 0.5), flight(61, 2)])
    assert draw_sweep(data, tmp_path) == ()
    assert list(tmp_path.iterdir()) == []
