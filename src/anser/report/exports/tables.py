"""CSV and Parquet: one row for each recorded time of each aircraft, units in the names of the columns."""

import importlib.util
import io
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from anser.results.extras import missing
from anser.results.spreadsheet_text import spreadsheet_text

PARQUET_MISSING = f"Parquet needs pyarrow; {missing('pyarrow', 'parquet')}"
_LABELS = ("units", "long_name", "frame", "symbol", "flag_meanings")


def has_parquet() -> bool:
    """Whether the library that writes Parquet is installed."""
    return importlib.util.find_spec("pyarrow") is not None


def to_csv(dataset: xr.Dataset) -> bytes:
    """Write a flight as CSV: `time_s`, `aircraft`, then every variable; numbers in full precision, truth as 0 or 1.

    Texts that a spreadsheet would take for formulas get an apostrophe in front.
    """
    columns = {spreadsheet_text(name): _csv_column(values) for name, values in _columns(dataset)}
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
    return parquet_of(dict(_columns(dataset)), labels, dataset.attrs)


def parquet_of(
    columns: Mapping[str, np.ndarray], labels: Mapping[str, Mapping[str, Any]], about: Mapping[Any, Any]
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
        name: {key: str(of[key]) for key in _LABELS if key in of} for name in columns for of in (labels.get(name, {}),)
    }
    fields = [pa.field(name, array.type, metadata=kept[name]) for name, array in arrays.items()]
    schema = pa.schema(fields, metadata={key: str(value) for key, value in about.items()})
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(list(arrays.values()), schema=schema), buffer, compression="zstd")
    return buffer.getvalue()


def _csv_column(values: np.ndarray) -> np.ndarray:
    match values.dtype.kind:
        case "b":
            return values.astype(np.int8)
        case "O" | "U" | "S":
            return np.array([spreadsheet_text(str(value)) for value in values.tolist()], dtype=object)
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
