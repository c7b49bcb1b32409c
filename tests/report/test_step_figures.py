"""Figures of step responses: what they say, that they are the same twice, that nothing is overwritten."""

import sys

import numpy as np
import pytest
import xarray as xr

from anser.report.response_figures import draw_overview, draw_step
from anser.variables import CATALOGUE, catalogue

TIME = np.arange(0.0, 2.005, 0.01)
LABELS = {v.name: {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name} for v in CATALOGUE}
NAMES = (
    *("pitch_rate_deg_s", "yaw_rate_deg_s", "bank_deg", "alpha_deg", "beta_deg", "airspeed_m_s", "path_angle_deg"),
    *("course_deg", "elevator_deg", "aileron_deg", "rudder_deg", "throttle", "power_percent"),
)


def _dataset(read_at_s=2.0):
    """A roll rate that rises to 10 deg/s with a time constant of 0.3 s; everything else stays."""
    arrays = {name: np.zeros_like(TIME) for name in NAMES}
    arrays["roll_rate_deg_s"] = 10 * (1 - np.exp(-TIME / 0.3))
    arrays["roll_rate_command_deg_s"] = np.full_like(TIME, 10.0)
    arrays["pitch_rate_command_deg_s"] = arrays["yaw_rate_command_deg_s"] = np.zeros_like(TIME)
    about = {"aircraft": "f16", "variant": "textbook", "speed_m_s": 150.0, "altitude_m": 1000.0, "inversion": "model"}
    return xr.Dataset(
        {name: ("time", values, LABELS[name]) for name, values in arrays.items()},
        coords={"time": TIME},
        attrs={**about, "loop": "rates", "commanded": ["roll_rate_deg_s"], "read_at_s": read_at_s},
    )


def test_a_figure_says_what_it_shows_and_is_the_same_twice(tmp_path):
    paths = [tmp_path / "a.svg", tmp_path / "a.png", tmp_path / "a.pdf"]
    draw_step(_dataset(), paths)
    text = paths[0].read_text()
    for words in ("Rates loop", "+10°/s", "150 m/s", "Yaw rate", "Angle of attack", "Rudder", "Throttle", "command"):
        assert words in text
    assert "after the reading" not in text
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    assert paths[2].read_bytes().startswith(b"%PDF")
    draw_step(_dataset(), [tmp_path / "b.svg"])
    assert (tmp_path / "b.svg").read_bytes() == paths[0].read_bytes()


def test_what_comes_after_the_reading_is_marked(tmp_path):
    draw_step(_dataset(read_at_s=1.05), [tmp_path / "a.svg"])
    assert "after the reading at 1.05 s" in (tmp_path / "a.svg").read_text()


def test_the_overview_has_every_test_and_overwrites_nothing(tmp_path):
    path = tmp_path / "a.svg"
    draw_overview([_dataset()] * 5, [path])
    text = path.read_text()
    assert text.count("+10°/s") == 5
    assert "Part of the step (%)" in text
    with pytest.raises(FileExistsError):
        draw_overview([_dataset()], [path])
    assert path.read_text() == text


def test_without_matplotlib_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match="pip install matplotlib"):
        draw_step(_dataset(), [tmp_path / "a.svg"])
    assert not (tmp_path / "a.svg").exists()


def test_other_surfaces_are_drawn_by_their_names(tmp_path):
    surfaces = ("elevator", "left_aileron", "right_aileron", "leading_edge_flap")
    labels = {v.name: {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name} for v in catalogue(surfaces)}
    dataset = _dataset().drop_vars(["aileron_deg", "rudder_deg"])
    for k, name in enumerate(surfaces):
        dataset[f"{name}_deg"] = ("time", np.sin(TIME + k), labels[f"{name}_deg"])
    draw_step(dataset.assign_attrs(surfaces=" ".join(surfaces)), [tmp_path / "a.svg"])
    text = (tmp_path / "a.svg").read_text()
    for words in ("Elevator", "Left aileron", "Right aileron", "Leading edge flap"):
        assert words in text
    assert "Rudder" not in text
