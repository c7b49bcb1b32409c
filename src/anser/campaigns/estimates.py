"""What a campaign answers: how surely, how far at most, and what fails; with intervals."""

from collections import Counter
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.campaigns.sampling import is_independent
from anser.results.documents import finite_or_none
from anser.results.flight_rows import applicable_quantities, worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, quantile, wilson_interval

if TYPE_CHECKING:
    import xarray as xr

    from anser.campaigns.study import Study


_UPPER = {
    "miss_m": ("greatest miss", "m"),
    "arrival_spread_s": ("arrival spread", "s"),
    "arrival_s": ("last arrival", "s"),
}
"""What is the better the less; of aircraft the greatest counts."""
_LOWER = {
    "separation_min_m": ("least separation", "m"),
    "separation_ratio_min": ("least part of the separation asked for", "1"),
    "clearance_min_m": ("least distance to a goal", "m"),
}
"""What is the better the more; of aircraft the least counts."""


@dataclass(frozen=True)
class QuantileEstimate:
    """A quantile of one quantity over all flights, with an interval.

    Attributes
    ----------
    name, words, unit
        Of the quantity.
    share
        Part of the flights that stay within the value: below it, or above it where `upper` is False.
    upper
        Whether it is bounded from above.
    value, low, high
        Quantile, and the ends of its order-statistic interval; None where so many flights failed, or so few were
        flown, that it is not known.
    """

    name: str
    words: str
    unit: str
    share: float
    upper: bool
    value: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class CampaignEstimates:
    """What the flights of a campaign answer so far.

    Attributes
    ----------
    flights, flown, met
        How many there are to be, were flown, and met every requirement; one that could not begin counts as flown.
    confidence
        Of all intervals.
    independent
        How many of those flown are independent of each other: all, but for the blocks of a Saltelli sampling. The
        probability and the quantiles come from these alone, or their intervals would be too narrow.
    probability, low, high
        Of meeting every requirement, and its Wilson interval.
    causes
        What failed in how many flights, the most frequent first.
    quantiles
        Of each quantity.
    worst
        Numbers of the flights that failed, and then of those with the greatest miss; ten at most.
    """

    flights: int
    flown: int
    met: int
    confidence: float
    independent: int
    probability: float | None
    low: float
    high: float
    causes: dict[str, int]
    quantiles: tuple[QuantileEstimate, ...]
    worst: tuple[int, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


_WORST = 10


def estimate_campaign(data: "xr.Dataset", flights: int, study: "Study") -> CampaignEstimates:
    """Sum a campaign up. A flight that failed counts as a failure in every answer, never as missing.

    Parameters
    ----------
    data
        Flights flown, from `CampaignStore.dataset`.
    flights
        How many there are to be.
    study
        What was flown; it says the confidence and the quantiles.
    """
    flown, met, asked = data.sizes["flight"], int(data["met"].sum()), study.answers
    alone = data.isel(flight=np.flatnonzero(is_independent(study, data["flight"].values)))
    count, met_alone = alone.sizes["flight"], int(alone["met"].sum())
    low, high = wilson_interval(met_alone, count, asked.confidence)
    found = []
    for upper, quantities in ((True, _UPPER), (False, _LOWER)):
        for name in applicable_quantities(quantities, alone):
            words, unit = quantities[name]
            values = worst_of_fleet(alone, name, upper=upper)
            if count and np.isfinite(values).any():
                found += [
                    _quantile_estimate(name, words, unit, values, share, upper, asked.confidence)
                    for share in asked.quantiles
                ]
    share, worst = met_alone / count if count else None, worst_flights(data, _WORST)
    return CampaignEstimates(
        flights, flown, met, asked.confidence, count, share, low, high, _causes(data), tuple(found), worst
    )


def _quantile_estimate(
    name: str, words: str, unit: str, values: np.ndarray, share: float, upper: bool, confidence: float
) -> QuantileEstimate:
    sign = 1.0 if upper else -1.0
    low, high = order_statistic_interval(sign * values, share, confidence)
    value = sign * quantile(sign * values, share)
    ends = (low, high) if upper else (-high, -low)
    return QuantileEstimate(name, words, unit, share, upper, *map(finite_or_none, (value, *ends)))


def _causes(data: "xr.Dataset") -> dict[str, int]:
    """What a flight failed of: that it could not begin, else statuses of aircraft and requirements."""
    counted: Counter[str] = Counter()
    for k in np.flatnonzero(~data["met"].values):
        reason = str(data["reason"].values[k])
        statuses = {str(one) for one in data["status"].values[k]} - {"arrived"}
        unmet = [f"not met: {one}" for one in str(data["unmet"].values[k]).split(", ") if one]
        counted.update([f"could not begin: {reason}"] if reason else [*sorted(statuses), *unmet])
    return dict(counted.most_common())


def worst_flights(data: "xr.Dataset", count: int) -> tuple[int, ...]:
    """Numbers of the flights that failed, and then of those with the greatest miss; so many at most."""
    misses = worst_of_fleet(data, "miss_m")
    order = np.lexsort((-misses, data["met"].values))
    return tuple(int(data["flight"].values[k]) for k in order[:count])
