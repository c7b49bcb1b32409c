"""Figures of estimated goals, and of the communication of a fleet without a centre."""

import json

import numpy as np
import pytest

from anser.report.flight_figures import available_figures, select_figures
from anser.report.flight_sheet import FigureFormat, FlightSheet


@pytest.fixture(scope="module")
def thin(flight):
    return flight[0].isel(time=slice(None, None, 40))


def _draw(dataset, name, width):
    return select_figures(dataset, [name])[name].draw(FlightSheet(dataset, FigureFormat(width)))


@pytest.mark.parametrize(("width", "ellipses"), [(88.0, 2), (180.0, 3)])
def test_the_number_of_error_ellipses_follows_the_width(thin, width, ellipses):
    assert "knowledge" not in available_figures(thin)
    template = thin["altitude_m"]
    deviations = {f"goal_sigma_{axis}_m": 0.0 * template + 5.0 for axis in ("north", "east", "altitude")}
    estimated = thin.assign(deviations | {"goal_correlation": 0.0 * template + 0.5})
    above, *below = _draw(estimated, "knowledge", width).axes
    assert len(below) == ellipses
    assert [len(axes.patches) for axes in below] == [4] * ellipses
    band = above.lines[1].get_ydata()
    np.testing.assert_allclose(band, 2.0 * np.sqrt(3.0) * 5.0)
    assert ("first 2 of 3 aircraft" in above.get_title(loc="left").replace("\n", " ")) == (ellipses == 2)


def test_links_and_clocks_of_a_fleet_without_a_centre_are_drawn(thin):
    assert "network" not in available_figures(thin)
    time = thin["time"].values[::10]
    series = {
        "time_s": time.tolist(),
        "quality_of_service": np.full(time.size, 0.5).tolist(),
        "coordination_error_s": np.exp(-0.1 * time).tolist(),
    }
    network = {"series": series, "window_s": 10.0, "promised_rate_per_s": 0.1}
    heard = thin.assign(heard_from=(("time", "aircraft"), np.tile([2, 1, 0], (thin.sizes["time"], 1))))
    above, middle, below = _draw(heard.assign_attrs(network=json.dumps(network)), "network", 88.0).axes
    assert above.get_yticklabels()[0].get_text() == "anna–bert"
    assert set(middle.lines[0].get_ydata()) == {0.5}
    np.testing.assert_allclose(below.lines[0].get_ydata(), below.lines[1].get_ydata())  # as promised
