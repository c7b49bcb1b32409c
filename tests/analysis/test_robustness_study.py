"""Small study from end to end: Python, dataset, file, figures, command line."""

import functools
import json
import sys

import numpy as np
import pytest

import anser
from anser.analysis import robustness_study
from anser.analysis.robustness import CONDITIONS, FACTORS, FlightPoint, dispersed_cases, single_factor_cases
from anser.analysis.surveys import OUTCOMES
from anser.analysis.trim_points import ConditionError
from anser.cli import main
from anser.results.robustness_statistics import success
from support.plain_files import read_alone

pytestmark = pytest.mark.long


NAMES = [factor.name for factor in FACTORS]
POINTS = (FlightPoint(150.0, 1000.0), FlightPoint(200.0, 6000.0))
short = functools.partial(robustness_study, duration_s=2.0)


@pytest.fixture(scope="module")
def study():
    reports = []
    cases = dispersed_cases(6, 0.2, 5, len(POINTS)) + single_factor_cases(len(POINTS), ("thrust",))
    result = short(conditions=POINTS, cases=cases, progress=lambda description, part: reports.append(part))
    assert reports == sorted(reports)
    assert reports[-1] == pytest.approx(1.0)
    return result, cases


def test_both_inversions_fly_every_trimmable_aircraft(study):
    result, cases = study
    data = result.dataset
    assert data.sizes["flight"] == len(cases.part)
    np.testing.assert_array_equal(data["factor_value"], cases.values)
    flown = data["outcome"].values > 0
    np.testing.assert_array_equal(flown[0], flown[1])
    np.testing.assert_array_equal(flown[0], data["trim_stop"].values == 0)
    np.testing.assert_array_equal(np.isnan(data["alpha_max_deg"].values), ~flown)
    assert flown[:, cases.part == 0].all()
    assert not np.array_equal(data["alpha_max_deg"].values[0, flown[0]], data["alpha_max_deg"].values[1, flown[1]])


def test_an_aircraft_without_thrust_has_no_steady_flight(study):
    """A tenth of the thrust is less than the drag by more than a factor of two."""
    data = study[0].dataset
    weak = (data["alone"].values == NAMES.index("thrust")) & (data["spread_percent"].values < -89)
    stops = data["trim_stop"].attrs["flag_meanings"].split()
    assert [stops[k] for k in data["trim_stop"].values[weak]] == ["thrust_max"] * 2
    counts = success(data, "model", weak)
    assert (counts.drawn, counts.no_steady_flight, counts.flown) == (2, 2, 0)


def test_every_variable_has_a_unit_and_the_dataset_its_provenance(study):
    data = study[0].dataset
    for name, values in data.data_vars.items():
        assert values.attrs["units"], name
        assert values.attrs["long_name"], name
    assert data.attrs["version_anser"] == anser.__version__
    assert data["outcome"].attrs["flag_meanings"].split() == list(OUTCOMES)
    assert data["condition"].attrs["flag_meanings"].split() == ["150_m/s,1000_m", "200_m/s,6000_m"]
    assert data.attrs["seed"] == 0


@pytest.fixture
def command(monkeypatch, capsys):
    """Run the command line with short flights in this process: exit code, standard output, standard error."""

    def call(*options):
        monkeypatch.setattr("anser.analysis.robustness.robustness_study", short)
        monkeypatch.setattr(sys, "argv", ["anser", "robustness", *map(str, options)])
        monkeypatch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call


def test_the_command_writes_the_study(study, command, tmp_path):
    out = tmp_path / "study"
    code, printed, error = command("--out", out, "--flights", 10, "--spread", 10, "--seed", 3, "--json")
    assert code == 0
    assert "robustness.nc" in error
    document = json.loads(printed)
    assert document["study"]["seed"] == 3
    assert document["study"]["spread_percent"] == pytest.approx(10.0)
    rates = document["success"]
    assert list(rates) == ["all", *(f"{p.speed_m_s:g} m/s, {p.altitude_m:g} m" for p in CONDITIONS)]
    for inversion in ("model", "incremental"):
        assert rates["all"][inversion]["drawn"] == 10
        assert (
            sum(counts[inversion]["reached"] for counts in list(rates.values())[1:])
            == rates["all"][inversion]["reached"]
        )
    assert document["first_breaks"] == []
    assert {path.name for path in out.iterdir()} == {"robustness.nc"} | {
        f"{name}.{suffix}" for name in ("success", "errors") for suffix in ("svg", "png")
    }
    data = read_alone(out / "robustness.nc")
    assert data.sizes["flight"] == 10
    assert np.abs(data["factor_value"].sel(factor="mass").values - 1).max() <= 0.1
    code, _, error = command("--out", out)
    assert code == 2
    assert "exists" in error


def test_the_tables_count_the_flights(study, command, monkeypatch, tmp_path):
    """Options reach the study, a single flight point included; the tables are those of the study above."""
    calls = []
    monkeypatch.setattr(sys.modules[__name__], "short", lambda *args, **kwargs: calls.append(kwargs) or study[0])
    code, printed, error = command("--out", tmp_path / "study", "--flights", 4, "--at", "160,1500", "--sweep")
    assert code == 0, error
    assert calls[0]["conditions"] == (FlightPoint(160.0, 1500.0),)
    assert (calls[0]["flights"], calls[0]["spread"], calls[0]["sweep"]) == (4, 0.2, True)
    assert "incremental" in printed
    assert "no steady flight" in printed
    assert f"{int((study[0].dataset['outcome'] > 0).sum())} flights" in printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--flights", 0), "--flights"),
        (("--spread", 95), "0 to 90"),
        (("--spread", "nan"), "--spread"),
        (("--seed", -1), "--seed"),
        (("--variant", "best"), "textbook"),
        (("--aircraft", "aerosonde"), "expected f16 with any --variant"),
        (("--aircraft", "f17"), "perhaps"),
        (("--at", "150"), "SPEED,ALTITUDE"),
        (("--at", "30,1000"), "no steady level flight"),
        (("--at", "235,3000"), "240"),
        ((), "--out"),
    ],
)
def test_bad_options_end_with_2_and_write_nothing(study, command, tmp_path, options, message):
    out = tmp_path / "study"
    code, _, error = command(*options, *(("--out", out) if options else ()))
    assert code == 2
    assert message in error
    assert not out.exists()


@pytest.mark.parametrize("arguments", [{"flights": 0}, {"spread": 1.0}, {"duration_s": 0.5}, {"variant": "best"}])
def test_bad_arguments_are_refused(arguments):
    with pytest.raises(ValueError, match=r"arrived|best"):
        robustness_study(**arguments)


def test_a_condition_without_steady_flight_is_refused(study):
    with pytest.raises(ConditionError, match="no steady level flight"):
        short(flights=1, conditions=(FlightPoint(150.0, 1000.0), FlightPoint(40.0, 1000.0)))
