"""Controls and commands of a flight of one aircraft: tables of the samples from numbers, arrays, tables and signals."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from anser.parts.input_signals import InputSignal

_TIME = "time_s"


def sample_inputs(
    inputs: Mapping[str, Any] | Any,
    reference: Mapping[str, float],
    time_s: Float[np.ndarray, " sample"],
    *,
    increments: bool = False,
    subject: str = "controls",
) -> Float[np.ndarray, "sample input"]:
    """Return the values of all inputs at the samples, a column per input in the order of `reference`.

    Parameters
    ----------
    inputs
        By name: a number, an array with a value per sample, a pair (times in s, values; linear in between), or an
        `InputSignal`; or a whole table (path of a CSV file, DataFrame, Dataset) with a column `time_s` (a Dataset: the
        coordinate `time`) and a column per input. Inputs left out keep their reference.
    reference
        Values at the start, by name of the input, in the unit of the input.
    time_s
        Times of the samples.
    increments
        True: numbers, arrays and tables are increments to the reference, as signals always are.
    subject
        Name of the argument, for messages.

    Raises
    ------
    ValueError
        An input is unknown, or its values do not fit.
    """
    columns = inputs if _is_by_name(inputs) else read_table(inputs, subject)
    columns = {name if name in reference else name.removesuffix("_deg"): value for name, value in columns.items()}
    unknown = [name for name in columns if name not in reference]
    if unknown:
        raise ValueError(f"{subject}: arrived {unknown[0]!r}; expected inputs among {', '.join(reference)}")
    sampled = np.tile(np.array(list(reference.values()), dtype=float), (time_s.size, 1))
    for index, name in enumerate(reference):
        if name not in columns:
            continue
        value = columns[name]
        values = value(time_s) if isinstance(value, InputSignal) else _sample(value, time_s, f"{subject}[{name!r}]")
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{subject}[{name!r}]: arrived values that are not finite; expected numbers throughout")
        is_increment = increments or isinstance(value, InputSignal)
        sampled[:, index] = sampled[:, index] + values if is_increment else values
        low, high = float(np.min(sampled[:, index])), float(np.max(sampled[:, index]))
        if name == "throttle" and not -1e-9 <= low <= high <= 1.0 + 1e-9:
            raise ValueError(f"{subject}['throttle']: arrived {low:g} to {high:g}; expected 0 to 1 (not percent)")
    return sampled


def _sample(value: Any, time_s: np.ndarray, place: str) -> np.ndarray:
    if isinstance(value, tuple):
        if len(value) != 2:
            raise ValueError(f"{place}: arrived a tuple of {len(value)}; expected (times in s, values)")
        times, values = (np.asarray(part, dtype=float) for part in value)
        if times.ndim != 1 or times.shape != values.shape or times.size == 0 or np.any(np.diff(times) <= 0.0):
            rising = times.ndim == 1 and times.size > 0 and not np.any(np.diff(times) <= 0.0)
            arrived = f"{times.size} times and {values.size} values" if rising else "times that do not rise"
            raise ValueError(f"{place}: arrived {arrived}; expected rows of equal length, with rising times")
        return np.interp(time_s, times, values)
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


def read_table(table: Any, subject: str = "controls") -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Read inputs over time from a CSV file, a pandas DataFrame or an xarray Dataset: pairs (times, values) by name.

    The names may have a unit suffix: `elevator_deg` is the elevator.

    Raises
    ------
    ValueError
        The file cannot be read, or a column `time_s` is missing.
    """
    if isinstance(table, str | os.PathLike):
        import pandas as pd

        path = Path(table)
        try:
            table = pd.read_csv(path)
        except (OSError, ValueError) as error:
            raise ValueError(f"{subject}: {path} cannot be read as CSV: {error}") from None
    if hasattr(table, "data_vars"):
        times = np.asarray(table["time"].values, dtype=float)
        columns = {str(name): np.asarray(values.values) for name, values in table.data_vars.items()}
    elif hasattr(table, "columns"):
        columns = {str(name): np.asarray(table[name]) for name in table.columns}
        if _TIME not in columns:
            raise ValueError(f"{subject}: arrived a table with {', '.join(columns)}; expected a column {_TIME}")
        times = columns.pop(_TIME)
    else:
        raise ValueError(
            f"{subject}: arrived {type(table).__name__}; expected a mapping by input, the path of a CSV file, a "
            "DataFrame, a Dataset, or a function of time and state"
        )
    for name, values in {_TIME: times, **columns}.items():
        if values.dtype.kind not in "fiu":
            raise ValueError(f"{subject}: arrived text in the column {name.strip()!r}; expected numbers in every row")
    return {name.strip(): (times, values) for name, values in columns.items()}


def _is_by_name(inputs: Any) -> bool:
    """Whether inputs are a mapping by name; a Dataset is a mapping too, but a table here."""
    return isinstance(inputs, Mapping) and not hasattr(inputs, "data_vars")


def check_function(controls: Any) -> Callable[..., Any] | None:
    """Return the controls if they are a function of time and state, or None."""
    return controls if callable(controls) and not isinstance(controls, InputSignal | Mapping) else None


def describe_inputs(inputs: Any) -> str:
    """Describe controls or commands for the provenance of a dataset."""
    if not _is_by_name(inputs):
        return getattr(inputs, "__qualname__", str(inputs) if isinstance(inputs, str | os.PathLike) else "table")
    texts = []
    for name, value in inputs.items():
        if isinstance(value, InputSignal):
            text = value.description
        elif isinstance(value, int | float):
            text = f"{value:g}"
        else:
            text = "values over time"
        texts.append(f"{name}: {text}")
    return "; ".join(texts)


def sample_times(duration_s: float, step_s: float) -> Float[np.ndarray, " sample"]:
    """Return the times of the samples of a flight, from 0 to `duration_s`.

    Raises
    ------
    ValueError
        Duration or step is not positive, or the flight has more than ten million samples.
    """
    for name, value in (("duration_s", duration_s), ("step_s", step_s)):
        if not isinstance(value, int | float | np.number) or not 0.0 < value < np.inf:
            raise ValueError(f"{name}: arrived {value!r}; expected a positive number of seconds")
    count = round(duration_s / step_s)
    if not 1 <= count <= _SAMPLES_MAX:
        raise ValueError(
            f"duration_s: arrived {duration_s:g} s with a step of {step_s:g} s; expected 1 to {_SAMPLES_MAX:,} steps"
        )
    return np.arange(count + 1) * step_s


_SAMPLES_MAX = 10_000_000
