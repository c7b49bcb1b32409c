"""Spaces of observations and actions, and the tables of their entries with names, units and scales."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.shapes import Flag
from anser.variables import CATALOGUE, Variable


@dataclasses.dataclass(frozen=True)
class Entry:
    """Description and scale of one entry of an observation or an action."""

    name: str  #: Name with a unit suffix; for a variable of the catalogue the dataset name.
    unit: str  #: Unit of the quantity.
    centre: float  #: Value of the quantity at which the normalized entry is 0.
    half_range: float  #: Change of the quantity that changes the normalized entry from 0 to 1.
    meaning: str  #: Description of the quantity.

    def normalize(self, value: Any) -> Any:
        """Return the normalized entry of a value: (value - centre) / half_range."""
        return (value - self.centre) / self.half_range


_BY_NAME: dict[str, Variable] = {variable.name: variable for variable in CATALOGUE}


def catalogue_entry(
    variable: str | Variable, centre: float, half_range: float, kind: str = "", meaning: str = ""
) -> Entry:
    """Return the entry of a variable of the catalogue, with the variable's unit and description.

    `variable` is a dataset name ("alpha_deg") or a `Variable`; `centre` and `half_range` are in the variable's unit.
    `kind` extends the name: "_error" gives "alpha_error_deg". `meaning`, such as "Commanded", precedes the description.
    """
    v = _BY_NAME[variable] if isinstance(variable, str) else variable
    description = f"{meaning} {v.long_name[0].lower()}{v.long_name[1:]}" if meaning else v.long_name
    return Entry(f"{v.key}{kind}{v.name.removeprefix(v.key)}", v.unit, centre, half_range, description)


class Box:
    """Space of real vectors with entries from `low` to `high`, which may be infinite; the methods follow gymnax."""

    def __init__(self, low: float, high: float, shape: tuple[int, ...], dtype: Any = jnp.float32) -> None:
        self.low, self.high, self.shape, self.dtype = low, high, shape, dtype

    def __repr__(self) -> str:
        return f"Box({self.low:g}, {self.high:g}, {self.shape}, {np.dtype(self.dtype).name})"

    def sample(self, key: Array) -> Float[Array, "..."]:
        """Draw a random vector: uniform if both bounds are finite; standard normal if a bound is infinite."""
        if np.isfinite(self.low) and np.isfinite(self.high):
            return jax.random.uniform(key, self.shape, self.dtype, self.low, self.high)
        return jax.random.normal(key, self.shape, self.dtype)

    def contains(self, value: Any) -> Flag:
        """Whether a vector is finite and within the bounds."""
        array = jnp.asarray(value)
        return jnp.all(jnp.isfinite(array) & (array >= self.low) & (array <= self.high))
