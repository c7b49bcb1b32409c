"""Labels of variables in datasets (units, long names, coordinates), and conversion of values to dataset units."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from anser.variables import CATALOGUE, Variable


def to_dataset_units(variable: Variable, array: Any, xp: Any = np) -> Any:
    """Convert values of a history (SI, rad) to the variable's unit in datasets; angles are wrapped to (-180, 180] deg.

    `xp` must be the module of the arrays, `numpy` or `jax.numpy`.
    """
    if variable.unit == "degree":
        # Angles inside the interval are unchanged: the remainder would round them.
        outside = (array > np.pi) | (array <= -np.pi)
        array = xp.where(outside, np.pi - xp.mod(np.pi - array, 2.0 * np.pi), array)
    return array if variable.factor == 1.0 else array * variable.factor


def catalogue_attributes(variable: Variable) -> dict[str, object]:
    """Return a variable's dataset attributes: unit, frame, long name, symbol and, if discrete, the CF flags."""
    labels: dict[str, object] = {
        "units": variable.unit,
        "frame": variable.frame,
        "long_name": variable.long_name,
        "symbol": variable.symbol,
    }
    if variable.flags:
        # CF: one value per meaning, in the variable's storage type; booleans are stored as int8.
        stored = np.int8 if variable.dtype == "bool" else np.dtype(variable.dtype)
        labels["flag_values"] = np.arange(len(variable.flags), dtype=stored)
        labels["flag_meanings"] = " ".join(variable.flags)
    return labels


def unit_attributes(unit: str, long_name: str) -> dict[str, Any]:
    """Return unit and long name as dataset attributes `units` and `long_name`; an empty unit is omitted."""
    return {"units": unit, "long_name": long_name} if unit else {"long_name": long_name}


def flag_attributes(long_name: str, meanings: Sequence[str]) -> dict[str, Any]:
    """Return the dataset attributes of a coded variable (int32) with the meanings of the codes 0, 1, 2, ...

    In `flag_meanings`, blanks separate the meanings; blanks within a meaning become underscores.
    """
    names = " ".join(meaning.replace(", ", ",").replace(" ", "_") for meaning in meanings)
    return {
        **unit_attributes("1", long_name),
        "flag_values": np.arange(len(meanings), dtype=np.int32),
        "flag_meanings": names,
    }


def record_coordinates(time_s: np.ndarray, aircraft_names: Sequence[str]) -> dict[str, Any]:
    """Return the xarray coordinates `time` (s) and `aircraft` (names) of a dataset recorded over both."""
    return {
        "time": ("time", time_s, {"units": "s", "long_name": "Time", "symbol": "t"}),
        "aircraft": ("aircraft", np.array(aircraft_names, dtype=np.str_), {"long_name": "Aircraft"}),
    }


def scatter_rows(values: Any, mask: np.ndarray) -> np.ndarray:
    """Return an array, shape (*mask.shape, ...), with `values` (n, ...), in order, at the n true entries of `mask`.

    All other entries are NaN, or 0 for integers and booleans.
    """
    array = np.asarray(values)
    scattered = np.full((*mask.shape, *array.shape[1:]), 0 if array.dtype.kind in "ib" else np.nan, array.dtype)
    scattered[mask] = array
    return scattered


MISSING_CODE = -1
"""Missing value of discrete variables (codes, booleans), which are int32; quantities have NaN instead."""
_BY_KEY = {variable.key: variable for variable in CATALOGUE}


def catalogue_variable(key: str) -> Variable:
    """Return the variable of `anser.variables.CATALOGUE` with a key; raises KeyError for an unknown key."""
    return _BY_KEY[key]


def convert_series(key: str, values: np.ndarray) -> np.ndarray:
    """Convert values of the variable `key` from a history (SI, rad) to dataset units; discrete values to int32."""
    variable = catalogue_variable(key)
    return to_dataset_units(variable, values) if is_quantity(variable) else values.astype(np.int32)


def missing_series(key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of missing values of the variable `key`: NaN, or `MISSING_CODE` if discrete."""
    return (
        np.full(shape, np.nan) if is_quantity(catalogue_variable(key)) else np.full(shape, MISSING_CODE, dtype=np.int32)
    )


def is_quantity(variable: Variable) -> bool:
    """Whether the variable is a physical quantity, not a code or a boolean."""
    return variable.dtype == "float64"
