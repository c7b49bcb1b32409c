"""Flight records for identification: a flight of this package or a user's recording as time series in SI units.

The series have the keys of the catalogue of variables, such as `alpha`. A record has a constant sampling period:
irregular samples and short gaps are interpolated, longer gaps are refused with ValueError.
"""

import csv
import dataclasses
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float
from scipy.interpolate import make_interp_spline

from anser.config.toml_text import parse_toml, read_text
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.results.checksums import DamagedFileError
from anser.results.netcdf import read_netcdf
from anser.results.variable_labels import catalogue_attributes
from anser.units import DEG_RAD, FOOT_M, KNOT_M_S, LBF_N, PSF_PA
from anser.variables import MEASUREMENT_VARIABLES, STANDARD_SURFACES, Variable, catalogue

GAP_MAX_S = 0.2
"""Longest gap between samples that `flight_record` interpolates by default, s."""
_SAMPLES_MIN = 50
"""Least number of samples of a record."""
_JITTER = 1e-3
"""Greatest deviation of the sampling intervals from their mean, relative to the mean, that needs no resampling."""
_ANGLES_OVER_A_TURN = ("roll", "yaw", "ground_course", "course", "bank")
"""Angles that may jump by a full turn in a recording; a record has the angles without jumps."""

_UNITS: dict[str, tuple[str, float]] = {
    "rad": ("angle", 1.0),
    "deg": ("angle", DEG_RAD),
    "rad/s": ("rate", 1.0),
    "deg/s": ("rate", DEG_RAD),
    "m": ("length", 1.0),
    "ft": ("length", FOOT_M),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "m/s": ("speed", 1.0),
    "ft/s": ("speed", FOOT_M),
    "kt": ("speed", KNOT_M_S),
    "km/h": ("speed", 1.0 / 3.6),
    "m/s2": ("acceleration", 1.0),
    "g": ("acceleration", STANDARD_GRAVITY_M_S2),
    "ft/s2": ("acceleration", FOOT_M),
    "Pa": ("pressure", 1.0),
    "hPa": ("pressure", 100.0),
    "psf": ("pressure", PSF_PA),
    "N": ("force", 1.0),
    "lbf": ("force", LBF_N),
    "1": ("number", 1.0),
    "percent": ("number", 0.01),
}
"""Accepted units of a recording's columns: physical quantity, and factor that converts to SI units or radians."""
_QUANTITIES = {
    "degree": "angle",
    "degree s-1": "rate",
    "m": "length",
    "s": "time",
    "m s-1": "speed",
    "m s-2": "acceleration",
    "Pa": "pressure",
    "N": "force",
    "1": "number",
    "percent": "number",
}
"""Physical quantity of each unit that the catalogue of variables uses."""


@dataclasses.dataclass(frozen=True, repr=False)
class FlightRecord:
    """Time series of a flight, called channels, at a constant sampling period.

    `time_s` are the times of the samples, s. `channels` has the recorded series by key of the catalogue, such as
    `alpha`, in SI units and radians; angles have no jumps by a full turn. `surfaces` are the names of the control
    surfaces. `notes` are sentences on changes to the recording (interpolation, alignment). `attributes` belong to the
    original dataset.
    """

    time_s: Float[np.ndarray, " sample"]
    channels: Mapping[str, Float[np.ndarray, " sample"]]
    surfaces: tuple[str, ...] = STANDARD_SURFACES
    notes: tuple[str, ...] = ()
    attributes: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __repr__(self) -> str:
        variables = _variables(self.surfaces)
        names = ", ".join(variables[key].name for key in self.channels)
        head = (
            f"record of {self.time_s.size} samples, {self.time_s[0]:g} to {self.time_s[-1]:g} s, {1 / self.step_s:g} Hz"
        )
        return "\n".join([head, f"  {names}", *(f"  {note}" for note in self.notes)])

    @property
    def step_s(self) -> float:
        """Sampling period, s."""
        return float(self.time_s[-1] - self.time_s[0]) / (self.time_s.size - 1)

    def __contains__(self, key: str) -> bool:
        return key in self.channels

    def __getitem__(self, key: str) -> Float[np.ndarray, " sample"]:
        """Return a channel by its key, in SI units or radians; raises ValueError if the record lacks the channel."""
        if key not in self.channels:
            variables = _variables(self.surfaces)
            present = ", ".join(variables[channel].name for channel in self.channels)
            name = variables[key].name if key in variables else key
            raise ValueError(f"record: arrived without {name}; expected it beside {present}")
        return self.channels[key]

    def stack(self, *keys: str) -> Float[np.ndarray, "channel sample"]:
        """Return channels, by key, as rows of one array; raises ValueError if the record lacks one of the channels."""
        return np.stack([self[key] for key in keys])

    def window(self, start_s: float, end_s: float) -> "FlightRecord":
        """Return the record from `start_s` to `end_s` inclusive; raises ValueError if fewer than 50 samples remain."""
        inside = (self.time_s >= start_s - 1e-9) & (self.time_s <= end_s + 1e-9)
        if np.count_nonzero(inside) < _SAMPLES_MIN:
            raise ValueError(
                f"window: arrived {start_s:g} to {end_s:g} s; expected at least {_SAMPLES_MIN} samples between "
                f"{self.time_s[0]:g} and {self.time_s[-1]:g} s"
            )
        channels = {key: values[inside] for key, values in self.channels.items()}
        return dataclasses.replace(self, time_s=self.time_s[inside], channels=channels)

    def with_channels(self, notes: Sequence[str] = (), **channels: Float[np.ndarray, " sample"]) -> "FlightRecord":
        """Return a copy with channels (by key, SI units and radians) added or replaced, and with notes appended."""
        return dataclasses.replace(self, channels={**self.channels, **channels}, notes=(*self.notes, *notes))

    def with_noise(self, sigma: Mapping[str, float], seed: int = 0) -> "FlightRecord":
        """Return the record with independent Gaussian white noise added to channels, to simulate sensors.

        `sigma` holds standard deviations by variable of a dataset, in the unit of the name: `{"alpha_deg": 0.1}`.
        Raises ValueError if a name is no variable of the catalogue, or the record lacks the channel.
        """
        variables = {variable.name: variable for variable in _variables(self.surfaces).values()}
        random, noisy = np.random.default_rng(seed), {}
        for name, deviation in sigma.items():
            if name not in variables:
                raise ValueError(f"sigma: arrived {name!r}; expected variables of the record, such as 'alpha_deg'")
            variable = variables[name]
            noise = random.standard_normal(self.time_s.size) * deviation / variable.factor
            noisy[variable.key] = self[variable.key] + noise
        return self.with_channels(**noisy)

    @property
    def dataset(self) -> xr.Dataset:
        """The channels as a dataset over `time` (s), with the catalogue's names and units, such as `alpha_deg`."""
        variables = _variables(self.surfaces)
        data = {
            variables[key].name: ("time", values * variables[key].factor, catalogue_attributes(variables[key]))
            for key, values in self.channels.items()
        }
        time = ("time", self.time_s, {"units": "s", "long_name": "Time", "symbol": "t"})
        attributes = {**self.attributes, "surfaces": " ".join(self.surfaces), "notes": "; ".join(self.notes)}
        return xr.Dataset(data, {"time": time}, attributes)


def flight_record(
    recording: Any,
    columns: Mapping[str, Any] | None = None,
    *,
    aircraft_name: str | None = None,
    surfaces: Sequence[str] | None = None,
    gap_max_s: float = GAP_MAX_S,
) -> FlightRecord:
    """Return the record of a flight of this package or of a user's recording, at a constant sampling period.

    Commands and surfaces are interpolated linearly, other channels by cubic splines. A `FlightRecord` is returned
    unchanged.

    Parameters
    ----------
    recording
        - xarray Dataset with variables of the catalogue over `time` (and `aircraft`), or object with a `dataset`
        - pandas DataFrame
        - path of a folder with `flight.nc`, of a NetCDF file or of a CSV file
    columns
        Map from names of the catalogue to columns of the recording: `{"time_s": "t", "alpha_deg": "AOA",
        "pitch_rate_deg_s": {"column": "Q", "unit": "rad/s"}}`. If `unit` is absent, the values have the unit in the
        name. A `factor` multiplies the values: -1 for an opposite sign. Columns with names of the catalogue need no
        entry.
    aircraft_name
        Name of the aircraft to take from a dataset; required if the dataset contains several.
    surfaces
        Names of the control surfaces; None: the names in the dataset's attributes or, if absent, the standard surfaces.
    gap_max_s
        Longest gap that is interpolated, s: interval between samples, or missing values (NaN) in a channel. An interval
        up to 1.5 times the median interval is interpolated even if it is longer than `gap_max_s`.

    Raises
    ------
    ValueError
        If the recording cannot be read, has no times that rise, has fewer than 50 samples or no variable of the
        catalogue, a gap is too long, or an entry of `columns` is not valid.
    """
    if isinstance(recording, FlightRecord):
        return recording
    table, attributes = _read(recording, aircraft_name)
    if isinstance(surfaces, str):
        surfaces = (surfaces,)
    elif surfaces is None:
        surfaces = str(attributes["surfaces"]).split() if "surfaces" in attributes else STANDARD_SURFACES
    variables = {variable.name: variable for variable in _variables(surfaces).values() if variable.dtype == "float64"}
    time_s, raw = _select(table, columns or {}, variables)
    _check_times(time_s)
    grid, notes = _regular_grid(time_s, gap_max_s)
    channels = {}
    for key, values in raw.items():
        if key in _ANGLES_OVER_A_TURN:
            present = np.isfinite(values)
            values[present] = np.unwrap(values[present])
        is_step = key == "throttle" or any(key in (name, f"{name}_command") for name in surfaces)
        channels[key] = _resample(time_s, values, grid, gap_max_s, _name_of(key, variables), is_step, notes)
    return FlightRecord(grid, channels, tuple(surfaces), tuple(notes), attributes)


def read_columns(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the argument `columns` of `flight_record` from a TOML file.

    Raises ScenarioError if the file cannot be read, or is not valid TOML.
    """
    return parse_toml(read_text(path, "map"), os.fspath(path))


def _variables(surfaces: Sequence[str]) -> dict[str, Variable]:
    return {variable.key: variable for variable in (*catalogue(surfaces), *MEASUREMENT_VARIABLES)}


def _name_of(key: str, variables: Mapping[str, Variable]) -> str:
    return next(name for name, variable in variables.items() if variable.key == key)


def _read(recording: Any, aircraft_name: str | None) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns of a recording by name, in the units of the recording, and the recording's attributes."""
    if isinstance(recording, str | os.PathLike):
        recording = _read_file(Path(recording))
    if hasattr(recording, "dataset"):
        recording = recording.dataset
    if isinstance(recording, pd.DataFrame):
        names = [str(name).strip() for name in recording.columns]
        repeated = [name for k, name in enumerate(names) if name in names[:k]]
        if repeated:
            raise ValueError(f"recording: arrived the column {repeated[0]} twice; expected every column once")
        return {name: _numbers(name, recording.iloc[:, k]) for k, name in enumerate(names)}, {}
    if not isinstance(recording, xr.Dataset):
        raise ValueError(
            f"recording: arrived {type(recording).__name__}; expected a flight, a Dataset, a DataFrame, or the path of "
            "a folder with flight.nc, a NetCDF file or a CSV file"
        )
    if "time" not in recording.coords:
        raise ValueError("recording: arrived a dataset without the coordinate time; expected variables over time, s")
    if "aircraft" in recording.dims:
        names = [str(name) for name in recording["aircraft"].values]
        if (aircraft_name is None and len(names) > 1) or (aircraft_name is not None and aircraft_name not in names):
            arrived = f"{len(names)} aircraft" if aircraft_name is None else repr(aircraft_name)
            raise ValueError(f"aircraft_name: arrived {arrived}; expected one of {', '.join(names)}")
        recording = recording.isel(aircraft=0 if aircraft_name is None else names.index(aircraft_name))
    attributes = dict(recording.attrs)
    if "aircraft" in recording.coords:
        attributes["aircraft_name"] = name = str(recording["aircraft"].item())
        if aircraft_name not in (None, name):
            raise ValueError(
                f"aircraft_name: arrived {aircraft_name!r}; expected {name}, the aircraft of the recording"
            )
    columns = {str(n): np.asarray(v.values) for n, v in recording.data_vars.items() if v.dims == ("time",)}
    return {"time_s": np.asarray(recording["time"].values), **columns}, attributes


def _read_file(path: Path) -> pd.DataFrame | xr.Dataset:
    path = path / "flight.nc" if path.is_dir() else path
    if not path.is_file():
        raise ValueError(f"{path}: arrived no file; expected a folder with flight.nc, a NetCDF file or a CSV file")
    try:
        return read_netcdf(path) if path.suffix == ".nc" else _read_csv(path)
    except DamagedFileError as error:
        raise ValueError(str(error)) from None
    except (OSError, ValueError, csv.Error) as error:
        arrived = f"a file that cannot be read as CSV ({str(error)!r:.200})"
        raise ValueError(f"{path}: arrived {arrived}; expected columns") from None


def _read_csv(path: Path) -> pd.DataFrame:
    """Return the table of a CSV file; its columns of numbers may have empty cells.

    Raises ValueError if the file has no rows, repeats a column, or has rows with more cells than its heading.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        heads = [head.strip() for head in next(csv.reader(file), [])]
    twice = next((head for k, head in enumerate(heads) if head in heads[:k]), None)
    if twice is not None:
        raise ValueError(f"the column {twice:.60} twice")
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # surplus cells
        try:
            table = pd.read_csv(path, index_col=False)
        except pd.errors.ParserWarning:
            raise ValueError("a row with more cells than the heading") from None
    if not len(table):
        raise ValueError("no row of numbers")
    return table


def _numbers(name: str, column: Any) -> np.ndarray:
    if column.dtype.kind not in "fiub":
        return np.asarray(column)
    return np.array(column, dtype=float)


def _select(
    table: Mapping[str, np.ndarray], columns: Mapping[str, Any], variables: Mapping[str, Variable]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return times (s) and channels (by key, SI units, radians) from the columns of `table`, without columns of NaN."""
    entries: dict[str, Any] = {name: name for name in table if name in variables or name == "time_s"}
    entries |= {name: columns[name] for name in columns}
    if "time_s" not in entries:
        raise ValueError(
            f"recording: arrived the columns {', '.join(table)}; expected a column time_s, or an entry time_s of the "
            "map"
        )
    converted = {}
    for name, entry in entries.items():
        if name != "time_s" and name not in variables:
            raise ValueError(
                f"map: arrived {name!r}; expected names of the catalogue with their unit, such as alpha_deg, and "
                f"surfaces among {', '.join(n for n in variables if n.endswith('_command_deg'))[:200]}".replace(
                    "_command_deg", "_deg"
                )
            )
        converted[name] = _convert(name, entry, table, variables.get(name))
    if len(converted) < 2:
        raise ValueError(
            f"recording: arrived the columns {', '.join(table)}; expected names of the catalogue, such as alpha_deg, "
            "or a map from these names to the columns"
        )
    times = converted.pop("time_s")
    return times, {variables[name].key: values for name, values in converted.items() if np.isfinite(values).any()}


def _convert(name: str, entry: Any, table: Mapping[str, np.ndarray], variable: Variable | None) -> np.ndarray:
    settings = {"column": entry} if isinstance(entry, str) else entry
    is_table = (
        isinstance(settings, Mapping) and "column" in settings and not set(settings) - {"column", "unit", "factor"}
    )
    if not is_table or not all(isinstance(settings.get(key, ""), str | None) for key in ("column", "unit")):
        raise ValueError(f"map, {name}: arrived {entry!r}; expected a column, or a table of column, unit and factor")
    column, unit = settings["column"], settings.get("unit")
    if column not in table:
        raise ValueError(f"map, {name}: arrived the column {column!r}; expected one of {', '.join(table)}")
    values, factor_given = table[column], settings.get("factor", 1.0)
    if not isinstance(factor_given, int | float | np.number) or not np.isfinite(factor_given):
        raise ValueError(f"map, {name}: arrived the factor {factor_given!r}; expected a finite number")
    if values.dtype.kind in "Mm":
        raise ValueError(
            f"recording: arrived dates or durations in the column {column!r}; expected numbers, for times seconds from "
            "any origin"
        )
    if values.dtype.kind not in "fiub":
        raise ValueError(f"recording: arrived text in the column {column!r}; expected numbers in every row")
    quantity = "time" if variable is None else _QUANTITIES[variable.unit]
    if unit is None:
        factor = 1.0 if variable is None else 1.0 / variable.factor
    elif unit in _UNITS and _UNITS[unit][0] == quantity:
        factor = _UNITS[unit][1] * (100.0 if variable is not None and variable.unit == "percent" else 1.0)
    else:
        known = ", ".join(u for u, (q, _) in _UNITS.items() if q == quantity)
        raise ValueError(f"map, {name}: arrived the unit {unit!r}; expected one of {known}")
    return np.asarray(values, dtype=float) * factor * float(factor_given)


def _check_times(time_s: np.ndarray) -> None:
    if time_s.size < _SAMPLES_MIN:
        raise ValueError(f"recording: arrived {time_s.size} samples; expected at least {_SAMPLES_MIN}")
    if not np.all(np.isfinite(time_s)):
        raise ValueError(f"recording: arrived {np.sum(~np.isfinite(time_s))} times without a value; expected all times")
    backward = np.flatnonzero(np.diff(time_s) <= 0.0)
    if backward.size:
        k = int(backward[0])
        raise ValueError(
            f"recording: arrived {time_s[k + 1]:g} s after {time_s[k]:g} s (row {k + 2}); expected times that rise"
        )


def _regular_grid(time_s: np.ndarray, gap_max_s: float) -> tuple[np.ndarray, list[str]]:
    """Return equally spaced times (s), and notes on resampling; raises ValueError if a gap is too long."""
    intervals = np.diff(time_s)
    period = float(np.median(intervals))
    longest = int(np.argmax(intervals))
    if intervals[longest] > max(gap_max_s, 1.5 * period):
        raise ValueError(
            f"recording: arrived a gap of {intervals[longest]:.3g} s after {time_s[longest]:g} s; expected gaps of at "
            f"most {gap_max_s:g} s: the parts before and after it are records of their own"
        )
    mean = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    if np.max(np.abs(intervals - mean)) <= _JITTER * mean:
        return time_s[0] + mean * np.arange(time_s.size), []
    grid = time_s[0] + period * np.arange(int((time_s[-1] - time_s[0]) / period + 1e-6) + 1)
    gaps = int(np.count_nonzero(intervals > 1.5 * period))
    count = "a gap" if gaps == 1 else f"{gaps} gaps"
    shape = f"{count} of at most {intervals[longest]:.3g} s" if gaps else "irregular samples"
    return grid, [f"The recording has {shape}; it is resampled at {1.0 / period:g} Hz."]


def _resample(
    time_s: np.ndarray,
    values: np.ndarray,
    grid: np.ndarray,
    gap_max_s: float,
    name: str,
    is_step: bool,
    notes: list[str],
) -> np.ndarray:
    """Return the channel `name` at the times `grid` (s): linearly interpolated if `is_step`, by a cubic spline if not.

    A note on filled NaN values is appended to `notes`. Raises ValueError if NaN values last longer than `gap_max_s` or
    stand at an end.
    """
    present = np.isfinite(values)
    if not present.all():
        times = np.concatenate([[time_s[0]], time_s[present], [time_s[-1]]])
        longest = int(np.argmax(np.diff(times)))
        count, gap = int(np.sum(~present)), float(np.diff(times)[longest])
        if gap > gap_max_s or not (present[0] and present[-1]):
            raise ValueError(
                f"recording: arrived {name} with {count} missing values (NaN), over {gap:.3g} s from "
                f"{times[longest]:g} s; expected gaps of at most {gap_max_s:g} s, and values at both ends"
            )
        notes.append(f"{count} missing values of {name} are interpolated.")
    if present.all() and time_s.size == grid.size and np.max(np.abs(time_s - grid)) <= _JITTER * (grid[1] - grid[0]):
        return values
    if is_step:
        return np.interp(grid, time_s[present], values[present])
    return make_interp_spline(time_s[present], values[present], k=3)(grid)
