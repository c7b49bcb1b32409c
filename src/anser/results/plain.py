"""Numbers as plain data, for JSON."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def finite_or_none(value: Any) -> float | None:
    """Number; None where there is none, where it is not finite, or no number at all."""
    return float(value) if value is not None and math.isfinite(value) else None


def plain_attributes(attributes: Any) -> dict[str, Any]:
    """Attributes of a dataset, those of NumPy as Python's own."""
    return {name: getattr(value, "item", lambda v=value: v)() for name, value in attributes.items()}


def write_json(document: Mapping[str, Any], path: Path) -> None:
    """Write a new file of JSON.

    Raises
    ------
    FileExistsError
        `path` exists: nothing is overwritten.
    ValueError
        The document holds a number that JSON has not (NaN, infinity).
    """
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    with path.open("x", encoding="utf-8") as file:
        file.write(text)
