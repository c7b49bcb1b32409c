"""From the flights of a sweep to a labelled dataset over what was swept."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.results.flight_columns import OF_FLEET, flight_columns
from anser.results.flight_row import FlightRow
from anser.results.provenance import version_attributes
from anser.results.variable_labels import attributes_of


def sweep_dataset(
    swept: Mapping[str, Sequence[object]],
    aircraft: Sequence[str],
    rows: Sequence[FlightRow],
    attributes: Mapping[str, str | int],
) -> xr.Dataset:
    """Label the flights of a sweep.

    Parameters
    ----------
    swept
        By path, the values put there, in the order in which they vary: the last fastest.
    aircraft
        Names.
    rows
        What came of each flight, in that order.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        One dimension for each path, with its values as coordinate, and `aircraft`; NaN and "no flight" where a flight
        could not begin, with the reason.
    """
    shape = tuple(len(values) for values in swept.values())
    dimensions = tuple(swept)

    data: dict[str, Any] = {
        key: ((*dimensions, *of_one), values.reshape(*shape, *values.shape[1:]), about)
        for key, (of_one, values, about) in flight_columns(rows, len(aircraft)).items()
        if key not in OF_FLEET or not np.isnan(values).all()
    }
    coordinates: dict[str, Any] = {
        path: (path, _plain(values), attributes_of("", f"{path} of the scenario")) for path, values in swept.items()
    }
    coordinates["aircraft"] = ("aircraft", np.array(aircraft, dtype=np.str_), {"long_name": "Aircraft"})
    about = {**attributes, "swept": json.dumps(list(swept)), **version_attributes()}
    return xr.Dataset(data, coordinates, about)


def _plain(values: Sequence[object]) -> np.ndarray:
    """Numbers as numbers, truth values as such; all else in words, tables as JSON."""
    if all(isinstance(value, bool) for value in values):
        return np.array(values, dtype=bool)
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=float)
    return np.array([value if isinstance(value, str) else json.dumps(value) for value in values], dtype=np.str_)
