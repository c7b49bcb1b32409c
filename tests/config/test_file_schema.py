"""JSON Schema of the files (accepts shipped files, refuses misspelt keys), and key tables of the documentation."""

import copy
import tomllib
from pathlib import Path

import jsonschema
import pytest

from anser.aircraft_files import AirframeFile
from anser.aircraft_files.sources import airframe_starter
from anser.campaigns import Study
from anser.config import json_schema
from anser.config.file_schema import key_tables
from anser.scenario import Scenario
from anser.scenario.files import starter_scenario

ROOT = Path(__file__).parents[2]
SCHEMAS = {model: json_schema(model, "test") for model in (Scenario, Study, AirframeFile)}
VALIDATORS = {model: jsonschema.Draft7Validator(schema) for model, schema in SCHEMAS.items()}
FILES = [
    *((Scenario, path) for path in sorted((ROOT / "scenarios").glob("*.toml"))),
    *((Study, ROOT / "studies" / f"{name}.toml") for name in ("how-surely", "how-rarely", "what-matters")),
    *((AirframeFile, path) for path in sorted((ROOT / "src/anser/aircraft/data").glob("*.toml"))),
]
THREE = tomllib.loads((ROOT / "scenarios/three-aircraft.toml").read_text())


def schema_errors(model, values):
    return [error.message for error in VALIDATORS[model].iter_errors(values)]


@pytest.mark.parametrize("model", SCHEMAS, ids=lambda model: model.__name__)
def test_schemas_are_of_draft_7_without_references(model):
    jsonschema.Draft7Validator.check_schema(SCHEMAS[model])
    text = str(SCHEMAS[model])
    for word in ("$ref", "$defs", "prefixItems", "'null'", ":func:"):
        assert word not in text


@pytest.mark.parametrize(("model", "path"), FILES, ids=lambda parameter: getattr(parameter, "stem", ""))
def test_shipped_files_are_valid(model, path):
    assert schema_errors(model, tomllib.loads(path.read_text())) == []


def test_the_starters_are_valid_and_name_the_schema_in_their_first_line():
    for model, text, name in (
        (Scenario, starter_scenario(), "scenario"),
        (AirframeFile, airframe_starter(), "aircraft"),
    ):
        assert text.startswith(f"#:schema ./anser-{name}.schema.json\n")
        assert schema_errors(model, tomllib.loads(text)) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda values: values["fleet"].update(sped_m_s=150.0), "'sped_m_s' was unexpected"),
        (lambda values: values["aircraft"][1]["start"].update(hight_m=1.0), "'hight_m' was unexpected"),
        (lambda values: values["fleet"].update(speed_m_s="fast"), "'fast' is not of type 'number'"),
        (lambda values: values["fleet"].update(planner="certifed"), "'certifed' is not one of"),
        (lambda values: values["limits"].update(bank_max_deg=99), "99 is greater than the maximum of 85"),
        (lambda values: values.pop("timing"), "'timing' is a required property"),
        (
            lambda values: values["aircraft"][0].update(gains={"rates": {"proportional": [1.0, 2.0]}}),
            "[1.0, 2.0] is not valid",
        ),
        (lambda values: values.update(earth="round"), "'round' is not valid under any"),
    ],
)
def test_an_invalid_key_is_reported(change, expected):
    values = copy.deepcopy(THREE)
    change(values)
    (error,) = schema_errors(Scenario, values)
    assert expected in error


@pytest.mark.parametrize(
    "change",
    [
        lambda values: values["aircraft"][0].update(
            gains={"rates": {"proportional": 8.0, "integral": [0.1, 0.2, 0.3]}}
        ),
        lambda values: values.update(earth="wgs84"),
        lambda values: values["aircraft"][0].update(airframe="my-uav.toml"),
    ],
)
def test_alternative_values_are_valid(change):
    values = copy.deepcopy(THREE)
    change(values)
    assert schema_errors(Scenario, values) == []


def test_the_description_of_a_key_has_meaning_and_range():
    bank = SCHEMAS[Scenario]["properties"]["limits"]["properties"]["bank_max_deg"]
    assert bank == {
        "default": 60.0,
        "description": "largest bank angle: a number from 5 to 85 deg",
        "maximum": 85,
        "minimum": 5,
        "type": "number",
    }


@pytest.mark.parametrize("model", SCHEMAS, ids=lambda model: model.__name__)
def test_the_tables_hold_every_key_of_the_schema(model):
    lines = key_tables(model).splitlines()
    keys = {line.split("`")[1] for line in lines if line.startswith("| `")}
    heads = {line.strip("#` []") for line in lines if line.startswith("## ")}

    def walk(node, path):
        for key, value in node["properties"].items():
            inner = next(
                (one for one in (value, value.get("items"), *value.get("anyOf", ())) if one and "properties" in one),
                None,
            )
            if inner is None:
                assert key in keys, (path, key)
            else:
                inner_path = f"{path}.{key}".removeprefix(".")
                assert inner_path in heads
                walk(inner, inner_path)

    walk(SCHEMAS[model], "")


def test_a_row_has_unit_default_meaning_and_range():
    text = key_tables(Scenario)
    assert "| `step_s` | s | `0.01` | step of the integration | from 0.001 to 0.05 |" in text
    assert "| `duration_s` | s | required | duration of the flight | from 1 to 7200 |" in text
    assert '| `direction` |  | `"right"` | sense of the turn | "right" or "left" |' in text
    assert "## `[[aircraft]]`\n" in text
    assert "## `[aircraft.start]`\n" in text
