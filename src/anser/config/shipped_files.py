"""Scenarios, studies and aircraft files that come with anser: beside the modules, scenarios in a clone at its root."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from anser.config.file_schema import write_new_file

SHIPPED: Final = "shipped"
"""Folder of an installed package with the folders below."""
_PACKAGE = Path(__file__).parents[1]
_PATTERNS = ("scenarios/*.toml", "studies/*.toml", "scenarios/own-aircraft/*.toml")
_REFERENCE = re.compile(r'"([^"\n]+\.(?:toml|dml))"')


def shipped_files() -> dict[str, Path]:
    """Return the paths of the shipped files by name: "three-aircraft" for scenarios/three-aircraft.toml."""
    packed = _PACKAGE / SHIPPED
    folder = packed if packed.is_dir() else _PACKAGE.parents[1]
    library = sorted(_PACKAGE.glob("aircraft/data/*.toml"))
    return {path.stem: path for path in [*(p for pattern in _PATTERNS for p in sorted(folder.glob(pattern))), *library]}


def copy_shipped_file(name: str, target: Path, edit: Callable[[str], str] = str) -> list[Path]:
    """Write a shipped file to a new file, and the files named in it into the same folder; return the paths of those.

    A file that exists in the folder already stays as it is. `edit` changes the text before the writing. Raises
    ScenarioError if the target exists or cannot be written.
    """
    source = shipped_files()[name]
    text = source.read_text(encoding="utf-8")
    references = {reference: source.parent / reference for reference in _REFERENCE.findall(text)}
    companions = {reference: path for reference, path in references.items() if path.is_file()}
    for reference, path in companions.items():
        text = text.replace(f'"{reference}"', f'"{path.name}"')
    write_new_file(target, edit(text))
    copies = [(path, target.with_name(path.name)) for path in companions.values()]
    for path, copy in copies:
        if not copy.exists():
            write_new_file(copy, path.read_text(encoding="utf-8"))
    return [copy for _, copy in copies]
