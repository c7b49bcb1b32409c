"""Margins from end to end: Python, datasets, files, figures, command line."""

import dataclasses
import json
import sys

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.aircraft_files import load_airframe
from anser.analysis import margins_at, survey_margins
from anser.analysis.loop_margins import breakpoints
from anser.analysis.margins import CLOSED_LOOP_STATES, margin_document, margin_table
from anser.analysis.trim_points import ConditionError
from anser.cli import main
from anser.control import published_gains
from anser.report import draw_bode
from support.plain_files import read_alone

pytestmark = pytest.mark.long


# At Mach 0.25: steady flight at 1 km; at 7 km alpha is beyond the autopilot's 25 deg; above 15 km there are no data.
ALTITUDES, MACHS = (1000.0, 7000.0, 16000.0), (0.245, 0.5)
MAPS = {f"{name}.{suffix}" for name in ("actuators", "loops") for suffix in ("svg", "png")}
FIGURES = ("gain_up_db", "gain_down_db", "phase_margin_deg", "delay_margin_ms", "disk_margin")


@pytest.fixture(scope="module")
def surveyed():
    reports = []
    survey = survey_margins(altitudes_m=ALTITUDES, machs=MACHS, progress=lambda description, part: reports.append(part))
    assert reports[-1] == 1.0
    assert reports == sorted(reports)
    return survey


@pytest.fixture(scope="module")
def point(surveyed):
    """Level flight at a point of the survey."""
    speed = surveyed.dataset["airspeed_m_s"].sel(altitude=1000.0, mach=0.5).item()
    return margins_at(speed_m_s=speed, altitude_m=1000.0)


def test_every_point_has_the_state_of_its_loop(surveyed):
    data = surveyed.dataset
    state = data["closed_loop"]
    assert state.attrs["flag_meanings"].split() == list(CLOSED_LOOP_STATES)
    assert (state.sel(altitude=16000.0) == CLOSED_LOOP_STATES.index("no_trim")).all()
    assert state.sel(condition="level", altitude=1000.0).values.tolist() == [CLOSED_LOOP_STATES.index("stable")] * 2
    limited_point = data.sel(condition="level", altitude=7000.0, mach=0.245)
    assert limited_point["alpha_deg"].item() > 25.0
    assert limited_point["closed_loop"].item() == CLOSED_LOOP_STATES.index("held_back")
    assert limited_point["limited"].sel(command="alpha or load factor").item()
    # only a stable loop has margins
    for name in (*FIGURES, "actuators_disk_margin"):
        missing = np.isnan(data[name].values)
        stable = np.broadcast_to((state == CLOSED_LOOP_STATES.index("stable")).values.reshape(5, 3, 2, 1), (5, 3, 2, 9))
        np.testing.assert_array_equal(missing, ~stable if missing.ndim == 4 else ~stable[..., 0])
    assert not (data["short"].values & ~stable).any()
    assert surveyed.counts()["no_trim"] >= 10
    assert sum(surveyed.counts().values()) == 30


def test_every_variable_has_a_unit(surveyed, point):
    for data in (surveyed.dataset, point):
        for name, values in data.data_vars.items():
            assert values.attrs["units"], name
            assert values.attrs["long_name"], name
        assert data.attrs["version_anser"] == anser.__version__


def test_a_single_point_equals_the_survey_point(surveyed, point):
    survey_point = surveyed.dataset.sel(condition="level", altitude=1000.0, mach=0.5)
    for name in FIGURES:
        # trim is solved again: to 1e-8
        np.testing.assert_allclose(point[name], survey_point[name], rtol=1e-5, err_msg=name)


def test_the_response_has_the_margins(point):
    for name in ("elevator", "P"):
        loop = point.sel(breakpoint=name)
        omega, gain, phase = (loop[key].values for key in ("frequency", "loop_gain_db", "loop_phase_deg"))
        # linear between frequencies 0.05 apart
        gain_at_crossover = np.interp(np.log(loop["crossover_rad_s"].item()), np.log(omega), gain)
        assert abs(gain_at_crossover) < 0.05
        lag = np.interp(np.log(loop["crossover_rad_s"].item()), np.log(omega), phase)
        assert abs((lag + 180 + 180) % 360 - 180) == pytest.approx(loop["phase_margin_deg"].item(), abs=0.3)
        np.testing.assert_allclose(
            np.interp(np.log(loop["gain_up_at_rad_s"].item()), np.log(omega), gain),
            -loop["gain_up_db"].item(),
            atol=0.1,
        )


def test_the_table_counts_points_with_reserve(surveyed):
    reserve_table, full_table = margin_table(surveyed.dataset), margin_table(surveyed.dataset, with_reserve=False)
    assert [entry["breakpoint"] for entry in reserve_table] == list(breakpoints(load_airframe()))
    assert reserve_table[0]["points"] <= full_table[0]["points"] == surveyed.counts()["stable"]
    elevator = surveyed.dataset["gain_margin_db"].sel(breakpoint="elevator").values
    assert full_table[0]["gain_margin_db_min"] == np.nanmin(elevator)
    assert full_table[0]["short"] == surveyed.dataset["short"].sel(breakpoint="elevator").sum()
    assert all(
        entry["phase_margin_deg_min"] <= entry["phase_margin_deg_p5"] <= entry["phase_margin_deg_median"]
        for entry in reserve_table
    )
    json.dumps(surveyed.document(), allow_nan=False)


def test_an_unstable_loop_has_no_margins_and_is_named():
    """Outer loop twenty times as fast as the published loop, and faster than the attitude loop."""
    fast_gains = eqx.tree_at(lambda g: g.velocity.proportional, published_gains(), jnp.full(3, 20.0, dtype=float))
    with pytest.raises(ConditionError, match=r"unstable, pole \+[0-9.]+ \+- [0-9.]+i 1/s"):
        margins_at(speed_m_s=150.0, altitude_m=1000.0, gains=fast_gains)


def test_unstable_points_are_named(surveyed):
    data = surveyed.dataset.copy(deep=True)
    data["closed_loop"][0, 0, 1] = CLOSED_LOOP_STATES.index("unstable")
    data["pole_real_1_s"][0, 0, 1], data["pole_imag_1_s"][0, 0, 1] = 0.25, 3.0
    survey = dataclasses.replace(surveyed, dataset=data)
    assert survey.counts()["unstable"] == 1
    assert "level, 1000 m, Mach 0.500: unstable, pole +0.25 +- 3i 1/s" in survey.shortfalls()


@pytest.fixture
def command(monkeypatch, capsys):
    """Run the command line in this process: exit code, standard output, standard error."""

    def call(*options):
        monkeypatch.setattr(sys, "argv", ["anser", "margins", *map(str, options)])
        monkeypatch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call


def test_the_command_prints_one_point(point, command, monkeypatch, tmp_path):
    monkeypatch.setattr("anser.analysis.margins.margins_at", lambda *args, **kwargs: point)
    picture = tmp_path / "bode.svg"
    code, printed, error = command("--at", "170,1000", "--bode", picture)
    assert code == 0
    for name in breakpoints(load_airframe()):
        (line,) = [line.split() for line in printed.splitlines() if line.split()[:1] == [name]]
        loop = point.sel(breakpoint=name)
        assert f"{loop['phase_margin_deg'].item():.1f}" in line
        down = loop["gain_down_db"].item(), loop["gain_down_searched_db"].item()
        # without a boundary: the bound of the searched gains, or a dash
        assert np.isfinite(down[0]) or ("none" in line) == np.isfinite(down[1])
    (bank,) = [line for line in printed.splitlines() if line.split()[:1] == ["mu"]]
    assert f"none to -{point['gain_down_searched_db'].sel(breakpoint='mu').item():.1f}" in bank
    assert "from 0.001 to 314.16 rad/s" in " ".join(printed.split())
    assert "written" in error
    assert picture.read_text().startswith("<?xml")
    with pytest.raises(FileExistsError):
        draw_bode(point, [picture])
    code, printed, _ = command("--json")
    assert code == 0
    assert json.loads(printed) == json.loads(json.dumps(margin_document(point)))


def test_the_command_surveys_the_envelope(surveyed, command, monkeypatch, tmp_path):
    monkeypatch.setattr("anser.analysis.margins.survey_margins", lambda *args, **kwargs: surveyed)
    out = tmp_path / "margins"
    code, printed, _ = command("--envelope", "--out", out)
    assert code == 0
    assert f"{surveyed.counts()['stable']} points are stable, 0 unstable" in printed
    assert {path.name for path in out.iterdir()} == MAPS | {"margins.nc", "margins.json"}
    assert read_alone(out / "margins.nc").equals(surveyed.dataset)
    assert json.loads((out / "margins.json").read_text()) == json.loads(json.dumps(surveyed.document()))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--at", "5"), "--at: arrived '5'; expected SPEED,ALTITUDE"),
        (("--at", "nan,0"), "--at, speed: arrived nan"),
        (("--aircraft", "f17"), "one of f16"),
        (("--variant", "best"), "textbook"),
        (("--inversion", "none"), "incremental"),
        (("--step-s", "1"), "--step-s: arrived 1; expected a number from 0.001 to 0.05"),
        (("--envelope",), "--out: arrived nothing"),
        (("--out", "new"), "--out: arrived without --envelope"),
        (("--coarse",), "--coarse: arrived without --envelope"),
        (("--envelope", "--out", "new", "--at", "150,1000"), "--at: arrived with --envelope"),
        (("--envelope", "--out", "."), "exists"),
        (("--bode", "bode.jpg"), ".svg, .png or .pdf"),
        (("--bode", "no/such/bode.svg"), "a folder that exists"),
    ],
)
def test_bad_options_end_with_2_and_write_nothing(command, monkeypatch, tmp_path, options, message):
    monkeypatch.chdir(tmp_path)
    code, printed, error = command(*options)
    assert (code, printed) == (2, "")
    assert message in " ".join(error.replace("│", " ").split())
    assert not list(tmp_path.iterdir())


def test_a_loop_without_margins_ends_with_1(command, monkeypatch):
    def refuse(*args, **kwargs):
        raise ConditionError("The closed loop is unstable, pole +1 1/s: there are no margins.")

    monkeypatch.setattr("anser.analysis.margins.margins_at", refuse)
    code, printed, error = command()
    assert (code, printed) == (1, "")
    assert "unstable, pole +1 1/s" in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"machs": [0.5, 0.4]}, "machs"),
        ({"altitudes_m": []}, "altitudes_m"),
        ({"aircraft": "f17"}, "f17"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        survey_margins(**arguments)
