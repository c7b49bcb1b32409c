"""Controls and commands of a flight of one aircraft, sampled from numbers, arrays, tables and input signals."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from anser.analysis.trim_points import require_seconds, require_step
from anser.parts.input_signals import InputSignal


def sample_inputs(
    inputs: Mapping[str, Any] | Any,
    reference: Mapping[str, float],
    time_s: Float[np.ndarray, " sample"],
    *,
    increments: bool = False,
    subject: str = "controls",
) -> Float[np.ndarray, "sample input"]:
    """Return the values of all inputs at the samples, a column per input in the order of `reference`.

    Raises ValueError, with the name of the argument (`subject`), for an unknown input or values that do not fit.

    Parameters
    ----------
    inputs
        Names of inputs may end with `_deg`; absent inputs keep their reference.

        - Mapping by name: a number, an array with a value per sample, a pair (times in s, values), or an input signal.
        - Table (CSV file, DataFrame, Dataset) with a column `time_s` (a Dataset: the coordinate `time`) and a column
          per input.

        Values over time are interpolated linearly, and constant beyond their times. Courses are interpolated along
        the shorter turn: from 170 to -170 deg through 180 deg.
    reference
        Values at the start, by name of the input, in the unit of the input; they define the order of the columns.
    time_s
        Times of the samples, s.
    increments
        True: numbers, arrays and tables are increments to the reference. Input signals are increments in any case.
    """
    is_by_name = _is_by_name(inputs)
    subject = f"{subject}, {inputs}" if isinstance(inputs, str | os.PathLike) else subject
    columns: Any = inputs if is_by_name else _read_table(inputs, subject)
    sampled = np.tile(np.array(list(reference.values()), dtype=float), (time_s.size, 1))
    given: dict[str, str] = {}
    for key, value in columns.items():
        name = key if key in reference else key.removesuffix("_deg")
        if given.setdefault(name, key) != key:
            raise ValueError(f"{subject}: arrived {given[name]!r} and {key!r}; expected each input once")
        if name not in reference:
            raise ValueError(f"{subject}: arrived {key!r}; expected inputs among {', '.join(reference)}")
        column = sampled[:, list(reference).index(name)]
        place = f"{subject}[{name!r}]" if is_by_name else f"{subject}, column {key!r}"
        if isinstance(value, InputSignal):
            value.require_sampling(float(time_s[1] - time_s[0]), place)
        is_course = name == "course_deg" and not increments
        values = value(time_s) if isinstance(value, InputSignal) else _sample(value, time_s, place, is_course)
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{place}: arrived values that are not finite; expected numbers throughout")
        column[:] = column + values if increments or isinstance(value, InputSignal) else values
        low, high = float(np.min(column)), float(np.max(column))
        if name == "throttle" and not -1e-9 <= low <= high <= 1.0 + 1e-9:
            raise ValueError(f"{place}: arrived {low:g} to {high:g}; expected 0 to 1 (not percent)")
    return sampled


def _sample(value: Any, time_s: np.ndarray, place: str, is_course: bool) -> np.ndarray:
    if isinstance(value, tuple):
        if len(value) != 2:
            raise ValueError(f"{place}: arrived a tuple of {len(value)}; expected (times in s, values)")
        times, values = (np.asarray(part, dtype=float) for part in value)
        is_rising = times.ndim == 1 and times.size > 0 and bool(np.all(np.diff(times) > 0.0))
        if not is_rising or times.shape != values.shape:
            arrived = f"{times.size} times and {values.size} values" if is_rising else "times that do not rise"
            raise ValueError(f"{place}: arrived {arrived}; expected rows of equal length, with rising times")
        return np.interp(time_s, times, np.unwrap(values, period=360.0) if is_course else values)
    try:
        values = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        values = None
    if values is None or values.ndim > 1:
        expected = "a number, an array with a value per sample, (times, values), or a signal such as anser.doublet(1.0)"
        shown = f"an array of shape {values.shape}" if values is not None else f"{type(value).__name__} {value!r:.60}"
        raise ValueError(f"{place}: arrived {shown}; expected {expected}")
    if values.ndim == 1 and values.size != time_s.size:
        raise ValueError(
            f"{place}: arrived {values.size} values; expected one for each of the {time_s.size} samples from 0 to "
            f"{time_s[-1]:g} s, or a pair (times, values)"
        )
    return np.broadcast_to(values, time_s.shape)


def _read_table(table: Any, subject: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the columns of a CSV file, a DataFrame or a Dataset by name, each as a pair (times in s, values)."""
    import pandas as pd

    if isinstance(table, str | os.PathLike):
        try:
            table = pd.read_csv(table)
        except (OSError, ValueError) as error:
            raise ValueError(f"{subject} cannot be read as CSV: {error}") from None
    if hasattr(table, "data_vars"):
        columns = {"time_s": table["time"].values} | {str(name): v.values for name, v in table.data_vars.items()}
    elif hasattr(table, "columns"):
        columns = {str(name).strip(): np.asarray(table[name]) for name in table.columns}
    else:
        raise ValueError(
            f"{subject}: arrived {type(table).__name__}; expected a mapping by input, the path of a CSV file, a "
            "DataFrame, a Dataset, or a function of time and state"
        )
    if "time_s" not in columns:
        raise ValueError(f"{subject}: arrived a table with {', '.join(columns)}; expected a column time_s")
    if not columns["time_s"].size:
        raise ValueError(f"{subject}: arrived a table without rows; expected one row at least")
    for name, values in columns.items():
        is_number = np.isfinite(np.asarray(pd.to_numeric(np.ravel(values), errors="coerce"), dtype=float))
        if not np.all(is_number) or values.dtype.kind not in "fiu":
            row = int(np.argmin(is_number))
            arrived = f"{np.ravel(values)[row]} in the column {name!r}"
            raise ValueError(f"{subject}: arrived {arrived}, row {row + 1}; expected a finite number in every row")
    times = columns.pop("time_s")
    rises = np.diff(times) > 0.0
    if not np.all(rises):
        row = int(np.argmin(rises)) + 1
        arrived = f"time_s = {times[row]:g} in row {row + 1}, after {times[row - 1]:g}"
        raise ValueError(f"{subject}: arrived {arrived}; expected rising times")
    return {name: (times, values) for name, values in columns.items()}


def _is_by_name(inputs: Any) -> bool:
    """Return whether inputs are a mapping by name; a Dataset, also a mapping, is a table over time."""
    return isinstance(inputs, Mapping) and not hasattr(inputs, "data_vars")


def describe_inputs(inputs: Any) -> str:
    """Return a text on controls or commands for the attributes of a dataset, such as "elevator: -2; throttle: 0.3"."""
    if not _is_by_name(inputs):
        return getattr(inputs, "__qualname__", str(inputs) if isinstance(inputs, str | os.PathLike) else "table")

    def text(value: Any) -> str:
        if isinstance(value, InputSignal):
            return value.description
        return f"{value:g}" if isinstance(value, int | float) else "values over time"

    return "; ".join(f"{name}: {text(value)}" for name, value in inputs.items())


def sample_times(duration_s: float, step_s: float) -> Float[np.ndarray, " sample"]:
    """Return the times of the samples of a flight (s), from 0 to `duration_s` inclusive, `step_s` apart.

    Raises ValueError if the duration is not positive, the step is not within 0.001 to 0.05 s, the duration is no
    multiple of the step, or the flight has more than ten million steps.
    """
    require_seconds("duration_s", duration_s)
    require_step(step_s)
    count = round(duration_s / step_s)
    if not 1 <= count <= 10_000_000:
        raise ValueError(
            f"duration_s: arrived {duration_s:g} s with a step of {step_s:g} s; expected 1 to 10,000,000 steps"
        )
    if abs(count * step_s / duration_s - 1.0) > 1e-6:
        raise ValueError(f"duration_s: arrived {duration_s:g} s; expected a multiple of the step, {step_s:g} s")
    return np.arange(count + 1) * step_s
