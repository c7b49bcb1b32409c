"""Copies of files, functions and tables of keys in the pages, so that the pages are whole in a clone.

A copy stands between the comments `<!-- copy of SOURCE -->` and `<!-- end of copy -->`. SOURCE is a file, with
the number of its first line (`scenarios/single-aircraft.toml, from line 5`) or a function in it (`tests/x.py, function
f`), or `keys of scenario files`, or `variables of plans`. `make copies` writes the copies anew; a test compares them.
"""

import ast
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from anser.aircraft_files.schema import AirframeFile
from anser.campaigns.study import Study
from anser.config.file_schema import key_tables
from anser.scenario.schema import Scenario
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


def pages() -> list[Path]:
    """Return the pages of the documentation."""
    return sorted((ROOT / "docs").rglob("*.md"))


if __name__ == "__main__":
    for path in pages():
        text = path.read_text(encoding="utf-8")
        if with_copies(text) != text:
            path.write_text(with_copies(text), encoding="utf-8")
            sys.stdout.write(f"{path.relative_to(ROOT)}: copies written\n")
