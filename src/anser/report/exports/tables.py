"""Tables for other programs: a flight as CSV, Parquet and MATLAB file, and a campaign as Parquet."""

import importlib.util
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.io import savemat

from anser.files import write_file
from anser.results.documents import escape_spreadsheet_text, install_hint
from anser.results.flight_rows import worst_of_fleet

PARQUET_MISSING = f"Parquet needs pyarrow; {install_hint('pyarrow', 'parquet')}"
_PARQUET_LABELS = ("units", "long_name", "frame", "symbol", "flag_meanings")


def has_parquet() -> bool:
    """Whether the library that writes Parquet is installed."""
    return importlib.util.find_spec("pyarrow") is not None


def to_csv(dataset: xr.Dataset) -> bytes:
    """Write a flight as CSV: `time_s`, `aircraft`, then every variable; numbers in full precision, truth as 0 or 1.

    Texts that a spreadsheet would take for formulas get an apostrophe in front.
    """
    columns = {escape_spreadsheet_text(name): _csv_column(values) for name, values in _columns(dataset)}
    return pd.DataFrame(columns).to_csv(index=False, lineterminator="\n").encode()


def to_parquet(dataset: xr.Dataset) -> bytes:
    """Write a flight as Parquet: the columns of the CSV, each with its unit and words, the flight's attributes.

    Raises
    ------
    ImportError
        Pyarrow is not installed.
    """
    labels = {"time_s": {"units": "s", "long_name": "Time"}, "aircraft": {"long_name": "Aircraft"}} | {
        str(name): of.attrs for name, of in dataset.items()
    }
    return encode_parquet(dict(_columns(dataset)), labels, dataset.attrs)


def encode_parquet(
    columns: Mapping[str, np.ndarray], labels: Mapping[str, Mapping[str, Any]], metadata: Mapping[Any, Any]
) -> bytes:
    """Write columns of equal length as Parquet.

    Parameters
    ----------
    columns
        By name; that of the aircraft is kept as a dictionary.
    labels
        Attributes of columns by name, of which unit and words are kept.
    about
        Attributes of the table.

    Raises
    ------
    ImportError
        Pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise ImportError(PARQUET_MISSING) from None
    arrays = {
        name: pa.array(values).dictionary_encode() if name == "aircraft" else pa.array(values)
        for name, values in columns.items()
    }
    kept = {
        name: {key: str(of[key]) for key in _PARQUET_LABELS if key in of}
        for name in columns
        for of in (labels.get(name, {}),)
    }
    fields = [pa.field(name, array.type, metadata=kept[name]) for name, array in arrays.items()]
    schema = pa.schema(fields, metadata={key: str(value) for key, value in metadata.items()})
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(list(arrays.values()), schema=schema), buffer, compression="zstd")
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
    """Columns of equal length, aircraft by aircraft, each in the order of time."""
    times, aircraft = dataset.sizes["time"], dataset.sizes["aircraft"]
    names = dataset["aircraft"].values.astype(object)
    return [
        ("time_s", np.tile(dataset["time"].values, aircraft)),
        ("aircraft", np.repeat(names, times)),
        *((str(name), values.transpose("aircraft", "time").values.ravel()) for name, values in dataset.items()),
    ]


_WORST = {"miss_m": "Greatest miss of its aircraft", "arrival_s": "Last arrival of its aircraft"}


def write_campaign_tables(
    dataset: xr.Dataset, estimates: Mapping[str, Any], influences: Mapping[str, Any], folder: Path
) -> tuple[Path, ...]:
    """Write the tables of a campaign, in place of former ones.

    `flights.parquet` has a row for each flight: the values applied, what came of it, the worst of its aircraft
    (infinite where one has none). `aircraft.parquet` has a row for each aircraft of each flight. `answers.parquet`
    holds the quantiles and the probability with their intervals, `indices.parquet` what the outputs depend on.

    Parameters
    ----------
    dataset
        From `anser.campaigns.CampaignStore.dataset`.
    answers, influences
        `as_dict` of them.
    folder
        To write into.

    Raises
    ------
    ImportError
        Pyarrow is not installed.
    """
    about = {key: str(value) for key, value in dataset.attrs.items()}
    contents = {
        "flights": encode_parquet(_flights(dataset), _labels(dataset) | _worst_labels(dataset), about),
        "aircraft": encode_parquet(_aircraft(dataset), _labels(dataset), about),
        "answers": encode_parquet(_answers(estimates), {}, about | _counts(estimates)),
        "indices": encode_parquet(_indices(influences), {}, about | {"without": json.dumps(influences["without"])}),
    }
    paths = {folder / f"{name}.parquet": content for name, content in contents.items()}
    for path, content in paths.items():
        write_file(path, content, overwrite=True)
    return tuple(paths)


def _labels(dataset: xr.Dataset) -> dict[str, Mapping[str, Any]]:
    return {str(name): of.attrs for name, of in dataset.variables.items()}


def _worst_labels(dataset: xr.Dataset) -> dict[str, Mapping[str, Any]]:
    return {
        f"worst_{name}": {"units": dataset[name].attrs.get("units", ""), "long_name": words}
        for name, words in _WORST.items()
    }


def _flights(dataset: xr.Dataset) -> dict[str, np.ndarray]:
    found = {str(name): of.values for name, of in dataset.variables.items() if of.dims == ("flight",)}
    return found | {f"worst_{name}": worst_of_fleet(dataset, name) for name in _WORST}


def _aircraft(dataset: xr.Dataset) -> dict[str, np.ndarray]:
    flights, aircraft = dataset.sizes["flight"], dataset.sizes["aircraft"]
    found = {
        "flight": np.repeat(dataset["flight"].values, aircraft),
        "aircraft": np.tile(dataset["aircraft"].values.astype(object), flights),
    }
    return found | {
        str(name): of.values.reshape(-1) for name, of in dataset.variables.items() if of.dims == ("flight", "aircraft")
    }


def _answers(estimates: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """A row for each quantile, and one for the probability (name "met", no share)."""
    first = {"name": "met", "words": "every requirement met", "unit": "1", "share": None, "upper": None}
    rows = [
        first | {"value": estimates["probability"], "low": estimates["low"], "high": estimates["high"]},
        *estimates["quantiles"],
    ]
    return {key: _column([row[key] for row in rows]) for key in (*first, "value", "low", "high")}


def _counts(estimates: Mapping[str, Any]) -> dict[str, str]:
    keys = ("flights", "flown", "met", "independent", "confidence")
    return {key: str(estimates[key]) for key in keys} | {"causes": json.dumps(estimates["causes"])}


def _indices(influences: Mapping[str, Any]) -> dict[str, np.ndarray]:
    keys = ("output", "path", "measure", "value", "low", "high")
    return {key: _column([row[key] for row in influences["found"]], texts=key in keys[:3]) for key in keys}


def _column(values: list[Any], *, texts: bool = False) -> np.ndarray:
    """Numbers, with NaN for none; texts and truth values as they are, with None for none."""
    if texts or any(isinstance(value, str | bool) for value in values):
        return np.array(values, dtype=object)
    return np.array([np.nan if value is None else value for value in values], dtype=float)


_LONGEST = 63  # characters of a name in MATLAB
_LABELS = ("units", "long_name", "frame")


def to_mat(dataset: xr.Dataset) -> bytes:
    """Write a flight as a MATLAB 5 file, which MATLAB and Octave load.

    It holds `time_s` (a column), `aircraft` (a cell array of names), every variable as a matrix with a row for each
    time and a column for each aircraft, and the structures `units`, `long_name`, `frame` (a field for each variable)
    and `attributes`.

    Raises
    ------
    ValueError
        A name is none that MATLAB can hold.
    """
    matrices = {"time_s": dataset["time"].values[:, None]} | {
        str(name): values.transpose("time", "aircraft").values for name, values in dataset.items()
    }
    names = np.empty((dataset.sizes["aircraft"], 1), dtype=object)
    names[:, 0] = [str(name) for name in dataset["aircraft"].values]
    structures = {
        label: {"time_s": str(dataset["time"].attrs.get(label, ""))}
        | {str(name): str(values.attrs.get(label, "")) for name, values in dataset.items()}
        for label in _LABELS
    } | {"attributes": {str(key): value for key, value in dataset.attrs.items()}}
    for name in (*matrices, *structures, *structures["attributes"]):
        if not (name.isascii() and name.isidentifier() and name[0].isalpha() and len(name) <= _LONGEST):
            raise ValueError(f"MATLAB cannot hold the name {name!r}: letters, digits and underscores, 63 at most")
    buffer = io.BytesIO()
    savemat(buffer, matrices | {"aircraft": names} | structures, long_field_names=True, do_compression=True)
    return buffer.getvalue()
