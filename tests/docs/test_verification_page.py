"""Verification page: content, plots, and refused documents."""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "docs" / "verification_page.py"
write_verification_page = runpy.run_path(str(SCRIPT))["write_verification_page"]


def _comparison(group, obtained, expected=None, tolerance=None, time_s=None, reference=""):
    error = None if expected is None or obtained is None else obtained - expected
    return {
        "group": group,
        "where": "" if time_s is None else f"t {time_s:g} s",
        "unit": "m",
        "expected": expected,
        "obtained": obtained,
        "error": error,
        "tolerance": tolerance,
        "time_s": time_s,
        "reference": reference,
        "why": "",
        "passed": False if obtained is None else None if expected is None else abs(error) <= tolerance,
        "problem": None if obtained is not None else "obtained nan",
    }


def _check(key, comparisons, problem=None):
    verdicts = [c["passed"] for c in comparisons]
    passed = False if problem or False in verdicts else True if True in verdicts else None
    return {
        "key": key,
        "title": f"Check | {key}",
        "source": "[X] tab. 1",
        "why": "half the last digit",
        "explanation": "What was done.",
        "seconds": 1.0,
        "passed": passed,
        "verdict": {True: "passed", False: "failed", None: "flown, not judged"}[passed],
        "problem": problem,
        "comparisons": comparisons,
    }


@pytest.fixture
def document():
    timed = [
        _comparison("altitudeMsl_ft", 10.0 + 0.1 * t, 10.0, 1.0, t, sim)
        for t in (0.0, 1.0, 2.0)
        for sim in ("sim_04", "sim_05")
    ]
    listed = [_comparison("latitude_deg", 3.0 * t, time_s=t) for t in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    checks = [
        _check("timed", timed),
        _check("listed", listed),
        _check("wrong", [_comparison("length", 2.0, 1.0, 0.5), _comparison("width", None, 1.0, 0.5)]),
        _check("partly", [_comparison("length", 1.0, 1.0, 0.5), _comparison("width", 2.0)]),
        _check("broken", [], "ZeroDivisionError: no"),
    ]
    return {"provenance": {"anser": "1.2.3"}, "passed": False, "seconds": 4.0, "checks": checks}


def test_the_page_lists_passed_and_failed_checks(document, tmp_path):
    text = write_verification_page(document, tmp_path).read_text()
    assert "**Not all checks pass**; computed with anser 1.2.3." in text
    assert "| [Check \\| timed](#check--timed) | 6 of 6 | 0.2 | passed | [X] tab. 1 |" in text
    assert "| [Check \\| listed](#check--listed) | none |  | flown, not judged |" in text
    assert "| [Check \\| wrong](#check--wrong) | 0 of 2 | inf | **failed** |" in text
    assert "| [Check \\| partly](#check--partly) | 1 of 1, 1 more not judged | 0 | passed |" in text
    assert "| width |  |  | 2 |  | flown, not judged | m |" in text
    assert "\nFlown, not judged:\n" in text
    assert text.count("tolerance: half the last digit") == len(document["checks"]) - 1
    assert (
        "## Check | timed\n\n**Passed.** Figures within tolerance: 6 of 6; worst error, in tolerances: 0.2.\n" in text
    )
    assert "## Check | listed\n\n**Flown, not judged.**\n" in text
    assert "**Could not be computed:** ZeroDivisionError: no" in text
    assert "| length |  | 1 | 2 | 1 | 0.5 | m |" in text
    assert "| width |  | 1 |  |  | 0.5 | m |" in text
    # Four of the seven times, the last among them.
    assert "| quantity | t = 0 s | t = 2 s | t = 4 s | t = 6 s | unit |" in text
    assert "| latitude_deg | 0 | 6 | 12 | 18 | m |" in text


def test_plots_show_only_published_histories_and_are_reproducible(document, tmp_path):
    stale = tmp_path / "verification" / "old.svg"
    stale.parent.mkdir()
    stale.write_text("")
    page = write_verification_page(document, tmp_path)
    plots = sorted(path.name for path in stale.parent.iterdir())
    assert plots == ["timed.svg"]
    assert "](verification/timed.svg)" in page.read_text()
    plot = (stale.parent / "timed.svg").read_bytes()
    assert b"altitudeMsl_ft" in plot
    write_verification_page(document, tmp_path)
    assert (stale.parent / "timed.svg").read_bytes() == plot


@pytest.mark.long
def test_the_command_line_writes_the_page_or_refuses(document, tmp_path):
    source = tmp_path / "document.json"
    source.write_text(json.dumps(document))
    run = [sys.executable, SCRIPT]
    completed = subprocess.run([*run, source, tmp_path], capture_output=True, text=True, check=False)
    assert (completed.returncode, completed.stderr) == (0, "")
    assert (tmp_path / "verification.md").exists()
    source.write_text("no JSON")
    refused = subprocess.run([*run, source, tmp_path], capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert "expected the document that `anser verify --json` prints" in refused.stderr
    assert subprocess.run(run, capture_output=True, text=True, check=False).returncode == 2
