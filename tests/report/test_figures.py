"""Figures show what the dataset holds, with its labels, within the limit of points."""

import numpy as np
import pytest

from anser.report.figures import ground_tracks, range_figure, time_panels
from anser.report.traces import axis_title, pens_of


@pytest.fixture(scope="module")
def dataset(flight):
    return flight[0]


@pytest.fixture(scope="module")
def pens(dataset):
    return pens_of(dataset)


def test_no_trace_has_more_than_2000_points(dataset, pens):
    assert dataset.sizes["time"] > 2000
    figures = [
        ground_tracks(dataset, pens, [80.0] * 3, 600),
        range_figure(dataset, pens, [80.0], 300),
        time_panels(dataset, pens, [("airspeed_m_s", "airspeed_command_m_s")], 1, [80.0], 300),
    ]
    assert all(len(trace.x) <= 2000 for figure in figures for trace in figure.data)


def test_tracks_have_equal_axes_east_right_and_north_up(dataset, pens):
    figure = ground_tracks(dataset, pens, [80.0] * 3, 600)
    assert (figure.layout.yaxis.scaleanchor, figure.layout.yaxis.scaleratio) == ("x", 1)
    assert figure.layout.xaxis.title.text == axis_title(dataset["east_m"])
    assert figure.layout.yaxis.title.text == axis_title(dataset["north_m"])
    (start,) = [trace for trace in figure.data if trace.mode == "markers+text" and trace.legendgroup == pens[1].group]
    assert (start.x[0], start.y[0]) == (dataset["east_m"].values[0, 1], dataset["north_m"].values[0, 1])
    assert start.text == (pens[1].name,)


def test_rendezvous_is_drawn_at_the_arrival(dataset, pens):
    figure = ground_tracks(dataset, pens, [40.0, 60.0, 80.0], 600)
    diamonds = [trace for trace in figure.data if trace.marker.symbol == "diamond"]
    for index, (trace, time) in enumerate(zip(diamonds, [40.0, 60.0, 80.0], strict=True)):
        then = dataset.sel(time=time, method="nearest").isel(aircraft=index)
        # The sample at or after the arrival: one step of 0.025 s at 25 m/s is 0.6 m.
        assert trace.x[0] == pytest.approx(float(then["rendezvous_east_m"]), abs=0.7)
        assert trace.y[0] == pytest.approx(float(then["rendezvous_north_m"]), abs=0.7)


def test_each_panel_pairs_response_and_command(dataset, pens):
    panels = [("course_deg", "course_command_deg"), ("throttle", None)]
    figure = time_panels(dataset, pens, panels, 2, [80.0, 80.0, 90.0], 300)
    dashes = [trace.line.dash for trace in figure.data]
    assert (dashes.count("solid"), len(dashes)) == (6, 9)
    assert [title.text for title in figure.layout.annotations] == [axis_title(dataset[name]) for name, _ in panels]
    # One line for each of the two times, in each of the two panels.
    assert len(figure.layout.shapes) == 4
    solid = figure.data[0]
    at = np.searchsorted(solid.x, 30.0)
    expected = np.interp(solid.x[at], dataset["time"], dataset["course_deg"][:, 0])
    # Single precision of a hundred degrees.
    assert solid.y[at] == pytest.approx(expected, abs=1e-3)


def test_range_has_a_logarithmic_axis_to_choose(dataset, pens):
    figure = range_figure(dataset, pens, [80.0], 300)
    kinds = [button.args[0]["yaxis.type"] for button in figure.layout.updatemenus[0].buttons]
    assert kinds == ["linear", "log"]
