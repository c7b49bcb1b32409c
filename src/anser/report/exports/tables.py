"""Export formats by name, and tables for other programs: a flight as CSV, Parquet or MATLAB, a campaign as Parquet."""

import importlib.util
import io
import json
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.io import savemat

from anser.files import write_file
from anser.report.exports.geographic import to_czml, to_kml
from anser.results.documents import escape_spreadsheet_text, install_hint
from anser.results.flight_rows import worst_of_fleet

PARQUET_MISSING = f"Parquet needs pyarrow; {install_hint('pyarrow', 'parquet')}"
_PARQUET_LABELS = ("units", "long_name", "frame", "symbol", "flag_meanings")


def has_parquet() -> bool:
    """Whether pyarrow, which writes Parquet, is installed."""
    return importlib.util.find_spec("pyarrow") is not None


def to_csv(dataset: xr.Dataset) -> bytes:
    """Return the content of a CSV file of a flight: columns `time_s`, `aircraft`, then every variable.

    Rows are sorted by aircraft, then by time. Numbers have full precision; booleans are 0 or 1. An apostrophe precedes
    text that a spreadsheet would read as a formula.
    """
    columns = {escape_spreadsheet_text(name): _csv_column(values) for name, values in _columns(dataset)}
    return pd.DataFrame(columns).to_csv(index=False, lineterminator="\n").encode()


def to_parquet(dataset: xr.Dataset) -> bytes:
    """Return the content of a Parquet file of a flight: the columns of `to_csv`, with units, labels and attributes.

    Raises ImportError if pyarrow is not installed.
    """
    dataset = _with_aircraft(dataset)
    labels = {"time_s": {"units": "s", "long_name": "Time"}, "aircraft": {"long_name": "Aircraft"}} | {
        str(name): variable.attrs for name, variable in dataset.items()
    }
    return encode_parquet(dict(_columns(dataset)), labels, dataset.attrs)


def encode_parquet(
    columns: Mapping[str, np.ndarray], labels: Mapping[str, Mapping[str, Any]], metadata: Mapping[Any, Any]
) -> bytes:
    """Return the content of a Parquet file of columns of equal length.

    `labels` has attributes by column; unit, long name, frame, symbol and flag meanings are stored. `metadata` has the
    attributes of the table. Raises ImportError if pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise ImportError(PARQUET_MISSING) from None
    arrays, fields = [], []
    for name, values in columns.items():
        array = pa.array(values).dictionary_encode() if name == "aircraft" else pa.array(values)
        attributes = labels.get(name, {})
        label = {key: str(attributes[key]) for key in _PARQUET_LABELS if key in attributes}
        arrays.append(array)
        fields.append(pa.field(name, array.type, metadata=label))
    schema = pa.schema(fields, metadata={key: str(value) for key, value in metadata.items()})
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), buffer, compression="zstd")
    return buffer.getvalue()


def _csv_column(values: np.ndarray) -> np.ndarray:
    match values.dtype.kind:
        case "b":
            return values.astype(np.int8)
        case "O" | "U" | "S":
            return np.array([escape_spreadsheet_text(str(value)) for value in values.tolist()], dtype=object)
        case _:
            return values


def _columns(dataset: xr.Dataset) -> list[tuple[str, np.ndarray]]:
    """Return name and values of each column of a flight's table; rows are sorted by aircraft, then by time."""
    dataset = _with_aircraft(dataset)
    times, aircraft = dataset.sizes["time"], dataset.sizes["aircraft"]
    names = dataset["aircraft"].values.astype(object)
    return [
        ("time_s", np.tile(dataset["time"].values, aircraft)),
        ("aircraft", np.repeat(names, times)),
        *((str(name), values.transpose("aircraft", "time").values.ravel()) for name, values in dataset.items()),
    ]


def _with_aircraft(dataset: xr.Dataset) -> xr.Dataset:
    """Return a flight's dataset with the dimensions time and aircraft only.

    A variable with a further dimension becomes one variable for each entry of the dimension. A variable that does not
    depend on time is left out if it has a further dimension.
    """
    for name, values in dataset.items():
        further = [str(dimension) for dimension in values.dims if dimension not in ("time", "aircraft")]
        if further:
            dataset = dataset.drop_vars([name])
            if "time" in values.dims:
                for index in np.ndindex(*(values.sizes[dimension] for dimension in further)):
                    entry = values.isel(dict(zip(further, index, strict=True)), drop=True)
                    labels = [_label(values, *place) for place in zip(further, index, strict=True)]
                    dataset[f"{name}_{'_'.join(labels)}"] = entry
    return dataset if "aircraft" in dataset.dims else dataset.expand_dims(aircraft=[dataset.attrs["aircraft"]])


def _label(values: xr.DataArray, dimension: str, index: int) -> str:
    """Return the coordinate at `index` of a dimension, or `index` if there is none; special characters become "_"."""
    text = str(values[dimension].values[index]) if dimension in values.coords else str(index)
    return "".join(character if character.isalnum() else "_" for character in text)


_WORST = {"miss_m": "Greatest miss of its aircraft", "arrival_s": "Last arrival of its aircraft"}


def write_campaign_tables(
    dataset: xr.Dataset, estimates: Mapping[str, Any], influences: Mapping[str, Any], folder: Path
) -> tuple[Path, ...]:
    """Write the tables of a campaign into a folder and return the paths; existing files are replaced.

    - `flights.parquet`: inputs and results of each flight, with greatest miss and last arrival (see `worst_of_fleet`)
    - `aircraft.parquet`: results of each aircraft in each flight
    - `answers.parquet`: quantiles and success probability, with confidence intervals, from `estimates`
    - `indices.parquet`: sensitivity indices, from `influences`

    Raises ImportError if pyarrow is not installed.
    """
    attributes = {key: str(value) for key, value in dataset.attrs.items()}
    labels = {str(name): variable.attrs for name, variable in dataset.variables.items()}
    labels |= {
        f"worst_{name}": {"units": dataset[name].attrs.get("units", ""), "long_name": long_name}
        for name, long_name in _WORST.items()
    }
    reasons = {"without": json.dumps(influences["not_computed"])}
    contents = {
        "flights": encode_parquet(_flights_table(dataset), labels, attributes),
        "aircraft": encode_parquet(_aircraft_table(dataset), labels, attributes),
        "answers": encode_parquet(_estimates_table(estimates), {}, attributes | _counts(estimates)),
        "indices": encode_parquet(_indices_table(influences), {}, attributes | reasons),
    }
    paths = {folder / f"{name}.parquet": content for name, content in contents.items()}
    for path, content in paths.items():
        write_file(path, content, overwrite=True)
    return tuple(paths)


def _flights_table(dataset: xr.Dataset) -> dict[str, np.ndarray]:
    columns = {
        str(name): variable.values for name, variable in dataset.variables.items() if variable.dims == ("flight",)
    }
    return columns | {f"worst_{name}": worst_of_fleet(dataset, name) for name in _WORST}


def _aircraft_table(dataset: xr.Dataset) -> dict[str, np.ndarray]:
    flights, aircraft = dataset.sizes["flight"], dataset.sizes["aircraft"]
    columns = {
        "flight": np.repeat(dataset["flight"].values, aircraft),
        "aircraft": np.tile(dataset["aircraft"].values.astype(object), flights),
    }
    return columns | {
        str(name): variable.values.reshape(-1)
        for name, variable in dataset.variables.items()
        if variable.dims == ("flight", "aircraft")
    }


def _estimates_table(estimates: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return the columns of `answers.parquet`: a row "met" with the success probability, then a row per quantile."""
    success = {"name": "met", "words": "every requirement met", "unit": "1", "share": None, "upper": None}
    records = [
        success | {"value": estimates["probability"], "low": estimates["low"], "high": estimates["high"]},
        *estimates["quantiles"],
    ]
    return {key: _column([record[key] for record in records]) for key in (*success, "value", "low", "high")}


def _counts(estimates: Mapping[str, Any]) -> dict[str, str]:
    keys = ("flights", "flown", "met", "independent", "confidence")
    return {key: str(estimates[key]) for key in keys} | {"causes": json.dumps(estimates["causes"])}


def _indices_table(influences: Mapping[str, Any]) -> dict[str, np.ndarray]:
    keys = ("output", "path", "measure", "value", "low", "high")
    return {key: _column([record[key] for record in influences["entries"]], texts=key in keys[:3]) for key in keys}


def _column(values: list[Any], *, texts: bool = False) -> np.ndarray:
    """Return a column of objects if `texts` is True or a value is a text or boolean, else of floats (NaN for None)."""
    if texts or any(isinstance(value, str | bool) for value in values):
        return np.array(values, dtype=object)
    return np.array([np.nan if value is None else value for value in values], dtype=float)


_MATLAB_NAME_MAX = 63
_MATLAB_LABELS = ("units", "long_name", "frame")


def to_mat(dataset: xr.Dataset) -> bytes:
    """Return the content of a MATLAB 5 file of a flight, readable by MATLAB and Octave.

    - `time_s`: column; `aircraft`: cell array of names
    - each variable: matrix with a row for each time and a column for each aircraft
    - `units`, `long_name`, `frame`: structures with a field for each variable; `attributes`: structure

    Raises ValueError if the name of a variable or attribute is not a MATLAB name.
    """
    dataset = _with_aircraft(dataset)
    matrices = {"time_s": dataset["time"].values[:, None]} | {
        str(name): values.transpose("time", "aircraft").values for name, values in dataset.items()
    }
    names = np.empty((dataset.sizes["aircraft"], 1), dtype=object)
    names[:, 0] = [str(name) for name in dataset["aircraft"].values]
    structures = {
        label: {"time_s": str(dataset["time"].attrs.get(label, ""))}
        | {str(name): str(values.attrs.get(label, "")) for name, values in dataset.items()}
        for label in _MATLAB_LABELS
    } | {"attributes": {str(key): value for key, value in dataset.attrs.items()}}
    for name in (*matrices, *structures, *structures["attributes"]):
        if not (name.isascii() and name.isidentifier() and name[0].isalpha() and len(name) <= _MATLAB_NAME_MAX):
            raise ValueError(f"MATLAB cannot hold the name {name!r}: letters, digits and underscores, 63 at most")
    buffer = io.BytesIO()
    savemat(buffer, matrices | {"aircraft": names} | structures, long_field_names=True, do_compression=True)
    return buffer.getvalue()


TABLES = "csv", "parquet", "mat"
"""Names of the formats that are made from the dataset of a flight alone, without its summary."""
FORMATS: dict[str, Callable[[xr.Dataset, Mapping[str, Any], datetime], bytes]] = {
    "czml": to_czml,
    "kml": to_kml,
    "csv": lambda dataset, summary, start: to_csv(dataset),
    "parquet": lambda dataset, summary, start: to_parquet(dataset),
    "mat": lambda dataset, summary, start: to_mat(dataset),
}
"""Functions that return a file's content, by format (also the suffix), from dataset, summary and start of a flight."""


def thin_record(dataset: xr.Dataset, period_s: float) -> xr.Dataset:
    """Return a flight at the recorded times nearest to a grid of `period_s` seconds, and at the last recorded time."""
    time = dataset["time"].values
    if period_s <= np.min(np.diff(time), initial=np.inf):
        return dataset
    grid = time[0] + period_s * np.arange(int((time[-1] - time[0]) / period_s) + 1)
    nearest = dataset.indexes["time"].get_indexer(grid, method="nearest")
    return dataset.isel(time=sorted({*map(int, nearest), time.size - 1}))
