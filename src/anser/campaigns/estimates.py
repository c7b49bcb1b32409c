"""Estimates from a campaign: success probability, quantiles and failure causes, with confidence intervals.

A flight succeeds ("met") if every aircraft arrives and every requirement of the scenario is met.
"""

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.campaigns.sampling import is_independent
from anser.campaigns.study import Study
from anser.results.arrival import AS_PLANNED
from anser.results.documents import finite_or_none
from anser.results.flight_rows import applicable_quantities, worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, quantile, wilson_interval

_UPPER = {
    "miss_m": ("greatest miss", "m"),
    "arrival_spread_s": ("arrival spread", "s"),
    "arrival_s": ("last arrival", "s"),
}
"""Quantities for which smaller is better, with description and unit; the fleet's greatest value counts."""
_LOWER = {
    "separation_min_m": ("least separation", "m"),
    "separation_ratio_min": ("least part of the separation asked for", "1"),
    "clearance_min_m": ("least distance to a goal", "m"),
    "keep_out_room_min_m": ("least distance outside the keep-outs", "m"),
}
"""Quantities for which greater is better, with description and unit; the fleet's least value counts."""


@dataclass(frozen=True)
class QuantileEstimate:
    """Quantile of a quantity over the flights of a campaign, with a confidence interval.

    A number is None if infinite: too few flights, or too many flights without an arrival.
    """

    name: str  #: Name of the quantity.
    words: str  #: Description of the quantity.
    unit: str  #: Unit of the quantity.
    share: float  #: Fraction of the flights with values at or below `value`, or at or above if `upper` is False.
    upper: bool  #: True: great values are bad, and `value` is an upper bound. False: small values are bad.
    value: float | None  #: The quantile; None if infinite.
    low: float | None  #: Lower bound of the confidence interval; None if infinite.
    high: float | None  #: Upper bound of the confidence interval; None if infinite.


@dataclass(frozen=True)
class CampaignEstimates:
    """Estimates from the completed flights of a campaign."""

    flights: int  #: Number of planned flights.
    flown: int  #: Number of completed flights, including flights that could not start.
    met: int  #: Number of successful flights.
    confidence: float  #: Confidence level of the intervals.
    #: Number of completed flights that are statistically independent: two per block for Saltelli sampling, all flights
    #: for other sampling. Probability and quantiles use only these flights.
    independent: int
    probability: float | None  #: Success probability of a flight; None before the first flight.
    low: float  #: Lower bound of the Wilson interval of the probability.
    high: float  #: Upper bound of the Wilson interval of the probability.
    causes: dict[str, int]  #: Number of failed flights by cause, most frequent first.
    quantiles: tuple[QuantileEstimate, ...]  #: Quantiles of each quantity at the fractions given in the study.
    worst: tuple[int, ...]  #: Numbers of the ten worst flights: failed flights first, then by miss distance.

    def as_dict(self) -> dict[str, Any]:
        """Return the estimates as plain data for JSON."""
        return asdict(self)


_WORST = 10


def estimate_campaign(data: xr.Dataset, flights: int, study: Study) -> CampaignEstimates:
    """Compute success probability, quantiles and failure causes from the dataset of a campaign's completed flights.

    `flights` is the number of planned flights. A flight without an arrival counts as infinitely bad in every quantile.
    """
    flown, met_count, settings = data.sizes["flight"], int(data["met"].sum()), study.answers
    independent = data.isel(flight=np.flatnonzero(is_independent(study, data["flight"].values)))
    count, met_independent = independent.sizes["flight"], int(independent["met"].sum())
    low, high = wilson_interval(met_independent, count, settings.confidence)
    quantile_estimates = []
    outputs = {output.name: (output.name, output.labels[0], output.is_upper) for output in study.output}
    for upper, quantities in ((True, _UPPER), (False, _LOWER)):
        quantities = quantities | {name: labels[:2] for name, labels in outputs.items() if labels[2] is upper}
        for name in applicable_quantities(quantities, independent):
            description, unit = quantities[name]
            values = worst_of_fleet(independent, name, upper=upper)
            if count and np.isfinite(values).any():
                quantile_estimates += [
                    _quantile_estimate(name, description, unit, values, share, upper, settings.confidence)
                    for share in settings.quantiles
                ]
    return CampaignEstimates(
        flights=flights,
        flown=flown,
        met=met_count,
        confidence=settings.confidence,
        independent=count,
        probability=met_independent / count if count else None,
        low=low,
        high=high,
        causes=_causes(data),
        quantiles=tuple(quantile_estimates),
        worst=worst_flights(data, _WORST),
    )


def _quantile_estimate(
    name: str, description: str, unit: str, values: np.ndarray, share: float, upper: bool, confidence: float
) -> QuantileEstimate:
    """Estimate one quantile of `values`, shape (flights,), with its confidence interval.

    The fraction `share` of the flights has values at or below the quantile; at or above if `upper` is False. For a
    flight without an arrival, the caller must set the value to infinity, or to minus infinity if `upper` is False.
    """
    sign = 1.0 if upper else -1.0
    low, high = order_statistic_interval(sign * values, share, confidence)
    value = sign * quantile(sign * values, share)
    interval = (low, high) if upper else (-high, -low)
    return QuantileEstimate(name, description, unit, share, upper, *map(finite_or_none, (value, *interval)))


def _causes(data: xr.Dataset) -> dict[str, int]:
    """Return the number of failed flights by cause, most frequent first.

    A cause is the reason for a failed start, the status of a failed aircraft, or an unmet requirement.
    """
    counts: Counter[str] = Counter()
    for k in np.flatnonzero(~data["met"].values):
        reason = str(data["reason"].values[k])
        statuses = {str(status) for status in data["status"].values[k]} - AS_PLANNED
        unmet = [f"not met: {name}" for name in str(data["unmet"].values[k]).split(", ") if name]
        counts.update([f"could not begin: {reason}"] if reason else [*sorted(statuses), *unmet])
    return dict(counts.most_common())


def worst_flights(data: xr.Dataset, count: int) -> tuple[int, ...]:
    """Return the numbers of the `count` worst flights: failed flights first, then by the fleet's greatest miss."""
    misses = worst_of_fleet(data, "miss_m")
    order = np.lexsort((-misses, data["met"].values))
    return tuple(int(data["flight"].values[k]) for k in order[:count])
