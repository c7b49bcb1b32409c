"""Tables of a campaign as Parquet: its flights, their aircraft, its answers, what they depend on."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from anser.output_files import write_file
from anser.report.exports.tables import parquet_of
from anser.results.flight_columns import worst_of_fleet

_WORST = {"miss_m": "Greatest miss of its aircraft", "arrival_s": "Last arrival of its aircraft"}


def write_campaign_tables(
    dataset: xr.Dataset, answers: Mapping[str, Any], influences: Mapping[str, Any], folder: Path
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
        "flights": parquet_of(_flights(dataset), _labels(dataset) | _worst_labels(dataset), about),
        "aircraft": parquet_of(_aircraft(dataset), _labels(dataset), about),
        "answers": parquet_of(_answers(answers), {}, about | _counts(answers)),
        "indices": parquet_of(_indices(influences), {}, about | {"without": json.dumps(influences["without"])}),
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


def _answers(answers: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """A row for each quantile, and one for the probability (name "met", no share)."""
    first = {"name": "met", "words": "every requirement met", "unit": "1", "share": None, "upper": None}
    rows = [
        first | {"value": answers["probability"], "low": answers["low"], "high": answers["high"]},
        *answers["quantiles"],
    ]
    return {key: _column([row[key] for row in rows]) for key in (*first, "value", "low", "high")}


def _counts(answers: Mapping[str, Any]) -> dict[str, str]:
    keys = ("flights", "flown", "met", "independent", "confidence")
    return {key: str(answers[key]) for key in keys} | {"causes": json.dumps(answers["causes"])}


def _indices(influences: Mapping[str, Any]) -> dict[str, np.ndarray]:
    keys = ("output", "path", "measure", "value", "low", "high")
    return {key: _column([row[key] for row in influences["found"]], texts=key in keys[:3]) for key in keys}


def _column(values: list[Any], *, texts: bool = False) -> np.ndarray:
    """Numbers, with NaN for none; texts and truth values as they are, with None for none."""
    if texts or any(isinstance(value, str | bool) for value in values):
        return np.array(values, dtype=object)
    return np.array([np.nan if value is None else value for value in values], dtype=float)
