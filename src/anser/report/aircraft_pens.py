"""How each aircraft of a fleet is drawn: colour, dashes, label."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.report.style import color_of

_COLORS = 7  # then the colours begin again, with other dashes
_DASHES: tuple[Any, ...] = ("solid", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1, 1.5)))
_FEW = 7
_PREFIX_MIN = 3


@dataclass(frozen=True)
class Pen:
    """Place in the dataset, label, colour and dashes of an aircraft."""

    index: int
    label: str
    color: str
    dashes: Any
    width: float


def pens_of(dataset: xr.Dataset) -> list[Pen]:
    """One pen for each aircraft whose path is finite at its start."""
    names, prefix = [str(name) for name in dataset["aircraft"].values], shared_prefix(dataset)
    width = 1.5 if len(names) <= _FEW else 1.0 if len(names) <= 3 * _FEW else 0.6
    return [
        Pen(k, name[len(prefix) :], color_of(k), _DASHES[k // _COLORS % len(_DASHES)], width)
        for k, name in enumerate(names)
        if np.isfinite(dataset["north_m"].values[0, k])
    ]


def shared_prefix(dataset: xr.Dataset) -> str:
    """What the names of a large fleet begin with alike and labels leave out; empty for a small one."""
    names = [str(name) for name in dataset["aircraft"].values]
    if len(names) <= _FEW:
        return ""
    prefix = _shared(names).rstrip("0123456789")
    whole = all(len(name) > len(prefix) for name in names)
    return prefix if whole and len(prefix) >= _PREFIX_MIN else ""


def _shared(names: list[str]) -> str:
    """Letters that all names begin with: those that the first and the last in order share."""
    first, last = min(names), max(names)
    differ = (k for k, (one, other) in enumerate(zip(first, last, strict=False)) if one != other)
    return first[: next(differ, min(len(first), len(last)))]
