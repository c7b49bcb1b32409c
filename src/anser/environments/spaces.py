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
    """One entry of an observation or an action.

    Attributes
    ----------
    name
        Name with a unit suffix; that of the catalogue of variables where the quantity stands there.
    unit
        Unit of the quantity.
    centre, half_range
        Value of the quantity at 0 and its change from 0 to 1 in the normalized entry. None: they follow from the
        aircraft, as surfaces' stops do, and are stated by the environment's table.
    meaning
        Description.
    """

    name: str
    unit: str
    centre: float
    half_range: float
    meaning: str

    def normalize(self, value: Any) -> Any:
        """Return the normalized entry of a value of the quantity."""
        return (value - self.centre) / self.half_range


_BY_NAME: dict[str, Variable] = {variable.name: variable for variable in CATALOGUE}


def catalogue_entry(name: str, centre: float, half_range: float, variable: Variable | None = None) -> Entry:
    """Return the entry of a variable of the catalogue, with its unit and description."""
    described = _BY_NAME[name] if variable is None else variable
    return Entry(name, described.unit, centre, half_range, described.long_name)


class Box:
    """Box of real vectors, with the methods that gymnax expects of a space.

    Attributes
    ----------
    low, high
        Bounds of every entry; infinite without bounds.
    shape, dtype
        Shape and type of the elements.
    """

    def __init__(self, low: float, high: float, shape: tuple[int, ...], dtype: Any = jnp.float32) -> None:
        self.low, self.high, self.shape, self.dtype = low, high, shape, dtype

    def __repr__(self) -> str:
        return f"Box({self.low:g}, {self.high:g}, {self.shape}, {np.dtype(self.dtype).name})"

    def sample(self, key: Array) -> Float[Array, "..."]:
        """Draw a vector: uniform between finite bounds, standard normal without bounds."""
        if np.isfinite(self.low) and np.isfinite(self.high):
            return jax.random.uniform(key, self.shape, self.dtype, self.low, self.high)
        return jax.random.normal(key, self.shape, self.dtype)

    def contains(self, value: Any) -> Flag:
        """Whether a vector is finite and within the bounds."""
        array = jnp.asarray(value)
        return jnp.all(jnp.isfinite(array) & (array >= self.low) & (array <= self.high))
