"""Figures of a flight for print: what they say, what they show, how aircraft are told apart."""

import pytest

from anser.report import flight_figures
from anser.report.flight_figures import FLIGHT_FIGURES, NEEDED_VARIABLES, draw_flight
from anser.report.labels import axis_label, plain
from anser.report.print_style import line_of, marker_of

ARRIVAL = 80.0  # of the flight in conftest


@pytest.fixture(scope="module")
def thin(flight):
    """The flight of conftest at 2 Hz: enough to be drawn, and quickly."""
    return flight[0].isel(time=slice(None, None, 20))


def _drawn(dataset, folder, suffixes=(".svg",)):
    folder.mkdir()
    paths = draw_flight(dataset, "x", folder, suffixes)
    assert sorted(paths) == sorted(folder.iterdir())
    return {path.name: path.read_bytes() for path in paths}


@pytest.mark.long
def test_every_figure_in_three_kinds_the_same_twice(thin, tmp_path):
    first = _drawn(thin, tmp_path / "a", (".svg", ".png", ".pdf"))
    assert set(first) == {f"x-{key}{suffix}" for key in FLIGHT_FIGURES for suffix in (".svg", ".png", ".pdf")}
    assert _drawn(thin, tmp_path / "b").items() <= first.items()
    for name, content in first.items():
        assert content.startswith({"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}[name[-3:]])


def test_labels_come_from_the_dataset_and_names_are_text(thin, tmp_path):
    odd = thin.assign_coords(aircraft=["$x_1$", "<b>", "c"]).assign_attrs(title="a $ b")
    drawn = _drawn(odd, tmp_path / "a")
    text = drawn["x-altitudes.svg"].decode()
    for words in ("Altitude", "Time", "$x_1$", "&lt;b&gt;", "a $ b: altitudes"):
        assert words in text
    assert "North velocity of the" in drawn["x-goal-velocity.svg"].decode()


@pytest.mark.long
def test_what_comes_after_the_arrival_is_not_drawn(thin, tmp_path):
    shown = [name for name in NEEDED_VARIABLES if name != "phase"]
    later = thin.copy(deep=True)
    for name in shown:
        later[name][later["time"].values > ARRIVAL] += 1e5
    before = thin.copy(deep=True)
    before["altitude_m"][before["time"].values < 10.0] += 100.0
    first = _drawn(thin, tmp_path / "a")
    assert _drawn(later, tmp_path / "b") == first
    other = _drawn(before, tmp_path / "c")
    assert [name for name in first if other[name] != first[name]] == ["x-altitudes.svg", "x-profile.svg"]


def test_a_certified_plan_has_no_shape_parameter(thin, tmp_path, monkeypatch):
    monkeypatch.setattr(flight_figures, "FLIGHT_FIGURES", {"plan": FLIGHT_FIGURES["plan"]})
    certified = thin.assign_attrs(scenario='{"fleet": {"planner": "certified"}}')
    published, shown = (
        _drawn(one, tmp_path / key)["x-plan.svg"].decode() for one, key in ((thin, "a"), (certified, "b"))
    )
    assert "shape parameter" in published
    assert "shape parameter" not in shown
    assert "length and arrival time of the plan" in shown


def test_aircraft_and_lines_are_told_apart_without_colour():
    looks = {(marker_of(k)["marker"], marker_of(k)["fillstyle"]) for k in range(21)}
    assert len(looks) == 21
    assert len({str(line_of(k)["linestyle"]) for k in range(4)}) == 4


def test_labels(thin):
    assert axis_label(thin["altitude_m"]) == "Altitude $h$ (m)"
    assert axis_label(thin["airspeed_command_m_s"]) == "True airspeed command\n$V_{c}$ (m/s)"
    assert axis_label(thin["mach"], "Mach") == "Mach $M$"
    assert plain("a$b") == r"a\$b"
