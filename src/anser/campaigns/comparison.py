"""Comparison of two campaigns, flight by flight: flight k has the same seed in both campaigns."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from anser.campaigns.campaign_folder import Campaign
from anser.campaigns.sampling import is_independent
from anser.campaigns.store import CampaignStore
from anser.report.flight_page import scenario_differences
from anser.results.documents import finite_or_none
from anser.results.flight_rows import AIRCRAFT_QUANTITIES, FLEET_QUANTITIES, applicable_quantities, worst_of_fleet
from anser.results.sampling_statistics import mcnemar_exact, order_statistic_interval, quantile, wilson_interval
from anser.results.variable_labels import unit_attributes

_OUTPUTS = {"miss_m": "greatest miss", "arrival_spread_s": "arrival spread"}
_MEDIAN = 0.5
_UNITS = {name: unit for name, (unit, _) in (AIRCRAFT_QUANTITIES | FLEET_QUANTITIES).items()}


@dataclass(frozen=True)
class Difference:
    """Difference of one quantity between paired flights: value of the second campaign minus value of the first."""

    name: str  #: Name of the quantity.
    words: str  #: Description of the quantity.
    unit: str  #: Unit of the quantity.
    second_better: int  #: Number of pairs in which the second flight has the better value.
    alike: int  #: Number of pairs with equal values, including two infinite values (such as two failed flights).
    first_better: int  #: Number of pairs in which the first flight has the better value.
    share: float  #: Fraction of the pairs in which the second flight is better.
    low: float  #: Lower bound of the Wilson interval of `share`.
    high: float  #: Upper bound of the Wilson interval of `share`.
    #: Quantiles of the difference: (fraction of the pairs at or below the value, value, lower and upper bound of the
    #: confidence interval of the value); None if not finite.
    quantiles: tuple[tuple[float, float | None, float | None, float | None], ...]
    greater_is_better: bool = False  #: Whether greater values of the quantity are better.

    def as_dict(self) -> dict[str, Any]:
        """Return the difference as plain data for JSON."""
        keys = ("share", "value", "low", "high")
        return {**vars(self), "quantiles": [dict(zip(keys, quantile, strict=True)) for quantile in self.quantiles]}


@dataclass(frozen=True)
class CampaignComparison:
    """Comparison of two campaigns whose flights are paired: flight k has the same seed in both."""

    first: Path  #: Folder of the first campaign.
    second: Path  #: Folder of the second campaign.
    flights: int  #: Number of independent pairs completed in both campaigns.
    confidence: float  #: Confidence level of the intervals.
    both: int  #: Number of pairs in which both flights met every requirement.
    first_only: int  #: Number of pairs in which only the first flight met every requirement.
    second_only: int  #: Number of pairs in which only the second flight met every requirement.
    neither: int  #: Number of pairs in which no flight met every requirement.
    p_value: float  #: p-value of McNemar's exact two-sided test for equal success probabilities.
    differences: tuple[Difference, ...]  #: Differences of miss distance, arrival spread and common outputs.
    #: Number of pairs in which a varied parameter differs, by key path; all pairs if only one campaign varies it.
    applied: dict[str, int]
    #: Differences of the base scenarios: key path, first value, second value.
    scenario: tuple[tuple[str, Any, Any], ...]
    precision: tuple[str, str]  #: Precision of the first and the second campaign, "float64" or "float32".
    dataset: xr.Dataset  #: Paired `met`, `miss_m`, `arrival_spread_s` and outputs, dimensions campaign and flight.

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data for JSON, without the dataset."""
        values = {key: value for key, value in vars(self).items() if key != "dataset"}
        return values | {
            "first": str(self.first),
            "second": str(self.second),
            "differences": [item.as_dict() for item in self.differences],
            "scenario": [
                {"path": path, "first": item, "second": second_value} for path, item, second_value in self.scenario
            ],
        }


def compare_campaigns(
    first: Campaign | str | os.PathLike[str], second: Campaign | str | os.PathLike[str]
) -> CampaignComparison:
    """Compare two campaigns, or their folders, flight by flight: flight k has the same seed in both.

    The first study gives the confidence level and the quantiles. A flight without an arrival counts as infinitely bad
    in every quantity.

    Raises StoreError if a folder has no campaign. Raises ValueError if the numbers of flights or the seeds differ, or
    if no flight was completed in both campaigns.
    """
    store_1, store_2 = (_store(source) for source in (first, second))
    _refuse_unpaired(store_1, store_2)
    numbers = np.intersect1d(store_1.flown, store_2.flown)
    numbers = numbers[is_independent(store_1.study, numbers) & is_independent(store_2.study, numbers)]
    if not numbers.size:
        raise ValueError("arrived campaigns without a flight that was flown in both; expected one at least")
    data = _pairs(store_1, store_2, numbers)
    is_met, confidence = data["met"].values, store_1.study.answers.confidence
    exclusive = [int(np.sum(is_met[k] & ~is_met[1 - k])) for k in (0, 1)]
    shares = sorted({_MEDIAN, *store_1.study.answers.quantiles})
    return CampaignComparison(
        store_1.folder,
        store_2.folder,
        int(numbers.size),
        confidence,
        int(is_met.all(axis=0).sum()),
        exclusive[0],
        exclusive[1],
        int((~is_met).all(axis=0).sum()),
        mcnemar_exact(exclusive[0], exclusive[1]),
        tuple(_difference(data[name], shares, confidence) for name in data if name != "met"),
        _applied(store_1, store_2, numbers),
        tuple(scenario_differences(store_1.scenario.model_dump(mode="json"), store_2.scenario.model_dump(mode="json"))),
        (store_1.study.precision, store_2.study.precision),
        data,
    )


def _store(campaign: Campaign | str | os.PathLike[str]) -> CampaignStore:
    return campaign.store if isinstance(campaign, Campaign) else CampaignStore.open(Path(campaign))


def _refuse_unpaired(store_1: CampaignStore, store_2: CampaignStore) -> None:
    """Raise ValueError if two campaigns differ in the number of flights or in the seed of a flight."""
    if store_1.flights != store_2.flights:
        message = (
            f"arrived campaigns of {store_1.flights} and {store_2.flights} flights; expected as many in both, in pairs"
        )
        raise ValueError(message)
    seeds = [store.applied(slice(None))[0] for store in (store_1, store_2)]
    unequal = int(np.sum(seeds[0] != seeds[1]))
    if unequal:
        raise ValueError(
            f"arrived campaigns of which {unequal} of {store_1.flights} flights have other seeds (studies of the seeds "
            f"{store_1.study.seed} and {store_2.study.seed}); expected the same seed for the same flight"
        )


def _pairs(store_1: CampaignStore, store_2: CampaignStore, numbers: np.ndarray) -> xr.Dataset:
    """Return the paired results of the flights `numbers` of both campaigns, with the dimensions campaign and flight.

    Each value is the worst value in the fleet; infinitely bad if an aircraft did not arrive.
    """
    datasets = [data.dataset().sel(flight=numbers) for data in (store_1, store_2)]
    is_met = np.stack([data["met"].values for data in datasets])
    dimensions = ("campaign", "flight")
    variables: dict[str, Any] = {"met": (dimensions, is_met, unit_attributes("1", "Whether every requirement is met"))}
    for name in applicable_quantities(_OUTPUTS, datasets[0]):
        values = np.stack([worst_of_fleet(data, name) for data in datasets])
        variables[name] = (dimensions, values, unit_attributes(_UNITS[name], _OUTPUTS[name]))
    for output in store_1.study.output:
        if output in store_2.study.output:
            values = np.stack([worst_of_fleet(data, output.name, upper=output.is_upper) for data in datasets])
            attributes = unit_attributes(output.labels[0], output.name)
            variables[output.name] = (dimensions, values, attributes | {"greater_is_better": int(not output.is_upper)})
    return xr.Dataset(variables, coords={"campaign": ["first", "second"], "flight": numbers})


def _difference(quantity: xr.DataArray, shares: list[float], confidence: float) -> Difference:
    """Compare the paired values of one quantity; `quantity` has the dimensions campaign (first, second) and flight.

    `shares` are the probabilities of the quantiles, `confidence` is the level of all intervals.
    """
    values_1, values_2 = quantity.values
    greater_is_better = bool(quantity.attrs.get("greater_is_better", False))
    alike = values_1 == values_2  # including two infinite values
    difference = np.where(alike, 0.0, np.where(alike, 0.0, values_2) - np.where(alike, 0.0, values_1))
    is_better = difference > 0.0 if greater_is_better else difference < 0.0
    better_count, count = int(np.sum(is_better)), difference.size
    low, high = wilson_interval(better_count, count, confidence)
    quantiles = []
    for share in shares:
        value, interval = quantile(difference, share), order_statistic_interval(difference, share, confidence)
        quantiles.append((share, finite_or_none(value), *map(finite_or_none, interval)))
    alike_count = int(alike.sum())
    counts = better_count, alike_count, count - better_count - alike_count
    shares_better = better_count / count, low, high
    labels = str(quantity.name), quantity.attrs["long_name"], quantity.attrs["units"]
    return Difference(*labels, *counts, *shares_better, tuple(quantiles), greater_is_better)


def _applied(store_1: CampaignStore, store_2: CampaignStore, numbers: np.ndarray) -> dict[str, int]:
    """Count the pairs in which a varied parameter has different values; return the counts by key path, without zeros.

    If only one of the campaigns varies a parameter, the parameter's count is the number of all pairs.
    """
    values = [store.applied(slice(None))[1] for store in (store_1, store_2)]
    counts = {}
    for path in dict.fromkeys([*values[0], *values[1]]):
        columns = [store[path][numbers] for store in values if path in store]
        count = numbers.size if len(columns) < 2 else int(np.sum(columns[0] != columns[1]))
        if count:
            counts[path] = int(count)
    return counts
