"""Sensitivity of campaign outputs to inputs: Sobol indices for Saltelli sampling, otherwise rank correlations."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.campaigns.study import Study
from anser.results.flight_rows import applicable_quantities, worst_of_fleet
from anser.results.sampling_statistics import rank_correlation, sobol_indices

if TYPE_CHECKING:
    import xarray as xr


SOBOL, RANK = "Sobol indices", "rank correlation"
_CONSTANT = "it is the same in every flight"
_OUTPUTS = {
    "met": "every requirement met (1 or 0)",
    "miss_m": "greatest miss",
    "arrival_spread_s": "arrival spread",
}


@dataclass(frozen=True)
class Influence:
    """Sensitivity of one output to one input, with a confidence interval.

    Attributes
    ----------
    output
        Name of the output.
    path
        Key path of the input in the scenario.
    measure
        "first" or "total" (Sobol indices), or "rank" (Spearman's rank correlation).
    value, low, high
        Value of the measure, and the bounds of its confidence interval.
    """

    output: str
    path: str
    measure: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Influences:
    """Sensitivities of the outputs of a campaign to its inputs.

    Attributes
    ----------
    kind
        "Sobol indices" or "rank correlation".
    confidence
        Confidence level of the intervals.
    flights
        Number of flights used.
    outputs
        Description of each output by name.
    entries
        Sensitivities that could be computed, one for each output, input and measure.
    not_computed
        Reason for each output or input without sensitivities, by name or key path.
    """

    kind: str
    confidence: float
    flights: int
    outputs: dict[str, str]
    entries: tuple[Influence, ...]
    not_computed: dict[str, str]

    def as_dict(self) -> dict[str, Any]:
        """Return the sensitivities as plain data for JSON."""
        return asdict(self)


def influences(data: "xr.Dataset", study: Study, varied: list[str]) -> Influences:
    """Compute the sensitivity of the outputs of a campaign to its inputs.

    The output ``met`` is 1 for a successful flight, else 0. For miss and spread, rank correlations treat flights
    without a value as worst; Sobol indices require a finite value for every flight and are otherwise not computed.

    Parameters
    ----------
    data
        Completed flights, from `CampaignStore.dataset`; for Saltelli sampling only complete blocks are used.
    varied
        Key paths of the inputs.
    """
    if study.block > 1:
        return _sobol(data.isel(flight=_whole_blocks(data["flight"].values, study.block)), study, varied)
    return _ranks(data, study, varied)


def _outputs(data: "xr.Dataset") -> dict[str, np.ndarray]:
    """Return the value of each output in every flight, by name: success 0 or 1, and the worst value of the fleet."""
    is_met = data["met"].values
    worst = {name: worst_of_fleet(data, name) for name in applicable_quantities(_OUTPUTS, data) if name != "met"}
    return {"met": is_met.astype(float), **worst}


def _output_labels(outputs: Iterable[str]) -> dict[str, str]:
    return {name: _OUTPUTS[name] for name in outputs}


def _whole_blocks(numbers: np.ndarray, block: int) -> np.ndarray:
    """Return the indices of the flights in complete Saltelli blocks, ordered by flight number."""
    order = np.argsort(numbers)
    blocks, counts = np.unique(numbers // block, return_counts=True)
    return order[np.isin(numbers[order] // block, blocks[counts == block])]


def _sobol(data: "xr.Dataset", study: Study, varied: list[str]) -> Influences:
    """Compute first-order and total Sobol indices of each output; `data` contains whole Saltelli blocks."""
    confidence, outputs = study.answers.confidence, _outputs(data)
    entries: list[Influence] = []

    def add_entries(name: str) -> None:
        lacking = int(np.sum(~np.isfinite(outputs[name])))
        if lacking:
            raise ValueError(
                f"{lacking} of {outputs[name].size} flights have no such number, and one in its place would be made up"
            )
        indices = sobol_indices(outputs[name], len(varied), confidence)
        for k, path in enumerate(varied):
            for measure, values, halves in (
                ("first", indices.first, indices.first_half_width),
                ("total", indices.total, indices.total_half_width),
            ):
                value, half = float(values[k]), float(halves[k])
                entries.append(Influence(name, path, measure, value, value - half, value + half))

    not_computed = _compute_outputs(add_entries, outputs)
    return Influences(SOBOL, confidence, data.sizes["flight"], _output_labels(outputs), tuple(entries), not_computed)


def _ranks(data: "xr.Dataset", study: Study, varied: list[str]) -> Influences:
    """Compute the rank correlation of each output with each input."""
    confidence, outputs = study.answers.confidence, _outputs(data)
    inputs = {path: ordered_values(data[path].values, study, path) for path in varied}
    not_computed = {path: "texts of a table have no order" for path, values in inputs.items() if values is None}
    not_computed |= {
        path: _CONSTANT for path, values in inputs.items() if values is not None and np.unique(values).size < 2
    }
    entries: list[Influence] = []

    def add_entries(name: str) -> None:
        for path, values in inputs.items():
            if values is not None and path not in not_computed:
                entries.append(Influence(name, path, "rank", *rank_correlation(values, outputs[name], confidence)))

    not_computed |= _compute_outputs(add_entries, outputs)
    return Influences(RANK, confidence, data.sizes["flight"], _output_labels(outputs), tuple(entries), not_computed)


def _compute_outputs(add_entries: Callable[[str], None], outputs: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Call `add_entries` with the name of each output; return the reason for each output without a result, by name."""
    not_computed: dict[str, str] = {}
    for name in outputs:
        if np.unique(outputs[name]).size < 2:
            not_computed[name] = _CONSTANT
            continue
        try:
            add_entries(name)
        except ValueError as error:
            not_computed[name] = str(error)
    return not_computed


def ordered_values(values: np.ndarray, study: Study, path: str) -> np.ndarray | None:
    """Convert the values of an input to numbers; a text becomes its position in the study's list of values.

    None if the texts come from a table and therefore have no order.
    """
    if values.dtype.kind in "fiub":
        return values.astype(float)
    positions: Mapping[Any, int] = {
        value: k for vary in study.vary if vary.path == path for k, value in enumerate(vary.values or ())
    }
    return np.array([float(positions[value]) for value in values.tolist()]) if positions else None
