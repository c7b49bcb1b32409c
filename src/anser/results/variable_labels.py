"""How a variable stands in a dataset: its unit and its labels."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from anser.variables import Variable


def converted(variable: Variable, array: np.ndarray) -> np.ndarray:
    """Values of a history (SI, rad) in the unit of the dataset; angles in (-180, 180] deg."""
    if variable.unit == "degree":
        # Angles already in the interval pass untouched: the remainder would cost their last digits.
        outside = (array > np.pi) | (array <= -np.pi)
        array = np.where(outside, np.pi - np.mod(np.pi - array, 2.0 * np.pi), array)
    return array if variable.factor == 1.0 else array * variable.factor


def labels_of(variable: Variable) -> dict[str, object]:
    """Attributes of a variable of the catalogue."""
    labels: dict[str, object] = {
        "units": variable.unit,
        "frame": variable.frame,
        "long_name": variable.long_name,
        "symbol": variable.symbol,
    }
    if variable.flags:
        # CF: as many values as meanings, in the type in which the variable is stored; truth values are stored as int8.
        stored = np.int8 if variable.dtype == "bool" else np.dtype(variable.dtype)
        labels["flag_values"] = np.arange(len(variable.flags), dtype=stored)
        labels["flag_meanings"] = " ".join(variable.flags)
    return labels


def attributes_of(unit: str, words: str) -> dict[str, Any]:
    """Unit and long name as attributes; no unit where it is empty."""
    return {"units": unit, "long_name": words} if unit else {"long_name": words}


def flags_of(words: str, meanings: Sequence[str]) -> dict[str, Any]:
    """Attributes of an index (int32); blanks of a meaning become underscores, as the meanings stand in one line."""
    names = " ".join(meaning.replace(", ", ",").replace(" ", "_") for meaning in meanings)
    return {
        **attributes_of("1", words),
        "flag_values": np.arange(len(meanings), dtype=np.int32),
        "flag_meanings": names,
    }


def record_coordinates(time_s: np.ndarray, aircraft_names: Sequence[str]) -> dict[str, Any]:
    """Coordinates of a record over (time, aircraft)."""
    return {
        "time": ("time", time_s, {"units": "s", "long_name": "Time", "symbol": "t"}),
        "aircraft": ("aircraft", np.array(aircraft_names, dtype=np.str_), {"long_name": "Aircraft"}),
    }


def scattered(values: Any, where: np.ndarray) -> np.ndarray:
    """Rows of values, in order, where a mask of any shape is true; elsewhere NaN, or 0 of integers and truth values."""
    array = np.asarray(values)
    full = np.full((*where.shape, *array.shape[1:]), 0 if array.dtype.kind in "ib" else np.nan, array.dtype)
    full[where] = array
    return full
