"""Scenarios, studies and aircraft files that come with anser.

Scenarios and studies are in the folder `SHIPPED` of an installed package, or at the root of a clone.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from anser.config.file_schema import write_new_file

SHIPPED: Final = "shipped"
"""Folder in an installed package that contains the folders of `_PATTERNS`."""
_PACKAGE = Path(__file__).parents[1]
_PATTERNS = ("scenarios/*.toml", "studies/*.toml", "scenarios/own-aircraft/*.toml")
_REFERENCE = re.compile(r'"([^"\n]+\.(?:toml|dml))"')


def shipped_files() -> dict[str, Path]:
    """Return the paths of shipped scenarios, studies and aircraft files by file name without suffix."""
    packed = _PACKAGE / SHIPPED
    folder = packed if packed.is_dir() else _PACKAGE.parents[1]
    library = sorted(_PACKAGE.glob("aircraft/data/*.toml"))
    return {path.stem: path for path in [*(p for pattern in _PATTERNS for p in sorted(folder.glob(pattern))), *library]}


def copy_shipped_file(name: str, target: Path, edit: Callable[[str], str] = str) -> list[Path]:
    """Copy a shipped file to a new file `target`, and the .toml and .dml files named in it into the same folder.

    Return the paths of the named files; a named file that exists in the folder stays unchanged. `edit` changes the text
    of the shipped file. Raises ScenarioError if `target` exists or cannot be written.
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
