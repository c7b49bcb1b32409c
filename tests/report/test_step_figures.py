"""Figures of step responses: labels, reproducible files, no overwriting."""

import sys

import numpy as np
import pytest
import xarray as xr

from anser.report.aircraft_figures import draw_overview, draw_step
from anser.variables import CATALOGUE, catalogue

TIME = np.arange(0.0, 2.005, 0.01)
LABELS = {v.name: {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name} for v in CATALOGUE}
NAMES = (
    *("pitch_rate_deg_s", "yaw_rate_deg_s", "bank_deg", "alpha_deg", "beta_deg", "airspeed_m_s", "path_angle_deg"),
    *("course_deg", "elevator_deg", "aileron_deg", "rudder_deg", "throttle", "power_percent"),
)


def _step_test(read_at_s=2.0):
    """A roll rate that rises to 10 deg/s with a time constant of 0.3 s; the remaining variables are constant."""
    arrays = {name: np.zeros_like(TIME) for name in NAMES}
    arrays["roll_rate_deg_s"] = 10 * (1 - np.exp(-TIME / 0.3))
    arrays["roll_rate_command_deg_s"] = np.full_like(TIME, 10.0)
    arrays["pitch_rate_command_deg_s"] = arrays["yaw_rate_command_deg_s"] = np.zeros_like(TIME)
    conditions = {
        "aircraft": "f16",
        "variant": "textbook",
        "speed_m_s": 150.0,
        "altitude_m": 1000.0,
        "inversion": "model",
    }
    return xr.Dataset(
        {name: ("time", values, LABELS[name]) for name, values in arrays.items()},
        coords={"time": TIME},
        attrs={**conditions, "loop": "rates", "commanded": ["roll_rate_deg_s"], "read_at_s": read_at_s},
    )


def test_a_figure_is_labelled(tmp_path):
    paths = [tmp_path / "a.svg", tmp_path / "a.png"]
    draw_step(_step_test(), paths)
    text = paths[0].read_text()
    for label in ("Rates loop", "+10°/s", "150 m/s", "Yaw rate", "Angle of attack", "Rudder", "Throttle", "command"):
        assert label in text
    assert "after the reading" not in text
    assert paths[1].read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_a_figure_is_reproducible_and_has_a_pdf(tmp_path):
    draw_step(_step_test(), [tmp_path / "a.svg", tmp_path / "a.pdf"])
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    draw_step(_step_test(), [tmp_path / "b.svg"])
    assert (tmp_path / "b.svg").read_bytes() == (tmp_path / "a.svg").read_bytes()


@pytest.mark.long
def test_the_time_after_the_reading_is_marked(tmp_path):
    draw_step(_step_test(read_at_s=1.05), [tmp_path / "a.svg"])
    assert "after the reading at 1.05 s" in (tmp_path / "a.svg").read_text()


def test_the_overview_has_every_test_and_does_not_overwrite(tmp_path):
    path = tmp_path / "a.svg"
    draw_overview([_step_test()] * 5, [path])
    text = path.read_text()
    assert text.count("+10°/s") == 5
    assert "Part of the step (%)" in text
    with pytest.raises(FileExistsError):
        draw_overview([_step_test()], [path])
    assert path.read_text() == text


def test_missing_matplotlib_is_reported_with_the_package_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match="pip install matplotlib"):
        draw_step(_step_test(), [tmp_path / "a.svg"])
    assert not (tmp_path / "a.svg").exists()


def test_other_surfaces_are_labelled_with_their_names(tmp_path):
    surfaces = ("elevator", "left_aileron", "right_aileron", "leading_edge_flap")
    labels = {v.name: {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name} for v in catalogue(surfaces)}
    dataset = _step_test().drop_vars(["aileron_deg", "rudder_deg"])
    for k, name in enumerate(surfaces):
        dataset[f"{name}_deg"] = ("time", np.sin(TIME + k), labels[f"{name}_deg"])
    draw_step(dataset.assign_attrs(surfaces=" ".join(surfaces)), [tmp_path / "a.svg"])
    text = (tmp_path / "a.svg").read_text()
    for label in ("Elevator", "Left aileron", "Right aileron", "Leading edge flap"):
        assert label in text
    assert "Rudder" not in text
