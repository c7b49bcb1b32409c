"""Output helpers: numbers for JSON, software versions, notebook tables, spreadsheet cells, and installation hints."""

import json
import math
import platform
from collections.abc import Mapping, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

from anser.files import write_file
from anser.version import source_version


def finite_or_none(value: Any) -> float | None:
    """Return a value as a float for JSON; None for None, NaN and infinity."""
    return float(value) if value is not None and math.isfinite(value) else None


def plain_attributes(attributes: Any) -> dict[str, Any]:
    """Return dataset attributes by name, with NumPy scalars converted to plain Python values."""
    return {name: getattr(value, "item", lambda v=value: v)() for name, value in attributes.items()}


def write_json(document: Mapping[str, Any], path: Path, *, overwrite: bool = False) -> None:
    """Write a document to a JSON file, without a checksum.

    Raises FileExistsError if `path` exists and `overwrite` is False. Raises ValueError if a number is NaN or infinite.
    Raises OSError if the file cannot be written.
    """
    write_file(path, json.dumps(document, indent=1, allow_nan=False) + "\n", overwrite=overwrite)


def software_versions() -> dict[str, str]:
    """Return the versions of anser, JAX, equinox, NumPy and Python by name, and anser's git commit, `anser_commit`."""
    source = source_version()
    libraries = {name: version(name) for name in ("jax", "equinox", "numpy")}
    return {
        "anser": source.version,
        "anser_commit": source.commit,
        **libraries,
        "python": platform.python_version(),
    }


def version_attributes() -> dict[str, str]:
    """Return `software_versions` as attributes of a dataset: `version_anser`, `version_jax`, ..."""
    return {f"version_{name}": version for name, version in software_versions().items()}


def install_hint(library: str, extra: str) -> str:
    """Return the message that a library is not installed, with the pip commands for anser's `extra`."""
    return f'{library} is not installed: pip install "anser[{extra}]" (in a clone: pip install -e ".[{extra}]")'


def notebook_table(title: str, entries: Sequence[Mapping[str, str]], notes: Sequence[str] = ()) -> str:
    """Return an HTML table of `entries`, with a title above and notes below; all texts are escaped.

    Each entry is a row: texts by column name. The entries must have the same columns; no entries give no table.
    """
    heads = "".join(f"<th>{escape(name)}</th>" for name in (entries[0] if entries else ()))
    lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in entry.values())}</tr>" for entry in entries)
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{lines}</tbody></table>" if entries else ""
    return f"<div><p><b>{escape(title)}</b></p>{table}{''.join(f'<p>{escape(note)}</p>' for note in notes)}</div>"


_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def escape_spreadsheet_text(text: str) -> str:
    """Return text for a CSV cell; an apostrophe precedes text that a spreadsheet would read as a formula."""
    return f"'{text}" if text.startswith(_FORMULA_STARTS) else text
