"""Small survey from end to end: Python, dataset, file, figures, command line."""

import dataclasses
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import anser.report
from anser.analysis import survey_envelope
from anser.analysis.envelope import CONDITIONS, TrimMap
from anser.analysis.surveys import OUTCOMES, REASONS
from anser.cli import main
from anser.report import draw_envelope
from anser.results import read_netcdf
from support.plain_files import read_alone

pytestmark = pytest.mark.long


ALTITUDES, MACHS = (1000.0, 9000.0, 16000.0), (0.1, 0.5, 1.2)
FIGURES = {f"{name}.{suffix}" for name in ("trim-map", "commands", "margins") for suffix in ("svg", "png")}


@pytest.fixture(scope="module")
def surveyed():
    reports = []
    survey = survey_envelope(
        altitudes_m=ALTITUDES,
        machs=MACHS,
        duration_s=2.0,
        progress=lambda description, part: reports.append((description, part)),
    )
    assert reports[-1][1] == 1.0
    assert [part for _, part in reports] == sorted(part for _, part in reports)
    return survey


def test_points_outside_the_tables_are_not_trimmable(surveyed):
    """16 km is above the data, Mach 1.2 is outside; at Mach 0.1 the lift is too small."""
    data = surveyed.dataset
    stops = data["trim_stop"].attrs["flag_meanings"].split()
    trimmable = data["trimmable"].values
    assert not trimmable[:, 2, :].any()
    assert not trimmable[:, :, [0, 2]].any()
    assert trimmable[:, 0, 1].all()
    assert (data["trim_stop"].values[:, 2, :] == stops.index("tables")).all()
    np.testing.assert_array_equal(trimmable, data["trim_stop"].values == 0)
    assert not (data["with_reserve"].values & ~trimmable).any()


def test_every_trimmable_point_is_flown_with_every_command(surveyed):
    data = surveyed.dataset
    flown = data["outcome"].values > 0
    np.testing.assert_array_equal(flown, np.broadcast_to(data["trimmable"].values[..., None], flown.shape))
    np.testing.assert_array_equal(np.isnan(data["alpha_max_deg"].values), ~flown)
    assert sum(sum(counts.values()) for counts in surveyed.counts().values()) == flown.sum()
    with_reserve = data["with_reserve"].values.sum() * data.sizes["command"]
    assert sum(sum(counts.values()) for counts in surveyed.counts(with_reserve=True).values()) == with_reserve


def test_flights_follow_the_named_command(surveyed):
    """After 2 s from level flight at 1000 m and Mach 0.5, the path angle has turned in the commanded direction."""
    level_point = surveyed.dataset.sel(condition="level", altitude=1000.0, mach=0.5)
    assert float(level_point["load_factor_max"].sel(command="up")) > 1.1
    assert float(level_point["load_factor_min"].sel(command="down")) < 0.9
    assert abs(float(level_point["path_angle_final_error_deg"].sel(command="up"))) < 1.5
    assert float(level_point["course_final_error_deg"].sel(command="right")) > 0.0
    assert (
        float(level_point["airspeed_final_error_m_s"].sel(command="slower"))
        < 0.0
        < float(level_point["airspeed_final_error_m_s"].sel(command="faster"))
    )
    turn = surveyed.dataset.sel(condition="turn_4g", altitude=1000.0, mach=0.5)
    # 4 g along the lift; the load factor is along body z, tilted by alpha
    assert float(turn["load_factor"]) == pytest.approx(4.0 * np.cos(np.radians(float(turn["alpha_deg"]))), rel=0.03)


def test_every_variable_has_a_unit(surveyed):
    data = surveyed.dataset
    for name, values in data.data_vars.items():
        assert values.attrs["units"], name
        assert values.attrs["long_name"], name
    assert data["outcome"].attrs["flag_meanings"].split() == list(OUTCOMES)
    assert data["reason"].attrs["flag_meanings"].split() == list(REASONS)
    assert data.attrs["version_anser"] == anser.__version__


@pytest.fixture
def command(monkeypatch, capsys):
    """Run the command line in this process: exit code, standard output, standard error."""

    def call(*options):
        monkeypatch.setattr(sys, "argv", ["anser", "envelope", *map(str, options)])
        monkeypatch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call


def test_a_surface_on_a_schedule_takes_no_reserve():
    """The leading-edge flap of TP-1538 is at its stop in fast flight."""
    count = len(CONDITIONS)
    points = SimpleNamespace(
        power_margin=np.full(count, 0.5),
        power_above_idle=np.full(count, 0.5),
        surface_margin=np.tile([0.4, 0.0], (count, 1)),
        trimmable=np.ones(count, bool),
    )
    one = np.ones(1)

    def reserve(is_commanded):
        return TrimMap(one, one, np.ones((1, 1)), None, points, is_commanded).with_reserve()[1]

    assert reserve((True, False)).all()
    assert not reserve((True, True)).any()


def _unexplained(surveyed):
    """Return the survey with an unexplained failure of one flight from a point with reserve."""
    data = surveyed.dataset.copy(deep=True)
    c, a, m = np.argwhere(data["with_reserve"].values)[0]
    data["outcome"][c, a, m, 0] = OUTCOMES.index("failed")
    data["reason"][c, a, m, 0] = REASONS.index("unexplained")
    return dataclasses.replace(surveyed, dataset=data)


def test_the_command_writes_the_files_and_ends_with_1_if_a_failure_has_no_name(
    surveyed, command, monkeypatch, tmp_path
):
    monkeypatch.setattr("anser.analysis.envelope.survey_envelope", lambda *args, **kwargs: _unexplained(surveyed))
    out = tmp_path / "survey"
    code, printed, error = command("--out", out, "--json")
    document = json.loads(printed)
    assert code == 1
    assert "no limit explains" in error
    assert len(document["shortfalls"]) == len(_unexplained(surveyed).shortfalls()) >= 1
    assert document["points"] == 45
    assert document["survey"]["inversion"] == "model"
    assert {path.name for path in out.iterdir()} == FIGURES | {"envelope.nc"}
    assert read_alone(out / "envelope.nc").equals(_unexplained(surveyed).dataset)
    code, _, error = command("--out", out)
    assert code == 2
    assert "exists" in error
    (tmp_path / "again").mkdir()
    for path in draw_envelope(read_netcdf(out / "envelope.nc"), tmp_path / "again"):
        assert path.read_bytes() == (out / path.name).read_bytes(), path.name


def test_the_table_counts_the_flights(surveyed, command, monkeypatch, tmp_path):
    """Every failure is explained: exit code 0."""
    data = surveyed.dataset.copy(deep=True)
    bad = data["reason"] == REASONS.index("unexplained")
    data["reason"] = data["reason"].where(~bad, REASONS.index("bank")).astype(np.int32)
    data["reason"].attrs = surveyed.dataset["reason"].attrs
    monkeypatch.setattr(
        "anser.analysis.envelope.survey_envelope", lambda *args, **kwargs: dataclasses.replace(surveyed, dataset=data)
    )
    monkeypatch.setattr(anser.report, "draw_envelope", lambda dataset, folder: ())
    code, printed, _ = command("--out", tmp_path / "survey")
    assert code == 0
    assert "turn" in printed  # a narrow screen folds the names of the conditions
    assert f"{int((data['outcome'] > 0).sum())} flights" in printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--aircraft", "f17"), "one of f16"),
        (("--variant", "best"), "textbook"),
        (("--inversion", "none"), "incremental"),
        ((), "--out"),
    ],
)
def test_bad_options_end_with_2_and_write_nothing(command, tmp_path, options, message):
    out = tmp_path / "survey"
    code, _, error = command(*options, *(("--out", out) if options else ()))
    assert code == 2
    assert message in error
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"machs": [0.5, 0.4]}, "machs"),
        ({"altitudes_m": []}, "altitudes_m"),
        ({"altitudes_m": [np.nan]}, "altitudes_m"),
        ({"duration_s": 0.5}, "100 samples"),
        ({"aircraft": "f17"}, "f17"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        survey_envelope(**arguments)
