"""Plain forms of results.

Numbers for JSON, software versions, tables for notebooks, text cells for spreadsheets, and hints for optional
libraries.
"""

import json
import math
import platform
from collections.abc import Mapping, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

from anser.files import write_file


def finite_or_none(value: Any) -> float | None:
    """Number; None where there is none, where it is not finite, or no number at all."""
    return float(value) if value is not None and math.isfinite(value) else None


def plain_attributes(attributes: Any) -> dict[str, Any]:
    """Attributes of a dataset, those of NumPy as Python's own."""
    return {name: getattr(value, "item", lambda v=value: v)() for name, value in attributes.items()}


def write_json(document: Mapping[str, Any], path: Path, *, overwrite: bool = False) -> None:
    """Write a file of JSON.

    Raises
    ------
    FileExistsError
        `path` exists and may not be replaced.
    ValueError
        The document holds a number that JSON has not (NaN, infinity).
    """
    write_file(path, json.dumps(document, indent=1, allow_nan=False) + "\n", overwrite=overwrite)


def software_versions() -> dict[str, str]:
    """Versions of anser and of all that its numbers depend on, by name."""
    libraries = {name: version(name) for name in ("anser", "jax", "equinox", "numpy")}
    return {**libraries, "python": platform.python_version()}


def version_attributes() -> dict[str, str]:
    """Attributes of a dataset that tell the versions: `version_jax` and so on."""
    return {f"version_{name}": version for name, version in software_versions().items()}


def install_hint(library: str, extra: str) -> str:
    """Say that a library is not installed, and how to get it: by which extra of anser."""
    return f'{library} is not installed: pip install "anser[{extra}]" (in a clone: pip install -e ".[{extra}]")'


def notebook_table(title: str, rows: Sequence[Mapping[str, str]], notes: Sequence[str] = ()) -> str:
    """Write HTML of a table with a title above and notes below.

    Parameters
    ----------
    title, notes
        Plain text.
    rows
        Cells by the name of their column, all with the same columns; plain text.
    """
    heads = "".join(f"<th>{escape(name)}</th>" for name in (rows[0] if rows else ()))
    lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row.values())}</tr>" for row in rows)
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{lines}</tbody></table>" if rows else ""
    return f"<div><p><b>{escape(title)}</b></p>{table}{''.join(f'<p>{escape(one)}</p>' for one in notes)}</div>"


_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def escape_spreadsheet_text(text: str) -> str:
    """Text for a cell of a CSV file, with an apostrophe in front if a spreadsheet would take it for a formula."""
    return f"'{text}" if text.startswith(_FORMULA_STARTS) else text
