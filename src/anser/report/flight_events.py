"""What happened when: phases, renewals of the plan, limits touched; from the discrete variables of a record."""

from typing import Any

import numpy as np
import xarray as xr

RENEWALS = (
    "fitted to where the goal is now",
    "corrected",
    "planned anew",
    "last good plan kept",
    "kept until the goal is known better",
    "bent as far as the limits allow",
)
"""What a renewal did, in the order of the numbers in `events_of`."""

LIMITED = {
    "speed": "speed",
    "thrust": "thrust",
    "lift": "lift",
    "bank": "bank or its rate",
    "rates": "body rates",
    "surfaces": "surfaces",
}
"""Commands that the autopilot can hold at a limit, `speed_limited` and so on, in words."""

_FITTED, _CORRECTED, _ANEW, _KEPT = range(4)


def events_of(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Events of each aircraft.

    Returns
    -------
    list of dict
        One for each aircraft: `phases` and `failed`, [name or code, from, to] each; `renewals`, [time, what] each,
        `what` an index into `RENEWALS`: the instants at which the plan in force changed; `limited`, [index into
        `LIMITED`, from, to] each; `outside`, [from, to] each: outside the aerodynamic tables. Times in s.
    """
    time = dataset["time"].values
    return [_of_one(dataset.isel(aircraft=k), time) for k in range(dataset.sizes["aircraft"])]


def _of_one(one: xr.Dataset, time: np.ndarray) -> dict[str, Any]:
    names = str(one["phase"].attrs.get("flag_meanings", "approach frozen hold")).split()
    phases = [
        [names[code] if code < len(names) else str(code), *span] for code, *span in _stretches(one["phase"], time)
    ]
    limited = [
        [k, *span] for k, what in enumerate(LIMITED) for held, *span in _stretches(one[f"{what}_limited"], time) if held
    ]
    return {
        "phases": phases,
        "renewals": _renewals(one, time),
        "limited": limited,
        "outside": [span for out, *span in _stretches(one["outside_tables"], time) if out],
        "failed": [[code, *span] for code, *span in _stretches(one["status"], time) if code],
    }


def _renewals(one: xr.Dataset, time: np.ndarray) -> list[list[float]]:
    how, arrival = one["renewal"].values.astype(int), one["arrival_time_s"].values
    shape = np.stack([one["planned_length_m"].values, np.nan_to_num(one["lateral_bend_m"].values)])
    new_way = np.diff(how) != 0
    new_shape = np.any(np.diff(shape, axis=1) != 0, axis=0)
    new_time = np.diff(arrival) != 0
    at = np.flatnonzero((new_way | new_shape | new_time) & np.isfinite(arrival[1:])) + 1
    # the published planner records no way; a new arrival time tells that it coordinated the fleet anew
    what = [_ANEW if how[k] == _FITTED and new_time[k - 1] else int(how[k]) for k in at]
    return [[round(float(time[k]), 4), code] for k, code in zip(at, what, strict=True)]


def _stretches(values: xr.DataArray, time: np.ndarray) -> list[list[Any]]:
    """Runs of equal values: [value, from, to] each; each lasts until the next begins."""
    codes = values.values.astype(int)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1])
    ends = [*starts[1:], codes.size - 1]
    return [
        [int(codes[start]), round(float(time[start]), 4), round(float(time[end]), 4)]
        for start, end in zip(starts, ends, strict=True)
    ]
