"""Numbers of a flight in little room: whole steps, second differences, byte planes, deflate, base64.

`assets/store.js` reads what this writes. Second differences of a smooth record are small, so their upper bytes are
nearly all zero: twenty aircraft with sixty variables, recorded at 10 Hz for 300 s, take less than a megabyte.
"""

import base64
import zlib
from collections.abc import Sequence

import numpy as np

_STEPS = {"m": 0.01, "s": 1e-4, "N": 1.0, "Pa": 1.0, "1": 1e-5}  # smallest difference kept, by unit
_OTHER_STEP = 1e-3
_SMALLEST = 1e-6  # a range below this is rounding
_MOST_STEPS = 2**29  # second differences are four times as large and must fit 32 bits with their sign


def quantization_step(values: np.ndarray, unit: str) -> float:
    """Smallest difference that is kept: of the unit, or of the range where that is small; coarser for huge values."""
    finite = values[np.isfinite(values)]
    step = _STEPS.get(unit, _OTHER_STEP)
    if not finite.size:
        return step
    spread = float(np.ptp(finite))
    if spread > _SMALLEST:
        step = min(step, 10.0 ** (np.floor(np.log10(spread)) - 5.0))
    while np.abs(finite).max() / step >= _MOST_STEPS:
        step *= 10.0
    return float(step)


def pack(columns: Sequence[tuple[np.ndarray, float]]) -> tuple[str, list[list[list[int]]]]:
    """Pack arrays one after the other.

    Parameters
    ----------
    columns
        Arrays of shape (time, aircraft), all of the same number of times, and the step of each.

    Returns
    -------
    str
        All of them, as text.
    list
        For each array its gaps, [aircraft, first, last] each: runs of values that are not finite. There the packed
        number is the one before.
    """
    planes, gaps = [], []
    for values, step in columns:
        missing = ~np.isfinite(values)
        gaps.append(_runs(missing))
        whole = np.round(_filled(values, missing) / step).astype(np.int64)
        twice = np.diff(whole, n=2, axis=0, prepend=np.zeros((2, whole.shape[1]), dtype=np.int64))
        zigzag = ((twice << 1) ^ (twice >> 63)).astype("<u4")
        planes.append(np.ascontiguousarray(zigzag.T).view(np.uint8).reshape(-1, 4).T.tobytes())
    return base64.b64encode(zlib.compress(b"".join(planes), 7)).decode("ascii"), gaps


def _filled(values: np.ndarray, missing: np.ndarray) -> np.ndarray:
    if not missing.any():
        return values
    last = np.where(missing, 0, np.arange(values.shape[0])[:, None])
    last = np.maximum.accumulate(last, axis=0)
    return np.nan_to_num(np.take_along_axis(values, last, axis=0), nan=0.0, posinf=0.0, neginf=0.0)


def _runs(flags: np.ndarray) -> list[list[int]]:
    found = []
    for column in np.flatnonzero(flags.any(axis=0)):
        edges = np.diff(flags[:, column].astype(np.int8), prepend=0, append=0)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        found += [[int(column), int(start), int(end)] for start, end in zip(starts, ends, strict=True)]
    return found
