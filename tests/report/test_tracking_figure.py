"""Figure of a tracked path: the record up to the arrival."""

import numpy as np
import pytest
import xarray as xr

from anser.report.aircraft_figures import draw_tracking
from anser.variables import CATALOGUE, surface_variables

COUNT, ARRIVAL = 50, 30.0


@pytest.fixture
def dataset():
    """Made-up record of one aircraft, with every variable of the catalogue."""
    time = np.linspace(0.0, 49.0, COUNT)
    variables = {
        v.name: (
            ("time", "aircraft"),
            np.sin(time + k)[:, None],
            {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name},
        )
        for k, v in enumerate(CATALOGUE)
    }
    record = xr.Dataset(variables, {"time": time, "aircraft": ["one"]})
    record["arrival_time_s"][:] = ARRIVAL
    record["position_error_m"][:] = 0.5
    record["position_error_m"][COUNT // 2] = 0.87
    record["position_error_m"][-1] = 99.0  # after the arrival
    return record


def test_the_heading_has_the_worst_error_up_to_the_arrival(dataset, tmp_path):
    path = tmp_path / "figure.svg"
    draw_tracking(dataset, "A title <of> mine", [path])
    text = path.read_text(encoding="utf-8")
    assert "A title &lt;of&gt; mine" in text
    assert "position error 0.87 m at most" in text
    assert "99" not in text.split("position error")[1][:40]
    for name in ("Altitude", "True airspeed", "Deflection", "Course"):
        assert name in text


@pytest.mark.long
def test_figures_are_reproducible_and_do_not_overwrite(dataset, tmp_path):
    first_path, second_path = tmp_path / "a.svg", tmp_path / "b.svg"
    draw_tracking(dataset, "twice", [first_path])
    draw_tracking(dataset, "twice", [second_path])
    assert first_path.read_bytes() == second_path.read_bytes()
    with pytest.raises(FileExistsError):
        draw_tracking(dataset, "twice", [first_path])


@pytest.mark.long
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
