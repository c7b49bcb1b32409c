"""Compression of a flight's numbers to a text for the report page.

Steps: quantization, second differences, separation of the bytes by significance, deflate, base64. `assets/store.js`
decodes the text in the browser. Second differences of a smooth record are small, so that the upper bytes are nearly
all zero: twenty aircraft with sixty variables, recorded at 10 Hz for 300 s, take less than a megabyte.
"""

import base64
import zlib
from collections.abc import Sequence

import numpy as np

_STEP_BY_UNIT = {"m": 0.01, "s": 1e-4, "N": 1.0, "Pa": 1.0, "1": 1e-5}  # resolution by unit
_DEFAULT_STEP = 1e-3
_SPREAD_MIN = 1e-6  # a smaller spread is rounding error
_STEPS_MAX = 2**29  # second differences are four times as large and must fit 32 bits with their sign


def quantization_step(values: np.ndarray, unit: str) -> float:
    """Return the quantization step for values in a unit: finer for values of small spread, coarser for huge values."""
    finite = values[np.isfinite(values)]
    step = _STEP_BY_UNIT.get(unit, _DEFAULT_STEP)
    if not finite.size:
        return step
    spread = float(np.ptp(finite))
    if spread > _SPREAD_MIN:
        step = min(step, 10.0 ** (np.floor(np.log10(spread)) - 5.0))
    while np.abs(finite).max() / step >= _STEPS_MAX:
        step *= 10.0
    return float(step)


def pack(columns: Sequence[tuple[np.ndarray, float]]) -> tuple[str, list[list[list[int]]]]:
    """Compress arrays (time, aircraft) with their quantization steps into one text for the report page.

    Also returns the gaps of each array, entries [aircraft, first index, last index]: runs of values that are not
    finite. The packed text repeats the preceding value in a gap.
    """
    planes, gaps = [], []
    for values, step in columns:
        missing = ~np.isfinite(values)
        gaps.append(_runs_of_true(missing))
        quantized = np.round(_fill_gaps(values, missing) / step).astype(np.int64)
        second_differences = np.diff(quantized, n=2, axis=0, prepend=np.zeros((2, quantized.shape[1]), dtype=np.int64))
        zigzag = ((second_differences << 1) ^ (second_differences >> 63)).astype("<u4")
        planes.append(np.ascontiguousarray(zigzag.T).view(np.uint8).reshape(-1, 4).T.tobytes())
    return base64.b64encode(zlib.compress(b"".join(planes), 7)).decode("ascii"), gaps


def _fill_gaps(values: np.ndarray, missing: np.ndarray) -> np.ndarray:
    if not missing.any():
        return values
    source_index = np.where(missing, 0, np.arange(values.shape[0])[:, None])
    source_index = np.maximum.accumulate(source_index, axis=0)
    return np.nan_to_num(np.take_along_axis(values, source_index, axis=0), nan=0.0, posinf=0.0, neginf=0.0)


def _runs_of_true(flags: np.ndarray) -> list[list[int]]:
    runs = []
    for column in np.flatnonzero(flags.any(axis=0)):
        edges = np.diff(flags[:, column].astype(np.int8), prepend=0, append=0)
        starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        runs += [[int(column), int(start), int(stop)] for start, stop in zip(starts, stops, strict=True)]
    return runs
