"""Numbers as plain data, for JSON."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anser.output_files import write_file


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
