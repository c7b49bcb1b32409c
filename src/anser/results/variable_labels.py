"""How a variable of the catalogue stands in a dataset: its unit and its labels."""

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
    """Attributes of a variable in a dataset."""
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
