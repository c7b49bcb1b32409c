"""Statements of documentation pages, compared with the package."""

import gzip
import importlib
import json
import re
import runpy
import tomllib
from pathlib import Path

import numpy as np
import pymap3d
import pytest
import xarray as xr

import anser
from anser.aircraft.airframe import AircraftState
from anser.aircraft_files import AirframeFile
from anser.analysis.step_tests import PUBLISHED_STEPS
from anser.campaigns import Study
from anser.config.file_schema import json_schema
from anser.parts.perception import Belief, LineOfSight, Reading
from anser.parts.planners import AircraftReport, Performance
from anser.report.exports.geographic import _geodetic_deg
from anser.report.flight_figures import FLIGHT_FIGURES
from anser.scenario import Scenario

DOCS = Path(__file__).parents[2] / "docs"
with_copies = runpy.run_path(str(DOCS / "copies.py"))["with_copies"]
PAGES = [path for path in sorted(DOCS.rglob("*.md")) if "generated" not in path.parts]
TABLES = {*Scenario.model_fields, *Study.model_fields, *AirframeFile.model_fields}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_names_of_the_package_and_tables_of_files_exist(page):
    text = page.read_text(encoding="utf-8")
    for name in set(re.findall(r"`(anser(?:\.[A-Za-z_]\w*)+)", text)):
        assert _exists(name), name
    tables = {table.partition(".")[0] for table in re.findall(r"`\[{1,2}([a-z_]+(?:\.[a-z_]+)*)\]{1,2}`", text)}
    assert tables <= TABLES | {"start", "network", "dave_ml"}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_copies_in_the_pages_are_current(page):
    text = page.read_text(encoding="utf-8")
    assert with_copies(text) == text, "make copies"
    for directive in ("{include}", "{literalinclude}"):
        assert directive not in text, "a page must be whole in a clone: docs/copies.py"


def test_the_fields_that_parts_receive_exist():
    text = (DOCS / "how-to" / "own-parts.md").read_text(encoding="utf-8")
    table = text.partition("### What the parts receive")[2].partition("\n\nSensors with errors")[0]
    classes = {
        "`reports`": AircraftReport,
        "`performance`": Performance,
        "`reading`": Reading,
        "`reading.sight`": LineOfSight,
        "`belief`": Belief,
        "`state`": AircraftState,
    }
    rows = [line.split("|") for line in table.splitlines() if line.startswith("| `")]
    assert len(rows) == len(classes)
    for _, argument, _, fields, _ in rows:
        part = classes[next(iter(re.findall(r"`[a-z.]+`", argument)))]
        for name in re.findall(r"`([a-z_]+)(?:\(\w+\))?`", fields):
            assert hasattr(part, name) or name in part.__dataclass_fields__, (argument, name)


def test_every_page_is_linked_from_the_contents_in_a_clone():
    linked = set()
    for page in (DOCS / "index.md", DOCS / "theory" / "index.md"):
        targets = re.findall(r"\]\(([^)#\s:]+\.md)\)", page.read_text(encoding="utf-8"))
        linked |= {(page.parent / target).resolve() for target in targets}
    assert {page.resolve() for page in PAGES} - linked == {(DOCS / "index.md").resolve()}


def test_jax_for_a_gpu_has_the_versions_that_the_package_allows():
    allowed = re.search(r'"jax(>=[^"]+)"', (DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))
    assert allowed is not None
    assert f"jax[cuda12]{allowed[1]}" in (DOCS / "how-to" / "gpu.md").read_text(encoding="utf-8")


def test_the_extras_of_the_package_are_those_of_the_page():
    extras = tomllib.loads((DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    page = (DOCS / "how-to" / "install.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)` \|", page.partition("## Optional extras")[2], flags=re.MULTILINE)
    assert set(listed) == set(extras["optional-dependencies"]) - {"docs", "test"}


def test_margins_of_the_tolerances_of_the_check_cases_are_those_that_the_page_states():
    path = DOCS.parent / "src" / "anser" / "verification" / "data" / "nesc_checkpoints.json"
    least = {}
    for case, log in json.loads(path.read_text(encoding="utf-8"))["cases"].items():
        judged = [k for k, time_s in enumerate(log["times_s"]) if time_s not in log.get("not_judged_s", [])]
        for column in log["columns"].values():
            if "tolerance" in column:
                pairs = zip(column["sim_04"], column["sim_05"], strict=True)
                scatter = np.abs([first - second for first, second in pairs])[judged].max()
                least[case] = min(least.get(case, np.inf), column["tolerance"] / max(scatter, 1e-300))
    digits = 1 - 1e-3  # the tolerances are printed with two digits
    assert all(ratio >= digits for ratio in least.values())
    assert min(least["11"], least["12"]) >= 2 * digits
    assert min(least["13p1"], least["13p3"], least["15"]) >= 4 * digits


def test_numbers_of_the_known_issue_about_events_are_those_of_the_trials():
    issue = (DOCS / "known-issues.md").read_text(encoding="utf-8").partition("| KI-10 |")[2].partition("\n")[0]
    with gzip.open(DOCS / "how-to" / "lost-aircraft.jsonl.gz", "rt") as lines:
        trials = [json.loads(line) for line in lines]
    missed = [trial for trial in trials if not trial["met"]]
    assert {trial["kind"] for trial in missed} == {"arrival-put-off"}
    delayed = sum(trial["kind"] == "arrival-put-off" for trial in trials)
    plans = sum(trial["judge"] == "found" for trial in missed)
    assert (len(missed), len(trials), delayed, plans) == (7, 500, 38, 6)
    for text in ("seven of 500", "38 trials", "six of the seven"):
        assert text in issue


def test_every_source_in_brackets_of_the_verification_page_is_listed():
    listed = set(re.findall(r"\[([A-Z][A-Z0-9]+)\]", (DOCS / "theory" / "index.md").read_text(encoding="utf-8")))
    cited = set(re.findall(r"\[([A-Z][A-Z0-9]+)\](?!\()", (DOCS / "verification.md").read_text(encoding="utf-8")))
    assert "BM" in cited
    assert cited <= listed


def test_the_copies_are_found():
    count = sum(len(re.findall("<!-- copy of ", page.read_text(encoding="utf-8"))) for page in PAGES)
    assert count >= 10


def _exists(name):
    parts = name.split(".")
    if len(parts) == 2 and hasattr(anser, parts[1]):
        return True
    for count in range(len(parts), 0, -1):
        try:
            value = importlib.import_module(".".join(parts[:count]))
        except ImportError:
            continue
        for part in parts[count:]:
            if not hasattr(value, part):
                return False
            value = getattr(value, part)
        return True
    return False


def test_the_files_of_a_flights_figures_are_those_of_the_page():
    section = (DOCS / "figures.md").read_text(encoding="utf-8").partition("## A flight\n")[2].partition("\n## ")[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    listed = [name for cell in cells for name in re.findall("`([^`]+)`", cell)]
    assert sorted(listed) == sorted(f"flight-{name}" for name in FLIGHT_FIGURES)


def test_the_files_of_the_published_cases_are_those_of_the_page():
    section = (DOCS / "figures.md").read_text(encoding="utf-8").partition("## The published cases\n")[2]
    cells = [line.split("|")[1] for line in section.partition("\n## ")[0].splitlines() if line.startswith("| `")]
    listed = [name for cell in cells for name in re.findall("`([^`]+)`", cell)]
    steps = {f"step-{test.key}" for test in PUBLISHED_STEPS}
    assert steps | {"step-overview", "climb-and-turn", "shape-b4", "shape-c4"} < set(listed)
    assert {"step", "climb", "shape", "single", "three"} == {name.partition("-")[0] for name in listed}
    assert set(listed) - steps == {
        "step-overview",
        "climb-and-turn",
        "shape-b4",
        "shape-c4",
        "single-tracks",
        "three-tracks",
    }


def test_the_deviation_of_exported_places_from_the_tangent_plane_is_that_of_the_page():
    stated = re.search(
        r"10 km North and 10 km East of the origin stands (\d+) m .*?: (\d+) m along the ground and (\d+) m below",
        (DOCS / "exports.md").read_text(encoding="utf-8"),
        re.DOTALL,
    )
    dataset = xr.Dataset(attrs={"reference_latitude_deg": 45.0, "reference_longitude_deg": 0.0})
    longitude, latitude = _geodetic_deg(dataset, np.array([1e4]), np.array([1e4]))
    offset = np.array(pymap3d.geodetic2enu(latitude[0], longitude[0], 0.0, 45.0, 0.0, 0.0)) - [1e4, 1e4, 0.0]
    distances = np.linalg.norm(offset), np.linalg.norm(offset[:2]), -offset[2]
    assert [round(value) for value in distances] == [int(value) for value in stated.groups()]


def test_the_page_for_newcomers_denies_nothing_that_a_scenario_has():
    text = (DOCS / "reference" / "coming-from.md").read_text(encoding="utf-8")
    assert {"`[turbulence]`", "`[[gust]]`", "`[[event]]`", "`[wind]`"} <= set(re.findall(r"`\[+[a-z]+\]+`", text))
    assert "none yet" not in text
    assert "with propeller" in text
    # what it denies: no key of a file is about fuel, gear or terrain
    denied = re.search(r"^\| ground, gear, fuel \|.*\| no \|$", text, re.MULTILINE)
    assert denied is not None
    keys = {key for model in (Scenario, AirframeFile) for key in _keys(json_schema(model, "file"))}
    assert not [key for key in keys if re.search("fuel|gear|terrain|ground", key)]
    wind = json_schema(Scenario, "file")["properties"]["wind"]["properties"]
    assert "field" in wind, "the pages say that a field is read: validity.md, questions.md, choose-a-planner.md"


def _keys(schema):
    for name, value in schema.get("properties", {}).items():
        yield name
        yield from _keys(value)
    if isinstance(schema.get("items"), dict):
        yield from _keys(schema["items"])


def test_the_gallery_has_as_many_pictures_as_its_page_says():
    scripts = sorted((DOCS / "gallery").glob("plot_*.py"))
    assert len(scripts) == 16
    assert "Sixteen pictures" in (DOCS / "gallery" / "GALLERY_HEADER.rst").read_text(encoding="utf-8")
    for script in scripts:
        assert "plt.show()" in script.read_text(encoding="utf-8"), script.name
