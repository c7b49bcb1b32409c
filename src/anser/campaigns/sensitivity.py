"""What the outputs of a campaign depend on: Sobol indices where it was sampled for them, else rank correlations."""

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
    """How one output depends on one input.

    Attributes
    ----------
    output, path
        Name of the output; path of the input in the scenario.
    measure
        "first" and "total" (Sobol indices), or "rank" (Spearman's correlation).
    value, low, high
        Of the measure, and its interval.
    """

    output: str
    path: str
    measure: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Influences:
    """How the outputs of a campaign depend on its inputs.

    Attributes
    ----------
    kind
        "Sobol indices" or "rank correlation".
    confidence
        Of the intervals.
    flights
        How many flights they come from.
    outputs
        Words for each output by its name.
    found
        Of each output that has them.
    without
        Why an output, or an input, has none, by its name.
    """

    kind: str
    confidence: float
    flights: int
    outputs: dict[str, str]
    entries: tuple[Influence, ...]
    not_computed: dict[str, str]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def influences(data: "xr.Dataset", study: Study, varied: list[str]) -> Influences:
    """Find what the outputs depend on.

    In ``met`` every flight counts, as 1 or 0. Of miss and spread, rank correlations count a flight that has none as the
    worst; Sobol indices need a finite number of every flight, and there are none where one has none.

    Parameters
    ----------
    data
        Flights flown, from `CampaignStore.dataset`; of a Saltelli sampling, whole blocks of it are used.
    study
        What was flown.
    varied
        Paths of what varies.
    """
    if study.block > 1:
        return _sobol(data.isel(flight=_whole_blocks(data["flight"].values, study.block)), study, varied)
    return _ranks(data, study, varied)


def _outputs(data: "xr.Dataset") -> dict[str, np.ndarray]:
    met = data["met"].values
    worst = {name: worst_of_fleet(data, name) for name in applicable_quantities(_OUTPUTS, data) if name != "met"}
    return {"met": met.astype(float), **worst}


def _output_labels(outputs: Iterable[str]) -> dict[str, str]:
    return {name: _OUTPUTS[name] for name in outputs}


def _whole_blocks(numbers: np.ndarray, block: int) -> np.ndarray:
    """Places of flights whose block is there as a whole, in the order of their numbers."""
    order = np.argsort(numbers)
    blocks, counts = np.unique(numbers // block, return_counts=True)
    return order[np.isin(numbers[order] // block, blocks[counts == block])]


def _sobol(data: "xr.Dataset", study: Study, varied: list[str]) -> Influences:
    confidence, outputs = study.answers.confidence, _outputs(data)
    found: list[Influence] = []

    def of(name: str) -> None:
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
                found.append(Influence(name, path, measure, value, value - half, value + half))

    without = _compute_outputs(of, outputs)
    return Influences(SOBOL, confidence, data.sizes["flight"], _output_labels(outputs), tuple(found), without)


def _ranks(data: "xr.Dataset", study: Study, varied: list[str]) -> Influences:
    confidence, outputs = study.answers.confidence, _outputs(data)
    inputs = {path: ordered_values(data[path].values, study, path) for path in varied}
    without = {path: "texts of a table have no order" for path, values in inputs.items() if values is None}
    without |= {path: _CONSTANT for path, values in inputs.items() if values is not None and np.unique(values).size < 2}
    found: list[Influence] = []

    def of(name: str) -> None:
        for path, values in inputs.items():
            if values is not None and path not in without:
                found.append(Influence(name, path, "rank", *rank_correlation(values, outputs[name], confidence)))

    without |= _compute_outputs(of, outputs)
    return Influences(RANK, confidence, data.sizes["flight"], _output_labels(outputs), tuple(found), without)


def _compute_outputs(of: Callable[[str], None], outputs: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Do it of every output; why it cannot be done of some."""
    without: dict[str, str] = {}
    for name in outputs:
        if np.unique(outputs[name]).size < 2:
            without[name] = _CONSTANT
            continue
        try:
            of(name)
        except ValueError as error:
            without[name] = str(error)
    return without


def ordered_values(values: np.ndarray, study: Study, path: str) -> np.ndarray | None:
    """Values of an input as numbers: texts by their place in the study's list; None where they have none."""
    if values.dtype.kind in "fiub":
        return values.astype(float)
    places: Mapping[Any, int] = {
        value: k for vary in study.vary if vary.path == path for k, value in enumerate(vary.values or ())
    }
    return np.array([float(places[value]) for value in values.tolist()]) if places else None
