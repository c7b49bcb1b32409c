"""Sensitivity of campaign outputs to inputs: Sobol indices for Saltelli sampling, otherwise rank correlations."""

import functools
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.campaigns.study import Study
from anser.results.flight_rows import applicable_quantities, worst_of_fleet
from anser.results.sampling_statistics import rank_correlation, sobol_indices

SOBOL, RANK = "Sobol indices", "rank correlation"
_CONSTANT = "it is the same in every flight"
_OUTPUTS = {
    "met": "every requirement met (1 or 0)",
    "miss_m": "greatest miss",
    "arrival_spread_s": "arrival spread",
}


@dataclass(frozen=True)
class Influence:
    """Sensitivity of one output of a campaign to one varied parameter, with a confidence interval."""

    output: str  #: Name of the output.
    path: str  #: Key path of the parameter.
    measure: str  #: "first" or "total" (Sobol indices), or "rank" (Spearman's rank correlation).
    value: float  #: Value of the measure.
    low: float  #: Lower bound of the confidence interval.
    high: float  #: Upper bound of the confidence interval.


@dataclass(frozen=True)
class Influences:
    """Sensitivities of the outputs of a campaign to the varied parameters."""

    kind: str  #: "Sobol indices" or "rank correlation".
    confidence: float  #: Confidence level of the intervals.
    flights: int  #: Number of flights used.
    outputs: dict[str, str]  #: Description of each output by name.
    entries: tuple[Influence, ...]  #: Computed sensitivities, one for each output, parameter and measure.
    not_computed: dict[str, str]  #: Reason why an output (by name) or parameter (by key path) has no sensitivity.

    def as_dict(self) -> dict[str, Any]:
        """Return the sensitivities as plain data for JSON."""
        return asdict(self)


def influences(
    # completed flights, from `CampaignStore.dataset`; for Saltelli sampling only complete blocks are used
    data: xr.Dataset,
    study: Study,
    varied: list[str],  # key paths of the varied parameters
) -> Influences:
    """Compute the sensitivity of each output of a campaign to each varied parameter.

    The output ``met`` is 1 for a successful flight and 0 for a failed flight. In rank correlations, a flight without an
    arrival counts as worst in every output. Sobol indices require a finite value in every flight.
    """
    confidence, not_computed = study.answers.confidence, dict[str, str]()
    if study.block > 1:
        kind, data = SOBOL, data.isel(flight=_whole_blocks(data["flight"].values, study.block))
        compute_entries = functools.partial(_sobol_entries, varied, confidence)
    else:
        kind, inputs = RANK, {path: ordered_values(data[path].values, study, path) for path in varied}
        for path, values in inputs.items():
            if values is None:
                not_computed[path] = "texts of a table have no order"
            elif np.unique(values).size < 2:
                not_computed[path] = _CONSTANT
        varying = {path: values for path, values in inputs.items() if values is not None and path not in not_computed}
        compute_entries = functools.partial(_rank_entries, varying, confidence)
    outputs = {"met": data["met"].values.astype(float)}
    outputs |= {name: worst_of_fleet(data, name) for name in applicable_quantities(_OUTPUTS, data) if name != "met"}
    outputs |= {output.name: worst_of_fleet(data, output.name, upper=output.is_upper) for output in study.output}
    entries: list[Influence] = []
    for name, values in outputs.items():
        if np.unique(values).size < 2:
            not_computed[name] = _CONSTANT
            continue
        try:
            entries += compute_entries(name, values)
        except ValueError as error:
            not_computed[name] = str(error)
    labels = {name: _OUTPUTS.get(name, name) for name in outputs}
    return Influences(kind, confidence, data.sizes["flight"], labels, tuple(entries), not_computed)


def _whole_blocks(numbers: np.ndarray, block: int) -> np.ndarray:
    """Return the indices into `numbers` of the flights in complete Saltelli blocks, ordered by flight number."""
    order = np.argsort(numbers)
    blocks, counts = np.unique(numbers // block, return_counts=True)
    return order[np.isin(numbers[order] // block, blocks[counts == block])]


def _sobol_entries(varied: list[str], confidence: float, name: str, outputs: np.ndarray) -> list[Influence]:
    """Compute first-order and total Sobol indices of the output `name` for each of the `varied` parameters.

    `outputs` are the values in the flights of complete Saltelli blocks, in order. Raises ValueError if a value is not
    finite.
    """
    lacking = int(np.sum(~np.isfinite(outputs)))
    if lacking:
        raise ValueError(
            f"{lacking} of {outputs.size} flights have no such number, and one in its place would be made up"
        )
    indices = sobol_indices(outputs, len(varied), confidence)
    measures = {
        "first": (indices.first, indices.first_half_width),
        "total": (indices.total, indices.total_half_width),
    }
    return [
        Influence(name, path, measure, float(values[k]), float(values[k] - halves[k]), float(values[k] + halves[k]))
        for k, path in enumerate(varied)
        for measure, (values, halves) in measures.items()
    ]


def _rank_entries(
    inputs: Mapping[str, np.ndarray], confidence: float, name: str, outputs: np.ndarray
) -> list[Influence]:
    return [
        Influence(name, path, "rank", *rank_correlation(values, outputs, confidence)) for path, values in inputs.items()
    ]


def ordered_values(values: np.ndarray, study: Study, path: str) -> np.ndarray | None:
    """Convert the values of a varied parameter to numbers; a text becomes its index in the study's list of values.

    Returns None if the texts come from a table and therefore have no order.
    """
    if values.dtype.kind in "fiub":
        return values.astype(float)
    positions: Mapping[Any, int] = {
        value: k for vary in study.vary if vary.path == path for k, value in enumerate(vary.values or ())
    }
    return np.array([float(positions[value]) for value in values.tolist()]) if positions else None
