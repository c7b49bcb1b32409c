"""The figure of a tracked path: what is drawn is the record up to the arrival."""

import numpy as np
import pytest
import xarray as xr

from anser.report.response_figures import draw_tracking
from anser.variables import CATALOGUE, surface_variables

COUNT, ARRIVAL = 50, 30.0


@pytest.fixture
def dataset():
    """Made-up record with every variable of the catalogue, one aircraft."""
    time = np.linspace(0.0, 49.0, COUNT)
    variables = {
        v.name: (
            ("time", "aircraft"),
            np.sin(time + k)[:, None],
            {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name},
        )
        for k, v in enumerate(CATALOGUE)
    }
    made = xr.Dataset(variables, {"time": time, "aircraft": ["one"]})
    made["arrival_time_s"][:] = ARRIVAL
    made["position_error_m"][:] = 0.5
    made["position_error_m"][COUNT // 2] = 0.87
    made["position_error_m"][-1] = 99.0  # after the arrival
    return made


def test_the_worst_error_up_to_the_arrival_stands_above(dataset, tmp_path):
    path = tmp_path / "figure.svg"
    draw_tracking(dataset, "A title <of> mine", [path])
    text = path.read_text(encoding="utf-8")
    assert "A title &lt;of&gt; mine" in text
    assert "position error 0.87 m at most" in text
    assert "99" not in text.split("position error")[1][:40]
    for name in ("Altitude", "True airspeed", "Deflection", "Course"):
        assert name in text


def test_same_numbers_make_the_same_file_and_nothing_is_overwritten(dataset, tmp_path):
    first, second = tmp_path / "a.svg", tmp_path / "b.svg"
    draw_tracking(dataset, "twice", [first])
    draw_tracking(dataset, "twice", [second])
    assert first.read_bytes() == second.read_bytes()
    with pytest.raises(FileExistsError):
        draw_tracking(dataset, "twice", [first])


def test_surfaces_without_a_common_symbol_are_named(dataset, tmp_path):
    path = tmp_path / "figure.svg"
    draw_tracking(dataset, "standard", [tmp_path / "standard.svg"])
    assert "Left elevon" not in (tmp_path / "standard.svg").read_text(encoding="utf-8")
    for k, v in enumerate(surface_variables(["left_elevon", "right_elevon"])):
        labels = {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name}
        dataset[v.name] = (("time", "aircraft"), np.full((COUNT, 1), float(k)), labels)
    draw_tracking(dataset.assign_attrs(surfaces="left_elevon right_elevon"), "elevons", [path])
    text = path.read_text(encoding="utf-8")
    assert "Left elevon" in text
    assert "Right elevon" in text
