"""Copies of files, functions and tables of keys in the pages, so that the pages are whole in a clone.

A copy stands between the comments `<!-- copy of SOURCE -->` and `<!-- end of copy -->`. SOURCE is a file, with
the number of its first line (`scenarios/single-aircraft.toml, from line 5`) or a function in it (`tests/x.py, function
f`), or `keys of scenario files`, `variables of plans`, `tasks of environments` (or `observations`, `actions`), `presets
of goal sensors`, `trials of events`. `make copies` writes the copies anew; a test compares them.
"""

import ast
import gzip
import inspect
import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from anser.aircraft_files.schema import AirframeFile
from anser.campaigns.study import Study
from anser.config.file_schema import key_tables
from anser.environments.actions import LEVELS
from anser.environments.cases import autopilot_of, single_aircraft
from anser.environments.environment import MOTION
from anser.environments.registry import TASKS
from anser.environments.spaces import Entry
from anser.scenario.schema import Scenario
from anser.scenario.schema_sensing import PRESETS, goal_sensor_presets
from anser.variables import CATALOGUE, MEASUREMENT_VARIABLES, PLAN_VARIABLES, Variable, surface_variables

ROOT = Path(__file__).parents[1]
VARIABLES = {
    "flights": CATALOGUE,
    "an aircraft with two elevons": surface_variables(["left_elevon", "right_elevon"]),
    "plans": PLAN_VARIABLES,
    "recordings": MEASUREMENT_VARIABLES,
}
KEYS = {"scenario": Scenario, "study": Study, "aircraft": AirframeFile}
COPY = re.compile(r"(<!-- copy of (?P<source>[^\n]*?) -->\n).*?(\n<!-- end of copy -->)", re.DOTALL)
_FILE = re.compile(r"(?P<path>\S+)(?:, from line (?P<line>\d+))?(?:, function (?P<function>\w+))?")
_LANGUAGES = {".toml": "toml", ".py": "python"}


def with_copies(page: str) -> str:
    """Return the text of a page with its copies made anew."""
    return COPY.sub(lambda match: match[1] + copied(match["source"]) + match[3], page)


def copied(source: str) -> str:
    """Return the Markdown of a copy: a table of keys, or a block of code."""
    if source.startswith("keys of "):
        return key_tables(KEYS[source.split()[2]]).strip("\n")
    if source.startswith("variables of "):
        return variable_table(VARIABLES[source.removeprefix("variables of ")])
    if source.endswith(" of environments"):
        return {"tasks": task_table, "observations": observation_table, "actions": action_table}[source.split()[0]]()
    if source in TABLES:
        return TABLES[source]()
    match = _FILE.fullmatch(source)
    if match is None:
        raise ValueError(f"copy of {source}: expected a path, a path and a line, or a path and a function")
    path = ROOT / match["path"]
    lines = path.read_text(encoding="utf-8").splitlines()
    first, last = int(match["line"] or 1), len(lines)
    if match["function"] is not None:
        (function,) = [
            node
            for node in ast.parse("\n".join(lines)).body
            if isinstance(node, ast.FunctionDef) and node.name == match["function"]
        ]
        first, last = min([function.lineno, *(d.lineno for d in function.decorator_list)]), function.end_lineno
    return "\n".join([f"```{_LANGUAGES[path.suffix]}", *lines[first - 1 : last], "```"])


def variable_table(variables: Iterable[Variable]) -> str:
    """Return the Markdown table of variables of the catalogue."""
    rows = ["| name | symbol | unit | frame | meaning |", "|---|---|---|---|---|"]
    for entry in variables:
        flags = f": {', '.join(f'{k} {flag}' for k, flag in enumerate(entry.flags))}" if entry.flags else ""
        symbol = entry.symbol.replace("_", "\\_")
        rows.append(f"| `{entry.name}` | {symbol} | {entry.unit} | {entry.frame} | {entry.long_name}{flags} |")
    return "\n".join(rows)


def task_table() -> str:
    """Return the Markdown table of the tasks: levels of action, duration, ranges and tolerances."""
    rows = ["| task | levels | duration, s | ranges and tolerances |", "|---|---|---|---|"]
    for name, task in TASKS.items():
        text = " ".join((inspect.getdoc(task) or "").split())
        rows.append(f"| `{name}` | {', '.join(task().levels)} | {task().duration_s:g} | {text} |")
    return "\n".join(rows)


def observation_table() -> str:
    """Return the Markdown table of the entries of observations: the motion, then those of each task."""
    tasks_by_entries: dict[tuple[Entry, ...], list[str]] = {}
    for name, task in TASKS.items():
        tasks_by_entries.setdefault(task().entries(), []).append(f"`{name}`")
    groups = ((", ".join(names), entries) for entries, names in tasks_by_entries.items())
    return entry_table("task", [("every task", MOTION), *groups])


def action_table() -> str:
    """Return the Markdown table of the entries of the F-16's actions by level."""
    vehicle, _ = single_aircraft("f16", {})
    autopilot = autopilot_of(vehicle)
    return entry_table("level", [(f'"{k}"', level.entries(autopilot, vehicle.airframe)) for k, level in LEVELS.items()])


def entry_table(head: str, groups: Iterable[tuple[str, Iterable[Entry]]]) -> str:
    """Return the Markdown table of entries in groups: the quantity's values at -1 and 1."""
    rows = [f"| {head} | entry | at -1 | at 1 | unit | meaning |", "|---|---|---|---|---|---|"]
    for group, entries in groups:
        for entry in entries:
            low, high = entry.centre - entry.half_range, entry.centre + entry.half_range
            rows.append(f"| {group} | `{entry.name}` | {low:g} | {high:g} | {entry.unit} | {entry.meaning} |")
    return "\n".join(rows)


def preset_table() -> str:
    """Return the Markdown table of the presets of goal sensors with their sources."""
    presets = goal_sensor_presets()
    rows = [f"| `{key}` | {presets[key]['about']} | {presets[key]['source']} |" for key in PRESETS]
    return "\n".join(["| preset | sensor | source |", "|---|---|---|", *rows])


def event_table() -> str:
    """Return the Markdown table and the summary of the recorded trials of fleets with an event."""
    with gzip.open(ROOT / "docs" / "how-to" / "lost-aircraft.jsonl.gz", "rt") as lines:
        trials = [json.loads(line) for line in lines]
    missed = [trial for trial in trials if not trial["met"]]
    rows = ["| event | fleets | arrived by the rule |", "|---|---:|---:|"]
    for kind in sorted({trial["kind"] for trial in trials}):
        arrivals = [trial["met"] for trial in trials if trial["kind"] == kind]
        rows.append(f"| `{kind}` | {len(arrivals)} | {sum(arrivals)} |")
    rows.append(f"| all | {len(trials)} | {len(trials) - len(missed)} |")
    least = min(trial["separation_ratio"] for trial in trials if trial["separation_ratio"] is not None)
    error_max_m = max(trial["position_error_m"] for trial in missed)
    text = (
        f"No plan after the event: {sum(not trial['planned'] for trial in trials)} fleets. "
        f"The {len(missed)} fleets that "
        f"did not arrive by the rule had a new plan, from which an aircraft deviated by at most "
        f"{error_max_m:.0f} m. The independent checker has a plan for "
        f"{sum(trial['judge'] == 'found' for trial in missed)} of them. "
        f"The least ratio of distance to separation in all fleets is {least:.2f}."
    )
    return "\n".join([*rows, "", text])


TABLES = {"presets of goal sensors": preset_table, "trials of events": event_table}


def pages() -> list[Path]:
    """Return the pages of the documentation."""
    return sorted((ROOT / "docs").rglob("*.md"))


if __name__ == "__main__":
    for path in pages():
        text = path.read_text(encoding="utf-8")
        if with_copies(text) != text:
            path.write_text(with_copies(text), encoding="utf-8")
            sys.stdout.write(f"{path.relative_to(ROOT)}: copies written\n")
