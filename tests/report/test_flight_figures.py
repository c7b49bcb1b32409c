"""Figures of a flight for print: labels, content, and distinction of the aircraft."""

import json

import numpy as np
import pytest

from anser.report import draw_flight
from anser.report.flight_figures import FLIGHT_FIGURES, NEEDED_VARIABLES, available_figures, select_figures
from anser.report.flight_sheet import FigureFormat, FlightSheet
from anser.report.labels import axis_label, axis_scale, escape_mathtext
from anser.report.style import marker_style, series_style

ARRIVAL = 80.0  # of the flight in conftest


@pytest.fixture(scope="module")
def thin(flight):
    """The made-up flight at 2 Hz, for quick drawing."""
    return flight[0].isel(time=slice(None, None, 20))


def _draw(dataset, folder, suffixes=(".svg",), only=None, figure_format=None):
    folder.mkdir()
    chosen = None if only is None else select_figures(dataset, only)
    paths = draw_flight(dataset, "x", folder, suffixes, selection=chosen, figure_format=figure_format)
    assert sorted(paths) == sorted(folder.iterdir())
    return {path.name: path.read_bytes() for path in paths}


@pytest.mark.long
def test_figures_in_three_formats_are_reproducible(thin, tmp_path):
    files = _draw(thin, tmp_path / "a", (".svg", ".png", ".pdf"))
    assert set(files) == {f"x-{key}{suffix}" for key in available_figures(thin) for suffix in (".svg", ".png", ".pdf")}
    assert "bank" in available_figures(thin)
    assert _draw(thin, tmp_path / "b", only=("tracks", "surfaces", "miss")).items() <= files.items()
    for name, content in files.items():
        assert content.startswith({"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}[name[-3:]])


def test_labels_come_from_the_dataset_and_names_are_escaped(thin, tmp_path):
    odd = thin.assign_coords(aircraft=["$x_1$", "<b>", "c"]).assign_attrs(title="a $ b")
    files = _draw(odd, tmp_path / "a", only=("altitudes",))
    text = files["x-altitudes.svg"].decode()
    for label in ("Altitude", "Time", "$x_1$", "&lt;b&gt;", "a $ b: altitudes"):
        assert label in text


@pytest.mark.long
def test_figures_end_at_the_arrival(thin, tmp_path):
    shown = [name for name in NEEDED_VARIABLES if name != "phase" and not name.startswith("goal_velocity")]
    changed_after = thin.copy(deep=True)
    for name in shown:
        changed_after[name][changed_after["time"].values > ARRIVAL] += 1e5
    changed_before = thin.copy(deep=True)
    changed_before["altitude_m"][changed_before["time"].values < 10.0] += 100.0
    names = ("tracks", "altitudes", "bank", "miss")
    reference_files = _draw(thin, tmp_path / "a", only=names)
    assert _draw(changed_after, tmp_path / "b", only=names) == reference_files
    changed_files = _draw(changed_before, tmp_path / "c", only=names)
    changed = [name for name in reference_files if changed_files[name] != reference_files[name]]
    assert changed == [
        "x-altitudes.svg"
    ]  # the miss follows from velocities, of which this flight has only the vertical


def test_a_certified_plan_has_no_shape_parameter(thin, tmp_path):
    certified = thin.assign_attrs(scenario='{"fleet": {"planner": "certified"}}')
    published, shown = (
        _draw(dataset, tmp_path / key, only=("plan",))["x-plan.svg"].decode()
        for dataset, key in ((thin, "a"), (certified, "b"))
    )
    assert "shape parameter" in published
    assert "shape parameter" not in shown
    assert "length and arrival time of the plan" in shown


def test_aircraft_and_lines_are_distinguishable_without_colour():
    looks = {(marker_style(k)["marker"], marker_style(k)["fillstyle"]) for k in range(21)}
    assert len(looks) == 21
    assert len({str(series_style(k)["linestyle"]) for k in range(4)}) == 4


def test_axis_labels_have_name_symbol_and_unit(thin):
    assert axis_label(thin["altitude_m"]) == "Altitude $h$ (m)"
    assert axis_label(thin["airspeed_command_m_s"]) == "True airspeed command\n$V_{c}$ (m/s)"
    assert axis_label(thin["mach"], "Mach") == "Mach $M$"
    assert axis_label(thin["altitude_m"], unit="km") == "Altitude $h$ (km)"
    assert escape_mathtext("a$b") == r"a\$b"


def test_axes_use_kilometres_from_five_digits_on(thin):
    assert axis_scale(thin["altitude_m"], 9999.0) == (1.0, "m")
    assert axis_scale(thin["altitude_m"], 10000.0) == (1e-3, "km")
    assert axis_scale(thin["airspeed_m_s"], 10000.0) == (1.0, "m/s")
    high_flight = thin.copy(deep=True)
    high_flight["altitude_m"] += 12000.0
    axes = FLIGHT_FIGURES["altitudes"].draw(FlightSheet(high_flight, FigureFormat())).axes[0]
    assert axes.get_ylabel() == "Altitude $h$ (km)"
    np.testing.assert_allclose(axes.lines[0].get_ydata()[0], 1e-3 * high_flight["altitude_m"].values[0, 0])
    tracks = FLIGHT_FIGURES["tracks"].draw(FlightSheet(high_flight, FigureFormat())).axes[0]
    assert tracks.get_xlabel().endswith("(km)")
    assert tracks.get_ylabel().endswith("(km)")


def _texts(axes):
    return [text.get_text() for text in axes.texts]


def test_the_limits_of_each_aircraft_are_labelled(thin):
    """One aircraft has a different bank limit and a distant stop of one surface, named in the note."""
    limits = [{"bank_max_deg": 60.0}, {"bank_max_deg": 60.0}, {"bank_max_deg": 31.25}]
    for table, stop in zip(limits, (-20.0, -20.0, -1e4), strict=True):
        table["surfaces_deg"] = {"elevator": [stop, 20.0]}
    mixed = thin.assign_attrs(limits=json.dumps(limits))
    sheet = FlightSheet(mixed, FigureFormat())
    bank = FLIGHT_FIGURES["bank"].draw(sheet).axes[0]
    assert set(_texts(bank)) == {
        f"limit {sign}{value}\N{DEGREE SIGN} ({names})"
        for value, names in (("60", "anna, bert"), ("31.25", "<b>cl\u00e4re</b> & co"))
        for sign in ("", "\u2212")
    }
    low, high = bank.get_ylim()
    assert low < -60.0 < 60.0 < high
    surfaces = FLIGHT_FIGURES["surfaces"].draw(sheet)
    text = " ".join([*_texts(surfaces.axes[0]), surfaces.axes[0].get_title(loc="left").replace("\n", " ")])
    assert "stop 20\N{DEGREE SIGN}" in text
    assert "not shown: elevator, stop \u221210,000\N{DEGREE SIGN} (<b>cl\u00e4re</b> & co)" in text
    assert not _texts(surfaces.axes[1])


def test_missing_surfaces_are_not_drawn(thin):
    without = thin.copy(deep=True)
    without["rudder_deg"][:, 1] = np.nan
    without["aileron_deg"][:] = np.nan
    figure = FLIGHT_FIGURES["surfaces"].draw(FlightSheet(without, FigureFormat()))
    assert [axes.get_ylabel().split(" $")[0] for axes in figure.axes] == ["Elevator", "Rudder"]
    assert [len(axes.lines) for axes in figure.axes] == [6, 4]  # flown and commanded
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {"anna", "bert", "<b>cl\u00e4re</b> & co"}


def test_many_aircraft_have_names_at_their_lines(thin):
    fleet = thin.isel(aircraft=[0, 1, 2] * 4).assign_coords(aircraft=[f"aircraft-{k:02d}" for k in range(12)])
    figure = FLIGHT_FIGURES["bank"].draw(FlightSheet(fleet, FigureFormat(88.0, title=False)))
    (axes,) = figure.axes
    assert figure.legends == []
    assert figure.get_suptitle() == ""
    name_labels = [text for text in axes.texts if not text.get_text().startswith("limit")]
    assert sorted(text.get_text() for text in name_labels) == [f"{k:02d}" for k in range(12)]
    heights = sorted(text.xyann[1] for text in name_labels)
    assert (
        min(np.diff(heights)) * axes.get_position().height * figure.get_figheight() * 72.0 > 5.0
    )  # letters of 6 points
    assert 'names without "aircraft-"' in axes.get_title(loc="left").replace("\n", " ")


def test_letters_keep_their_size_in_a_narrow_figure_and_titles_wrap(thin):
    wide, narrow = (FLIGHT_FIGURES["miss"].draw(FlightSheet(thin, FigureFormat(width))) for width in (180.0, 60.0))
    assert wide.get_figwidth() == pytest.approx(180.0 / 25.4)
    assert narrow.get_figwidth() == pytest.approx(60.0 / 25.4)
    sizes = [[text.get_fontsize() for text in figure.legends[0].get_texts()] for figure in (wide, narrow)]
    assert sizes[0] == sizes[1]
    assert wide.axes[0].xaxis.label.get_fontsize() == narrow.axes[0].xaxis.label.get_fontsize()
    assert narrow.get_suptitle().count("\n") > wide.get_suptitle().count("\n")


@pytest.mark.parametrize("name", ["tracks", "separation", "surfaces"])
def test_a_long_title_lies_within_a_column_of_a_paper(thin, name):
    titled = thin.assign_attrs(title="three aircraft-with-a-long-name that meet three ships in moderate turbulence")
    figure = FLIGHT_FIGURES[name].draw(FlightSheet(titled, FigureFormat(88.0)))
    figure.canvas.draw()
    assert figure.get_suptitle().count("\n") >= 1
    for text in (figure._suptitle, *[title for axes in figure.axes for title in (axes.title, axes._left_title)]):
        if text.get_text():
            extent = text.get_window_extent()
            assert figure.bbox.x0 <= extent.x0 < extent.x1 <= figure.bbox.x1


@pytest.mark.parametrize("width", [0.0, 59.0, 401.0, float("nan"), float("inf")])
def test_a_width_out_of_range_is_refused(width):
    with pytest.raises(ValueError, match=r"arrived .*; expected 60 to 400 mm: one column of a paper is about 88"):
        FigureFormat(width)


def test_steady_goals_are_listed_in_the_note_and_not_drawn(thin):
    assert "goal-velocity" not in available_figures(thin)
    with pytest.raises(ValueError, match="'goal-velocity', which there is not of this flight: every goal stands"):
        select_figures(thin, ["goal-velocity"])
    turning = thin.copy(deep=True)
    turning["goal_velocity_north_m_s"][:, 1] = 5.0 * np.sin(turning["time"].values)
    turning["goal_velocity_east_m_s"][:, 2] = 15.0
    turning["goal_estimate_velocity_east_m_s"][:, 2] = 15.0
    turning.attrs["scenario"] = json.dumps({"aircraft": [{"goal": goal} for goal in ("buoy", "ferry", "ship")]})
    figure = FLIGHT_FIGURES["goal-velocity"].draw(FlightSheet(turning, FigureFormat()))
    (axes,) = figure.axes
    assert axes.get_ylabel().startswith("North velocity of the")
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["bert"]
    note = axes.get_title(loc="left").replace("\n", " ")
    assert note.endswith("buoy stands; ship keeps 15 m/s on course 90\N{DEGREE SIGN}")


def test_goals_have_their_names_on_the_tracks(thin):
    flight_with_goals = thin.assign_attrs(
        scenario=json.dumps({"aircraft": [{"goal": goal} for goal in ("boat", "$1", "boat")]})
    )
    assert _texts(FLIGHT_FIGURES["tracks"].draw(FlightSheet(flight_with_goals, FigureFormat())).axes[0]) == [
        r"\$1",
        "boat",
    ]
    assert _texts(FLIGHT_FIGURES["tracks"].draw(FlightSheet(thin, FigureFormat())).axes[0]) == []
