"""Copies of files, functions and tables of keys in the pages, so that the pages are whole in a clone.

A copy stands between the comments `<!-- copy of SOURCE -->` and `<!-- end of copy -->`. SOURCE is a file, with
the number of its first line (`scenarios/single-aircraft.toml, from line 5`) or a function in it (`tests/x.py, function
f`), or `keys of scenario files`. `python docs/copies.py` (`make copies`) writes the copies anew; a test compares them.
"""

import ast
import re
import sys
from pathlib import Path

from anser.aircraft_files.schema import AirframeFile
from anser.campaigns.study import Study
from anser.config.file_schema import key_tables
from anser.scenario.schema import Scenario

ROOT = Path(__file__).parents[1]
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


def pages() -> list[Path]:
    """Return the pages of the documentation."""
    return sorted((ROOT / "docs").rglob("*.md"))


if __name__ == "__main__":
    for path in pages():
        text = path.read_text(encoding="utf-8")
        if with_copies(text) != text:
            path.write_text(with_copies(text), encoding="utf-8")
            sys.stdout.write(f"{path.relative_to(ROOT)}: copies written\n")
