"""What every recorded flight holds, whichever version wrote it."""

import numpy as np
import xarray as xr

_POSITION = "north_m", "east_m", "altitude_m"


def flight_problem(dataset: xr.Dataset) -> str | None:
    """What arrived instead of the times, names and positions of a flight, and what was expected; None if all are there.

    Positions are finite at all times: the state of an aircraft that crashes, or diverges, stays at its last one.
    """
    for name in ("time", "aircraft", *_POSITION):
        if name not in dataset.variables:
            return f"arrived without {name}; expected a flight, which has it"
        dimensions = ("time", "aircraft") if name in _POSITION else (name,)
        values = dataset[name]
        if values.dims != dimensions or 0 in values.shape:
            return f"arrived {name} over {dict(values.sizes)}; expected it over {' and '.join(dimensions)}"
        if name != "aircraft" and values.dtype.kind != "f":
            return f"arrived {name} as {values.dtype}; expected floating-point numbers"
        if name != "aircraft" and not np.isfinite(values.values).all():
            return f"arrived {name} with values that are not finite; expected finite ones at all times"
    if np.any(np.diff(dataset["time"].values) <= 0.0):
        return "arrived time that does not increase; expected increasing times"
    names = dataset["aircraft"].values.tolist()
    if len(set(names)) != len(names):
        return f"arrived aircraft {', '.join(map(str, names))}; expected each name once"
    return None
