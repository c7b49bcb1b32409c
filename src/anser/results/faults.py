"""Faults that an adaptive autopilot detected in its aircraft: name, time and size, as data and as text."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.results.dataset import surface_names
from anser.sensing.fault_detection import CENTRE_OF_GRAVITY, ENGINE, ICE, ICE_DRAG, ICE_LIFT, NO_FAULT, SURFACE
from anser.variables import surface_label

_NAMES = {CENTRE_OF_GRAVITY: "centre of gravity", ICE: "ice", ENGINE: "engine"}
_UNITS = {
    ICE: f"of ice that adds {100 * ICE_DRAG:g} % drag and takes {100 * ICE_LIFT:g} % lift",
    ENGINE: "of the thrust lost",
}
_SURFACE_UNIT = "of the effectiveness lost"


@dataclass(frozen=True)
class Fault:
    """A fault of an aircraft that its adaptive autopilot detected."""

    name: str  #: Name of the fault: "centre of gravity", "ice", "engine", or the name of the faulty control surface.
    time_s: float  #: Time from the start of the flight at which the fault was confirmed, s.
    size: float  #: Last estimated size, not negative, as a fraction of the quantity in `unit`.
    unit: str  #: Quantity of which the size is a fraction, as text: "of the thrust lost", "of the mean chord, aft".

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the fault by name, as plain data for `summary.json`."""
        return asdict(self)


def fault_time(time_s: np.ndarray, codes: np.ndarray) -> float | None:
    """Return the first time (s) with a fault in `codes`, the variable `fault`; None if no code is a fault."""
    reported = np.flatnonzero(codes != NO_FAULT)
    return float(time_s[reported[0]]) if reported.size else None


def find_fault(time_s: np.ndarray, codes: np.ndarray, sizes: np.ndarray, surfaces: Sequence[str]) -> Fault | None:
    """Return the fault in the record of one aircraft; None if the autopilot reported no fault.

    `time_s` (s), `codes` and `sizes` (variables `fault` and `fault_size`) have the shape (time,). `surfaces` are the
    aircraft's control surfaces in the order of the airframe.
    """
    found_s = fault_time(time_s, codes)
    if found_s is None:
        return None
    code, size = int(codes[np.searchsorted(time_s, found_s)]), float(sizes[codes != NO_FAULT][-1])
    name = _NAMES[code] if code in _NAMES else surface_label(surfaces[code - SURFACE])
    if code == CENTRE_OF_GRAVITY:
        unit = f"of the mean chord, {'forward' if size < 0.0 else 'aft'}"
    else:
        unit = _UNITS.get(code, _SURFACE_UNIT)
    return Fault(name, round(found_s, 6), abs(size), unit)


def dataset_fault(dataset: xr.Dataset) -> Fault | None:
    """Return the fault in the dataset of one aircraft's flight; None if no fault was detected or recorded."""
    if "fault" not in dataset:
        return None
    time_s, codes, sizes = (dataset[name].values for name in ("time", "fault", "fault_size"))
    return find_fault(time_s, codes, sizes, surface_names(dataset))


def format_fault(fault: Mapping[str, Any]) -> str:
    """Return name, size and time of a fault as text; `fault` is a result of `Fault.as_dict`, as in a summary."""
    if fault["name"] == _NAMES[ICE]:
        drag, lift = 100.0 * ICE_DRAG * fault["size"], 100.0 * ICE_LIFT * fault["size"]
        size_text = f"drag up by {drag:.0f} %, lift down by {lift:.0f} %"
    else:
        size_text = f"{100.0 * fault['size']:.3g} % {fault['unit']}"
    return f"{fault['name']}, {size_text}, found at {fault['time_s']:.1f} s"


def fault_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return a line of text, with the aircraft's name, for each fault in a summary."""
    entries = [entry for entry in summary["aircraft"] if entry.get("fault")]
    return [f"{entry['name']}: fault: {format_fault(entry['fault'])}" for entry in entries]
