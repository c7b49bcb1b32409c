"""Statistics of a robustness study: success rates, least changes that lead to failure, correlations with failure."""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
import xarray as xr

from anser.results.sampling_statistics import wilson_interval

_CHANNELS = (("airspeed", "m_s"), ("path_angle", "deg"), ("course", "deg"))
_NO_STEADY_FLIGHT = "no_steady_flight"


@dataclass(frozen=True)
class SuccessRate:
    """Success rate of the autopilot over flights of a study; a successful flight reached the commanded values."""

    drawn: int  # number of sampled aircraft
    no_steady_flight: int  # number of sampled aircraft that could not be trimmed at the start
    flown: int  # number of flights
    reached: int  # number of successful flights
    share: float  # reached / flown
    low: float  # bounds of the 95 % confidence interval of `share`
    high: float
    reasons: dict[str, int]  # number of failed flights by "outcome: reason", most frequent first


def flights_in_part(dataset: xr.Dataset, part: str) -> np.ndarray:
    """Return the mask, shape (flights,), of the flights in one part of a study.

    `part` is "dispersed" (all factors dispersed, at one spread), "spread" (all factors dispersed, at several spreads)
    or "alone" (one factor changed).
    """
    return _decode_flags(dataset["part"]) == part


def success(dataset: xr.Dataset, inversion: str, selection: np.ndarray) -> SuccessRate:
    """Return the success rate of one type of dynamic inversion over the flights of a mask `selection` (flights,).

    If no flight was flown, the rate is NaN with the interval 0 to 1.
    """
    flights = dataset.sel(inversion=inversion)
    outcome = _decode_flags(flights["outcome"])
    flown, is_success = selection & (outcome != "not_flown"), selection & (outcome == "reached")
    flown_count, reached = int(flown.sum()), int(is_success.sum())
    failure_counts = Counter(
        f"{outcome[k]}: {_failure_reason(flights, int(k))}" for k in np.flatnonzero(flown & ~is_success)
    )
    return SuccessRate(
        drawn=int(selection.sum()),
        no_steady_flight=int(selection.sum()) - flown_count,
        flown=flown_count,
        reached=reached,
        share=reached / flown_count if flown_count else math.nan,
        low=wilson_interval(reached, flown_count)[0],
        high=wilson_interval(reached, flown_count)[1],
        reasons=dict(failure_counts.most_common()),
    )


def _decode_flags(flags: xr.DataArray) -> np.ndarray:
    """Return the meaning of each code in a coded variable as text, from the attribute `flag_meanings`."""
    return np.array(flags.attrs["flag_meanings"].split())[flags.values]


def _failure_reason(flights: xr.Dataset, flight: int) -> str:
    """Return why flight number `flight` failed: the active limit, or the channels with too large final errors."""
    name = str(_decode_flags(flights["reason"].isel(flight=[flight]))[0])
    if name != "unexplained":
        return name
    channels = [
        channel
        for channel, suffix in _CHANNELS
        if not flights[f"{channel}_final_error_max_{suffix}"].values[flight]
        <= flights.attrs[f"tolerance_{channel}_{suffix}"]
    ]
    return f"error_left_in_{'_and_'.join(channels)}" if channels else name


@dataclass(frozen=True)
class FirstBreak:
    """Smallest change of one factor, up or down, with which a flight fails to reach the commanded values."""

    factor: str
    inversion: str
    sign: int  # direction of the change, +1 or -1
    change: float  # change in the first failure, as a fraction; the largest change of the study if no flight fails
    value: float  # value of the factor with this change
    survived: float  # greatest change up to which no flight fails; 0 if none
    reason: str | None  # reason for the failure; None if no flight fails
    condition: str | None  # flight condition of the failure; None if no flight fails


def first_breaks(dataset: xr.Dataset) -> list[FirstBreak]:
    """Return the least change of each factor that leads to failure, from the part "alone" of a study.

    The list has an entry for each factor, type of inversion and direction. A changed aircraft that cannot be trimmed at
    the start counts as a failure.
    """
    breaks = []
    factor_index, change = dataset["alone"].values, dataset["spread_percent"].values / 100
    conditions = dataset["condition_meaning"].values
    for index in np.unique(factor_index[factor_index >= 0]):
        factor = dataset.isel(factor=index)
        for inversion in dataset["inversion"].values:
            flights = dataset.sel(inversion=inversion)
            outcome = _decode_flags(flights["outcome"])
            for sign in (-1, 1):
                trials = np.flatnonzero((factor_index == index) & (np.sign(change) == sign))
                if not trials.size:
                    continue
                trials = trials[np.argsort(np.abs(change[trials]), kind="stable")]
                failed = trials[outcome[trials] != "reached"]
                trial = failed[0] if failed.size else trials[-1]
                passed = trials if not failed.size else trials[np.abs(change[trials]) < np.abs(change[trial])]
                reason = _NO_STEADY_FLIGHT if outcome[trial] == "not_flown" else _failure_reason(flights, int(trial))
                breaks.append(
                    FirstBreak(
                        factor=str(factor["factor"].item()),
                        inversion=str(inversion),
                        sign=sign,
                        change=float(change[trial]),
                        value=float(dataset["factor_value"].values[trial, index]),
                        survived=float(change[passed[-1]]) if passed.size else 0.0,
                        reason=reason if failed.size else None,
                        condition=str(conditions[dataset["condition"].values[trial]]) if failed.size else None,
                    )
                )
    return breaks


@dataclass(frozen=True)
class FailureCorrelation:
    """Pearson's correlation of failure (1: failed, 0: success) with the change of one factor, over flights."""

    factor: str
    measure: str  # "value" (signed change) or "amount" (magnitude of the change), whichever correlates more
    correlation: float


def failure_correlations(dataset: xr.Dataset, inversion: str, selection: np.ndarray) -> list[FailureCorrelation]:
    """Return the factors whose change correlates with failure, the strongest correlation first.

    The flights are given by the mask `selection` (flights,) and the type of dynamic inversion. Correlations below
    3/sqrt(n), three standard deviations for n independent values, are omitted. The list is empty if no flight failed or
    every flight failed.
    """
    outcome = _decode_flags(dataset["outcome"].sel(inversion=inversion))
    is_used = selection & (outcome != "not_flown")
    failed = (outcome[is_used] != "reached").astype(float)
    if not failed.any() or failed.all():
        return []
    values = dataset["factor_value"].values[is_used]
    change = values - dataset["factor_nominal"].values
    correlations = []
    for k, name in enumerate(dataset["factor"].values):
        changes = {"value": change[:, k], "amount": np.abs(change[:, k])}
        values_by_measure = {
            measure: float(np.corrcoef(x, failed)[0, 1]) for measure, x in changes.items() if np.ptp(x) > 0.0
        }
        measure = max(
            values_by_measure,
            key=lambda measure, values_by_measure=values_by_measure: abs(values_by_measure[measure]),
            default=None,
        )
        if measure is not None and abs(values_by_measure[measure]) >= 3 / math.sqrt(len(failed)):
            correlations.append(FailureCorrelation(str(name), measure, values_by_measure[measure]))
    return sorted(correlations, key=lambda item: -abs(item.correlation))
