"""What a robustness study says: rates of success with intervals, what breaks first, what goes with failures."""

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
    """How many of some flights reached their command.

    Attributes
    ----------
    drawn, no_steady_flight, flown, reached
        Aircraft drawn; of these without a steady flight to leave from, flown, and successful.
    share, low, high
        Successful part of those flown, and the ends of its interval of 95 %.
    reasons
        "outcome: reason" of all others that were flown, with their number, the most frequent first.
    """

    drawn: int
    no_steady_flight: int
    flown: int
    reached: int
    share: float
    low: float
    high: float
    reasons: dict[str, int]


def flights_in_part(dataset: xr.Dataset, part: str) -> np.ndarray:
    """Mask of the flights of one part of a study, shape (flights,)."""
    return _words(dataset["part"]) == part


def success(dataset: xr.Dataset, inversion: str, chosen: np.ndarray) -> SuccessRate:
    """Success of one inversion on the chosen flights (mask, shape (flights,)) of a study."""
    of = dataset.sel(inversion=inversion)
    outcome = _words(of["outcome"])
    flown, well = chosen & (outcome != "not_flown"), chosen & (outcome == "reached")
    number, reached = int(flown.sum()), int(well.sum())
    named = Counter(f"{outcome[k]}: {_reason(of, int(k))}" for k in np.flatnonzero(flown & ~well))
    return SuccessRate(
        drawn=int(chosen.sum()),
        no_steady_flight=int(chosen.sum()) - number,
        flown=number,
        reached=reached,
        share=reached / number if number else math.nan,
        low=wilson_interval(reached, number)[0],
        high=wilson_interval(reached, number)[1],
        reasons=dict(named.most_common()),
    )


def _words(flags: xr.DataArray) -> np.ndarray:
    """Words of an index, as its own dataset gives them."""
    return np.array(flags.attrs["flag_meanings"].split())[flags.values]


def _reason(of: xr.Dataset, flight: int) -> str:
    """Reason of one flight of one inversion; where no limit explains it, the channels whose error was left."""
    name = str(_words(of["reason"].isel(flight=[flight]))[0])
    if name != "unexplained":
        return name
    left = [
        channel
        for channel, suffix in _CHANNELS
        if not of[f"{channel}_final_error_max_{suffix}"].values[flight] <= of.attrs[f"tolerance_{channel}_{suffix}"]
    ]
    return f"error_left_in_{'_and_'.join(left)}" if left else name


@dataclass(frozen=True)
class FirstBreak:
    """Smallest change of one factor alone, one way, with which a flight does not reach its command.

    Attributes
    ----------
    factor, inversion
        Names.
    sign
        +1 or -1: the way of the change.
    change, value
        Relative change and value; the largest that was flown where nothing breaks.
    survived
        Largest change with which all flights still reach their command.
    reason, condition
        Why, and where (the first of several); None where nothing breaks.
    """

    factor: str
    inversion: str
    sign: int
    change: float
    value: float
    survived: float
    reason: str | None
    condition: str | None


def first_breaks(dataset: xr.Dataset) -> list[FirstBreak]:
    """First break of every factor that the part "alone" of a study holds, both ways, for each inversion.

    An aircraft without a steady flight is a break too: it cannot be flown by any autopilot.
    """
    found = []
    alone, change = dataset["alone"].values, dataset["spread_percent"].values / 100
    places = dataset["condition_meaning"].values
    for index in np.unique(alone[alone >= 0]):
        factor = dataset.isel(factor=index)
        for inversion in dataset["inversion"].values:
            of = dataset.sel(inversion=inversion)
            outcome = _words(of["outcome"])
            for sign in (-1, 1):
                rows = np.flatnonzero((alone == index) & (np.sign(change) == sign))
                if not rows.size:
                    continue
                rows = rows[np.argsort(np.abs(change[rows]), kind="stable")]
                bad = rows[outcome[rows] != "reached"]
                first = bad[0] if bad.size else rows[-1]
                good = rows if not bad.size else rows[np.abs(change[rows]) < np.abs(change[first])]
                why = _NO_STEADY_FLIGHT if outcome[first] == "not_flown" else _reason(of, int(first))
                found.append(
                    FirstBreak(
                        factor=str(factor["factor"].item()),
                        inversion=str(inversion),
                        sign=sign,
                        change=float(change[first]),
                        value=float(dataset["factor_value"].values[first, index]),
                        survived=float(change[good[-1]]) if good.size else 0.0,
                        reason=why if bad.size else None,
                        condition=str(places[dataset["condition"].values[first]]) if bad.size else None,
                    )
                )
    return found


@dataclass(frozen=True)
class FailureCorrelation:
    """How failures go with one factor.

    Attributes
    ----------
    factor
        Name.
    of
        "value": failures go with a larger value (or a smaller, where negative); "amount": with a larger change, either
        way. The stronger of the two.
    correlation
        Pearson's.
    """

    factor: str
    of: str
    correlation: float


def failure_correlations(dataset: xr.Dataset, inversion: str, chosen: np.ndarray) -> list[FailureCorrelation]:
    """Factors whose values or changes go with failure over the chosen flights, the strongest first.

    What may be chance, less than 3 deviations of a correlation of nothing, is left out.
    """
    outcome = _words(dataset["outcome"].sel(inversion=inversion))
    rows = chosen & (outcome != "not_flown")
    failed = (outcome[rows] != "reached").astype(float)
    if not failed.any() or failed.all():
        return []
    values = dataset["factor_value"].values[rows]
    change = values - dataset["factor_nominal"].values
    found = []
    for k, name in enumerate(dataset["factor"].values):
        kinds = {"value": change[:, k], "amount": np.abs(change[:, k])}
        of = {kind: float(np.corrcoef(x, failed)[0, 1]) for kind, x in kinds.items() if np.ptp(x) > 0.0}
        kind = max(of, key=lambda kind, of=of: abs(of[kind]), default=None)
        if kind is not None and abs(of[kind]) >= 3 / math.sqrt(len(failed)):
            found.append(FailureCorrelation(str(name), kind, of[kind]))
    return sorted(found, key=lambda one: -abs(one.correlation))
