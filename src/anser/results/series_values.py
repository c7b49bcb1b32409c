"""Values of variables over time, as a campaign keeps them: in the unit of a dataset, or missing."""

import numpy as np

from anser.results.variable_labels import converted
from anser.variables import CATALOGUE, Variable

NO_CODE = -1
"""In the place of a code or a truth value where there is none; of other variables it is NaN."""
_OF_KEY = {variable.key: variable for variable in CATALOGUE}


def variable_of(key: str) -> Variable:
    """The variable of a key of the catalogue."""
    return _OF_KEY[key]


def series_values(key: str, values: np.ndarray) -> np.ndarray:
    """Values of a history (SI, rad) in the unit of a dataset; codes and truth values as int32."""
    variable = variable_of(key)
    return converted(variable, values) if is_number(variable) else values.astype(np.int32)


def missing_series(key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Values of a variable that a flight has not, or of a flight that could not begin."""
    return np.full(shape, np.nan) if is_number(variable_of(key)) else np.full(shape, NO_CODE, dtype=np.int32)


def is_number(variable: Variable) -> bool:
    """Whether it is a quantity; else it is a code or a truth value."""
    return variable.dtype == "float64"
