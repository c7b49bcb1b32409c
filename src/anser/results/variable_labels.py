"""Variables in a dataset.

Units, labels and coordinates; series of a catalogue variable over time, or missing ones.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from anser.variables import CATALOGUE, Variable


def to_dataset_units(variable: Variable, array: np.ndarray) -> np.ndarray:
    """Values of a history (SI, rad) in the unit of the dataset; angles in (-180, 180] deg."""
    if variable.unit == "degree":
        # Angles already in the interval pass untouched: the remainder would cost their last digits.
        outside = (array > np.pi) | (array <= -np.pi)
        array = np.where(outside, np.pi - np.mod(np.pi - array, 2.0 * np.pi), array)
    return array if variable.factor == 1.0 else array * variable.factor


def catalogue_attributes(variable: Variable) -> dict[str, object]:
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


def unit_attributes(unit: str, long_name: str) -> dict[str, Any]:
    """Unit and long name as attributes; no unit where it is empty."""
    return {"units": unit, "long_name": long_name} if unit else {"long_name": long_name}


def flag_attributes(long_name: str, meanings: Sequence[str]) -> dict[str, Any]:
    """Attributes of an index (int32); blanks of a meaning become underscores, as the meanings stand in one line."""
    names = " ".join(meaning.replace(", ", ",").replace(" ", "_") for meaning in meanings)
    return {
        **unit_attributes("1", long_name),
        "flag_values": np.arange(len(meanings), dtype=np.int32),
        "flag_meanings": names,
    }


def record_coordinates(time_s: np.ndarray, aircraft_names: Sequence[str]) -> dict[str, Any]:
    """Coordinates of a record over (time, aircraft)."""
    return {
        "time": ("time", time_s, {"units": "s", "long_name": "Time", "symbol": "t"}),
        "aircraft": ("aircraft", np.array(aircraft_names, dtype=np.str_), {"long_name": "Aircraft"}),
    }


def scatter_rows(values: Any, where: np.ndarray) -> np.ndarray:
    """Rows of values, in order, where a mask of any shape is true; elsewhere NaN, or 0 of integers and truth values."""
    array = np.asarray(values)
    full = np.full((*where.shape, *array.shape[1:]), 0 if array.dtype.kind in "ib" else np.nan, array.dtype)
    full[where] = array
    return full


MISSING_CODE = -1
"""In the place of a code or a truth value where there is none; of other variables it is NaN."""
_OF_KEY = {variable.key: variable for variable in CATALOGUE}


def catalogue_variable(key: str) -> Variable:
    """The variable of a key of the catalogue."""
    return _OF_KEY[key]


def convert_series(key: str, values: np.ndarray) -> np.ndarray:
    """Values of a history (SI, rad) in the unit of a dataset; codes and truth values as int32."""
    variable = catalogue_variable(key)
    return to_dataset_units(variable, values) if is_quantity(variable) else values.astype(np.int32)


def missing_series(key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Values of a variable that a flight has not, or of a flight that could not begin."""
    return (
        np.full(shape, np.nan) if is_quantity(catalogue_variable(key)) else np.full(shape, MISSING_CODE, dtype=np.int32)
    )


def is_quantity(variable: Variable) -> bool:
    """Whether it is a quantity; else it is a code or a truth value."""
    return variable.dtype == "float64"
