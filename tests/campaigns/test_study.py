"""Study files: valid files, and refusals before flying."""

import numpy as np
import pytest

from anser.campaigns import load_study
from anser.campaigns.campaign_folder import open_campaign_store
from anser.campaigns.flights import applied_values, create_store, find_bound_cautions
from anser.config import ScenarioError
from campaigns.study_cases import STUDIES, THREE, study_of, text_of


def test_the_shipped_study_is_valid():
    study, scenario, table_columns = load_study(STUDIES / "how-surely.toml")
    assert scenario.name == "uncertain-world"
    assert table_columns == {}
    assert [dispersion.distribution for dispersion in study.vary] == ["triangular", "log-normal", "choice"]


def test_the_shipped_study_for_indices_is_valid(tmp_path):
    study, scenario, table_columns = load_study(STUDIES / "what-matters.toml")
    assert study.block == 5
    assert create_store(tmp_path, study, scenario, table_columns).flights == 320


def test_the_hash_depends_on_the_values():
    study, equal_study = study_of(), study_of()
    assert study.hash == equal_study.hash
    assert study.hash != study_of(seed=2).hash


@pytest.mark.parametrize(
    ("sampling", "said"),
    [
        ({}, "sampling.flights: arrived nothing; expected a value: the method monte-carlo needs it"),
        ({"flights": 0}, "sampling.flights: arrived 0; expected a whole number from 1"),
        ({"method": "sobol", "flights": 100}, "sampling.flights: arrived 100; expected a power of 2"),
        ({"method": "grid", "flights": 8}, "sampling.flights: arrived 8; expected no such key"),
        ({"method": "walk", "flights": 8}, 'sampling.method: arrived "walk"; expected "monte-carlo" or'),
    ],
)
def test_an_invalid_sampling_is_refused(sampling, said):
    with pytest.raises(ScenarioError) as caught:
        study_of(sampling=sampling)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"correlated": [{"paths": ["a", "b"], "coefficients": [[1.0, 0.5], [0.5, 1.0]]}]}, "paths of tables [[vary]]"),
        (
            {"correlated": [{"paths": ["wind.speed_m_s"] * 2, "coefficients": [[1.0, 2.0], [2.0, 1.0]]}]},
            "correlated[0].coefficients: arrived a matrix with the eigenvalue -1",
        ),
        ({"vary": [{"path": "seed", "distribution": "uniform", "low": 0.0, "high": 9.0}]}, "another path"),
        ({"answers": {"quantiles": [1.0]}}, "answers.quantiles[0]: arrived 1; expected a number between 0 and 1"),
        (
            {"keep": {"series": ["airspeed", "postion_error"]}},
            'keep.series[1]: arrived "postion_error"; expected the name of a variable, perhaps "position_error"',
        ),
        ({"keep": {"series": ["airspeed_m_s"]}}, 'perhaps "airspeed": here without its unit'),
        ({"keep": {"series": ["zzzz"]}}, 'such as "position_error", "airspeed"'),
        ({"keep": {"series": ["latitude"]}}, "north and east lead to latitude and longitude"),
        ({"keep": {"series": ["bank", "bank"]}}, 'keep.series[1]: arrived "bank"; expected each variable once'),
        ({"keep": {"series_every_s": 2.0}}, "keep.series: arrived nothing; expected names of variables"),
        (
            {"keep": {"series": ["bank"], "series_every_s": 0.0}},
            "keep.series_every_s: arrived 0.0; expected a number from",
        ),
        ({"keep": {"worst": -1}}, "keep.worst: arrived -1; expected a whole number from 0 to 1000"),
        (
            {"vary": [{"path": "wind.speed_m_s", "distribution": "normal", "mean": 5.0, "std": 1.0}]},
            'vary[0].std: arrived the unknown key "std"; expected perhaps "sigma"',
        ),
        ({"flights": 3}, 'flights: arrived the unknown key "flights"'),
        (
            {
                "sampling": {"method": "grid", "levels": 1000},
                "vary": [
                    {"path": f"aircraft[{k}].start.north_m", "distribution": "uniform", "low": 0.0, "high": 1.0}
                    for k in range(3)
                ],
            },
            "sampling.levels: arrived a grid of 1000000000 flights",
        ),
        (
            {
                "sampling": {"method": "grid", "levels": 1},
                "vary": [
                    {
                        "path": "turbulence.intensity",
                        "distribution": "choice",
                        "values": ["none", "severe"],
                        "weights": [99.0, 1.0],
                    }
                ],
            },
            "vary[0].weights: arrived a list of 2; expected none with the method grid, which flies each value equally",
        ),
    ],
)
def test_inconsistent_tables_are_refused(changes, said):
    with pytest.raises(ScenarioError) as caught:
        study_of(**changes)
    assert said in str(caught.value)


def test_an_item_that_is_no_value_is_named_once():
    vary = [{"path": "wind.speed_m_s", "distribution": "choice", "values": [[1.0], 2.0]}]
    with pytest.raises(ScenarioError) as caught:
        study_of(vary=vary)
    assert {problem.path for problem in caught.value.problems} == {"vary[0].values[0]"}


def test_an_unknown_precision_is_refused():
    with pytest.raises(ScenarioError, match='precision: arrived "float16"; expected "float64" or "float32"'):
        study_of(precision="float16")


def test_a_missing_scenario_is_reported_by_name(tmp_path):
    (tmp_path / "study.toml").write_text(text_of(scenario="nowhere.toml"))
    with pytest.raises(
        ScenarioError, match=r'study.toml: 1 problem\n  line 3, scenario: arrived "nowhere.toml", no file'
    ):
        load_study(tmp_path / "study.toml")


def test_two_paths_of_one_key_are_refused(tmp_path):
    (tmp_path / "three.toml").write_text((STUDIES.parent / "scenarios" / "three-aircraft.toml").read_text())
    paths = "aircraft[1].start.speed_m_s", "aircraft[aircraft-2].start.speed_m_s"
    tables = [f'[[vary]]\npath = "{p}"\ndistribution = "uniform"\nlow = 140.0\nhigh = 150.0\n' for p in paths]
    (tmp_path / "study.toml").write_text(text_of() + "".join(tables))
    with pytest.raises(ScenarioError, match=r"the key of aircraft\[1\]\.start\.speed_m_s again"):
        load_study(tmp_path / "study.toml")


def test_an_unknown_path_is_refused_before_flying(tmp_path):
    study = study_of(vary=[{"path": "wind.sped_m_s", "distribution": "uniform", "low": 0.0, "high": 5.0}])
    with pytest.raises(ScenarioError, match=r"test, what varies of three-aircraft: 1 problem\n.*the unknown key"):
        create_store(tmp_path, study, THREE, {})
    assert not any(tmp_path.iterdir())


def test_an_unknown_path_is_refused_with_the_file_of_the_study_and_its_line(tmp_path):
    (tmp_path / "three.toml").write_text((STUDIES.parent / "scenarios" / "three-aircraft.toml").read_text())
    varied = '[[vary]]\npath = "wind.sped_m_s"\ndistribution = "uniform"\nlow = 0.0\nhigh = 5.0\n'
    (tmp_path / "study.toml").write_text(text_of() + varied)
    line = text_of().count("\n") + 2
    with pytest.raises(ScenarioError, match=rf"study.toml, what varies of .*\n  line {line}, wind.sped_m_s: arrived"):
        open_campaign_store(tmp_path / "study.toml", tmp_path / "out", resume=False)


def test_values_invalid_for_every_flight_are_refused_before_flying(tmp_path):
    study = study_of(vary=[{"path": "wind.speed_m_s", "distribution": "uniform", "low": -9.0, "high": -5.0}])
    with pytest.raises(ScenarioError, match="every flight") as caught:
        create_store(tmp_path, study, THREE, {})
    assert "wind.speed_m_s: arrived -" in str(caught.value)
    assert not any(tmp_path.iterdir())


def test_bounds_outside_the_range_of_a_scenario_get_a_caution():
    wind = {"path": "wind.speed_m_s", "distribution": "uniform", "low": 0.0, "high": 500.0}
    (caution,) = find_bound_cautions(study_of(vary=[wind]), THREE)
    assert caution.startswith("vary[0].high = 500: wind.speed_m_s: arrived 500.0; expected a number from 0 to 100")
    assert find_bound_cautions(study_of(vary=[{**wind, "high": 5.0}]), THREE) == []


def test_values_are_set_added_and_multiplied():
    def applied(path, operation):
        vary = [{"path": path, "distribution": "choice", "values": [2.0], "how": operation}]
        return applied_values(study_of(vary=vary), THREE, {})[path]

    speed = THREE.aircraft[0].start.speed_m_s
    np.testing.assert_array_equal(applied("aircraft[0].start.speed_m_s", "set"), np.full(4, 2.0))
    np.testing.assert_array_equal(applied("aircraft[0].start.speed_m_s", "add"), np.full(4, speed + 2.0))
    np.testing.assert_array_equal(applied("aircraft[0].start.speed_m_s", "multiply"), np.full(4, speed * 2.0))
    with pytest.raises(ScenarioError, match="a number there"):
        applied("earth.model", "add")


def test_a_table_gives_the_values(tmp_path):
    (tmp_path / "values.csv").write_text("wind.speed_m_s,fleet.planner\n0.5,published\n3,certified\n")
    (tmp_path / "three.toml").write_text((STUDIES.parent / "scenarios" / "three-aircraft.toml").read_text())
    text = 'format = 1\nname = "t"\nscenario = "three.toml"\n[sampling]\nmethod = "table"\nfile = "values.csv"\n'
    (tmp_path / "study.toml").write_text(text)
    study, scenario, table_columns = load_study(tmp_path / "study.toml")
    values = applied_values(study, scenario, table_columns)
    assert values["wind.speed_m_s"].tolist() == [0.5, 3.0]
    assert values["fleet.planner"].tolist() == ["published", "certified"]
    (tmp_path / "values.csv").write_text("aircraft[0].aerodynamics_known\nTRUE\nFALSE\n")  # as spreadsheets write them
    assert load_study(tmp_path / "study.toml")[2]["aircraft[0].aerodynamics_known"].tolist() == [True, False]
    for table, message in (
        ("wind.speed_m_s\n0.5,1\n", "row 2: arrived 2 values; expected 1"),
        ("wind.speed_m_s\n\n0.5\n\nnan\n", r"row 5, column wind\.speed_m_s: arrived nan; expected a finite number"),
        ('wind.speed_m_s\n"1\n2\n', "a table that is no CSV"),
        ("wind.speed_m_s\n0.5\nfast\n", r'row 3, column wind\.speed_m_s: arrived "fast"; expected a number'),
        ("seed\n1\n", "another path: the study's seed"),
    ):
        (tmp_path / "values.csv").write_text(table)
        with pytest.raises(ScenarioError, match=message):
            load_study(tmp_path / "study.toml")


def test_integer_parameters_stay_integers():
    vary = [{"path": "format", "distribution": "choice", "values": [1.0, 2.0]}]
    assert applied_values(study_of(vary=vary), THREE, {})["format"].dtype.kind == "i"
    assert applied_values(study_of(), THREE, {})["wind.speed_m_s"].dtype.kind == "f"
