"""Figure of a sweep: an abscissa of numbers, a line for each combination of the remaining values."""

import numpy as np

from anser.missions.sweeps import sweep_dataset
from anser.report.campaign_figures import draw_sweep
from anser.results.flight_rows import FlightRow


def flight_row(arrival_s, miss_m):
    """Row of a flight with a single aircraft; without an arrival time, the flight failed to start."""
    if arrival_s is None:
        return FlightRow.failed_start("no plan")
    aircraft = [{"arrival_s": arrival_s, "miss_m": miss_m, "status": "arrived"}]
    unmet = [{"name": "miss_max_m", "met": miss_m < 1.0}]
    return FlightRow(aircraft, {}, unmet, met=miss_m < 1.0)


def sweep(paths, flights):
    return sweep_dataset(paths, ["one"], flights, {"title": "test"})


def test_the_dataset_has_the_result_of_each_flight():
    data = sweep(
        {"a": [1, 2], "b": ["left", "right"]},
        [flight_row(60.0, 0.5), flight_row(None, 0), flight_row(61, 2), flight_row(62, 0)],
    )
    assert data["arrival_s"].dims == ("a", "b", "aircraft")
    np.testing.assert_array_equal(data["arrival_s"].values[..., 0], [[60.0, np.nan], [61.0, 62.0]])
    assert data["met"].values.tolist() == [[True, False], [False, True]]
    assert data["reason"].sel(a=1, b="right").item() == "no plan"
    assert data["status"].sel(a=1, b="right").item() == "no flight"
    assert data["unmet"].sel(a=2, b="left").item() == "miss_max_m"
    assert "arrival_spread_s" not in data


def test_the_figure_has_a_line_for_each_combination_of_text_values(tmp_path):
    data = sweep(
        {"a": [1, 2], "b": ["left", "right"]},
        [flight_row(60.0, 0.5), flight_row(None, 0), flight_row(61, 2), flight_row(62, 0)],
    )
    paths = draw_sweep(data, tmp_path)
    assert {path.name for path in paths} == {"sweep.svg", "sweep.png"}
    svg = (tmp_path / "sweep.svg").read_text()
    for label in ("last arrival (s)", "greatest miss (m)", "b = left", "b = right", ">a<"):
        assert label in svg


def test_a_sweep_without_numbers_has_no_figure(tmp_path):
    data = sweep({"b": ["left", "right"]}, [flight_row(60.0, 0.5), flight_row(61, 2)])
    assert draw_sweep(data, tmp_path) == ()
    assert list(tmp_path.iterdir()) == []
