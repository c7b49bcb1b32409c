"""Two campaigns with paired seeds: what became of each flight in the one and in the other."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.campaigns.campaign_folder import Campaign
from anser.campaigns.sampling import is_independent
from anser.campaigns.store import CampaignStore
from anser.report.comparison import scenario_differences
from anser.results.documents import finite_or_none
from anser.results.flight_rows import AIRCRAFT_QUANTITIES, FLEET_QUANTITIES, applicable_quantities, worst_of_fleet
from anser.results.sampling_statistics import mcnemar_exact, order_statistic_interval, quantile, wilson_interval
from anser.results.variable_labels import unit_attributes

if TYPE_CHECKING:
    import xarray as xr


_OUTPUTS = {"miss_m": "greatest miss", "arrival_spread_s": "arrival spread"}
_MEDIAN = 0.5


@dataclass(frozen=True)
class Difference:
    """How one quantity differs from flight to flight, the second campaign's less the first's.

    Attributes
    ----------
    name, words, unit
        Of the quantity, of which less is better.
    second_better, alike, first_better
        In how many flights; alike where both have no such number, too.
    share, low, high
        Part of the flights in which the second is better, and its Wilson interval.
    quantiles
        Of the differences: share, value, and the ends of its order-statistic interval; None where not known.
    """

    name: str
    words: str
    unit: str
    second_better: int
    alike: int
    first_better: int
    share: float
    low: float
    high: float
    quantiles: tuple[tuple[float, float | None, float | None, float | None], ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        keys = ("share", "value", "low", "high")
        return {**vars(self), "quantiles": [dict(zip(keys, one, strict=True)) for one in self.quantiles]}


@dataclass(frozen=True)
class CampaignComparison:
    """What two campaigns with paired seeds say beside each other.

    Attributes
    ----------
    first, second
        Their folders.
    flights
        How many pairs were flown in both, and are independent of each other.
    confidence
        Of all intervals.
    both, first_only, second_only, neither
        In how many pairs every requirement was met.
    p_value
        McNemar's exact test of the pairs that fall apart: how likely such a difference is where there is none.
    differences
        Of miss and spread.
    applied
        By path, in how many of the pairs other values were applied; a path that one does not vary, in all.
    scenario
        Keys in which the scenarios differ that the flights begin with: path, first, second.
    precision
        In which the first and the second were flown, "float64" or "float32".
    dataset
        Pairs: `met`, `miss_m` and `arrival_spread_s`, dimensions campaign and flight.
    """

    first: Path
    second: Path
    flights: int
    confidence: float
    both: int
    first_only: int
    second_only: int
    neither: int
    p_value: float
    differences: tuple[Difference, ...]
    applied: dict[str, int]
    scenario: tuple[tuple[str, Any, Any], ...]
    precision: tuple[str, str]
    dataset: "xr.Dataset"

    def as_dict(self) -> dict[str, Any]:
        """For JSON, without the dataset."""
        found = {key: value for key, value in vars(self).items() if key != "dataset"}
        return found | {
            "first": str(self.first),
            "second": str(self.second),
            "differences": [one.as_dict() for one in self.differences],
            "scenario": [{"path": path, "first": one, "second": other} for path, one, other in self.scenario],
        }


def compare_campaigns(
    first: Campaign | str | os.PathLike[str], second: Campaign | str | os.PathLike[str]
) -> CampaignComparison:
    """Compare two campaigns flight by flight: flight k of both has the same seed.

    What is random is then the same in both, and the difference of a pair is due to what was changed. A flight
    without a miss has an infinite one; where both have none they are alike.

    Parameters
    ----------
    first, second
        Campaigns, or their folders. Other scenarios and distributions are what a comparison is for; seeds and number of
        flights must be the same.

    Raises
    ------
    StoreError
        There is no campaign in a folder.
    ValueError
        The flights are no pairs, or none was flown in both.
    """
    one, other = (_store(each) for each in (first, second))
    _refuse_unpaired(one, other)
    numbers = np.intersect1d(one.flown, other.flown)
    numbers = numbers[is_independent(one.study, numbers) & is_independent(other.study, numbers)]
    if not numbers.size:
        raise ValueError("arrived campaigns without a flight that was flown in both; expected one at least")
    data = _pairs(one, other, numbers)
    met, confidence = data["met"].values, one.study.answers.confidence
    only = [int(np.sum(met[k] & ~met[1 - k])) for k in (0, 1)]
    shares = sorted({_MEDIAN, *one.study.answers.quantiles})
    return CampaignComparison(
        one.folder,
        other.folder,
        int(numbers.size),
        confidence,
        int(met.all(axis=0).sum()),
        only[0],
        only[1],
        int((~met).all(axis=0).sum()),
        mcnemar_exact(only[0], only[1]),
        tuple(_difference(name, data[name].values, shares, confidence) for name in _OUTPUTS if name in data),
        _applied(one, other, numbers),
        tuple(scenario_differences(one.scenario.model_dump(mode="json"), other.scenario.model_dump(mode="json"))),
        (one.study.precision, other.study.precision),
        data,
    )


def _store(campaign: Campaign | str | os.PathLike[str]) -> CampaignStore:
    return campaign.store if isinstance(campaign, Campaign) else CampaignStore.open(Path(campaign))


def _refuse_unpaired(one: CampaignStore, other: CampaignStore) -> None:
    if one.flights != other.flights:
        words = f"arrived campaigns of {one.flights} and {other.flights} flights; expected as many in both, in pairs"
        raise ValueError(words)
    seeds = [each.applied(slice(None))[0] for each in (one, other)]
    off = int(np.sum(seeds[0] != seeds[1]))
    if off:
        raise ValueError(
            f"arrived campaigns of which {off} of {one.flights} flights have other seeds (studies of the seeds "
            f"{one.study.seed} and {other.study.seed}); expected the same seed for the same flight"
        )


def _pairs(one: CampaignStore, other: CampaignStore, numbers: np.ndarray) -> "xr.Dataset":
    import xarray as xr

    rows = [each.dataset().sel(flight=numbers) for each in (one, other)]
    met = np.stack([each["met"].values for each in rows])
    dimensions = ("campaign", "flight")
    labels = {**AIRCRAFT_QUANTITIES, **FLEET_QUANTITIES}
    found: dict[str, Any] = {"met": (dimensions, met, unit_attributes("1", "Whether every requirement is met"))}
    for name in applicable_quantities(_OUTPUTS, rows[0]):
        values = np.stack([worst_of_fleet(each, name) for each in rows])
        found[name] = (dimensions, values, unit_attributes(labels[name][0], _OUTPUTS[name]))
    return xr.Dataset(found, coords={"campaign": ["first", "second"], "flight": numbers})


def _difference(name: str, values: np.ndarray, shares: list[float], confidence: float) -> Difference:
    first, second = values
    alike = first == second  # both infinite, too
    off = np.where(alike, 0.0, np.where(alike, 0.0, second) - np.where(alike, 0.0, first))
    better, count = int(np.sum(off < 0.0)), off.size
    low, high = wilson_interval(better, count, confidence)
    quantiles = []
    for at in shares:
        ends = order_statistic_interval(off, at, confidence)
        quantiles.append((at, finite_or_none(quantile(off, at)), finite_or_none(ends[0]), finite_or_none(ends[1])))
    unit = {**AIRCRAFT_QUANTITIES, **FLEET_QUANTITIES}[name][0]
    same = int(alike.sum())
    return Difference(
        name, _OUTPUTS[name], unit, better, same, count - better - same, better / count, low, high, tuple(quantiles)
    )


def _applied(one: CampaignStore, other: CampaignStore, numbers: np.ndarray) -> dict[str, int]:
    values = [each.applied(slice(None))[1] for each in (one, other)]
    found = {}
    for path in dict.fromkeys([*values[0], *values[1]]):
        both = [each[path][numbers] for each in values if path in each]
        count = numbers.size if len(both) < 2 else int(np.sum(both[0] != both[1]))
        if count:
            found[path] = int(count)
    return found
