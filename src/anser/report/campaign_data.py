"""Data of a campaign for its page.

Convergence, distributions, quantile bands over time, and every flight against every input, as plain data.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from anser.report.labels import printed_unit
from anser.results.flight_rows import worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, quantile, wilson_interval


def json_numbers(values: np.ndarray) -> list[float | None]:
    """Nine digits of each number; None where it is not finite."""
    return [float(f"{value:.9g}") if np.isfinite(value) else None for value in np.asarray(values, dtype=float)]


@dataclass(frozen=True)
class SeriesBands:
    """One variable over time: of each aircraft the quantiles over the flights.

    Attributes
    ----------
    name, words, unit
        Of the variable.
    times_s
        Shape (times,).
    aircraft
        Names of those that are drawn.
    quantiles
        At 5, 50 and 95 % of the flights; shape (3, aircraft, times); NaN where no flight has a number.
    """

    name: str
    long_name: str
    unit: str
    times_s: np.ndarray
    aircraft: tuple[str, ...]
    quantiles: np.ndarray


def series_data(bands: "tuple[SeriesBands, ...]") -> list[dict[str, Any]]:
    """For JSON."""
    return [
        {
            "name": one.name,
            "words": one.long_name,
            "unit": one.unit,
            "time": json_numbers(one.times_s),
            "aircraft": [
                {
                    "name": name,
                    **{end: json_numbers(one.quantiles[q, k]) for q, end in enumerate(("low", "middle", "high"))},
                }
                for k, name in enumerate(one.aircraft)
            ],
        }
        for one in bands
    ]


_COUNTS = 100
"""Numbers of flights at which convergence is drawn."""
_STEPS = 1500
"""Points of a distribution at most."""
_POINTS = 4000
"""Flights that are drawn against the inputs at most."""


@dataclass(frozen=True)
class ReplayedFlight:
    """A flight of a campaign that was flown again for its report.

    Attributes
    ----------
    number
        Of the flight.
    worst
        Whether it is one of the worst; else it is one of the others that they are drawn over.
    tracks
        Its positions, as `flight.nc` holds them.
    """

    number: int
    worst: bool
    tracks: xr.Dataset


@dataclass(frozen=True)
class CampaignReport:
    """What the page of a campaign shows.

    Attributes
    ----------
    dataset
        From `anser.campaigns.CampaignStore.dataset`.
    answers, influences
        `as_dict` of them.
    study
        The study, as plain values.
    place
        Folder of the campaign, as a user names it.
    independent
        Which flights of the dataset are independent of each other.
    worst
        Numbers of the flights that are listed as the worst.
    enough
        Whether no more are flown since the study's rule says so.
    levels
        Of inputs that are texts, all values in their order, by path.
    again
        Flights flown again; none: no map.
    otherwise
        Numbers of those that did not come out as in the campaign.
    bands
        Of the variables that are kept over time.
    """

    dataset: xr.Dataset
    estimates: Mapping[str, Any]
    influences: Mapping[str, Any]
    study: Mapping[str, Any]
    folder: str
    independent: np.ndarray
    worst: Sequence[int]
    is_converged: bool = False
    levels: Mapping[str, Sequence[str]] = field(default_factory=dict)
    replays: Sequence[ReplayedFlight] = ()
    replay_differences: Sequence[int] = ()
    bands: tuple[SeriesBands, ...] = ()

    @property
    def varied_paths(self) -> list[str]:
        """Paths of what varies."""
        return json.loads(self.dataset.attrs["varied"])


def campaign_data(shown: CampaignReport) -> dict[str, Any]:
    """Collect what the page draws, for JSON."""
    alone = shown.dataset.isel(flight=np.flatnonzero(shown.independent))
    confidence = float(shown.estimates["confidence"])
    found: dict[str, dict[str, Any]] = {}
    for one in shown.estimates["quantiles"]:
        name, upper = one["name"], one["upper"]
        if name not in found:
            values = worst_of_fleet(alone, name, upper=upper)
            share = _usual([other for other in shown.estimates["quantiles"] if other["name"] == name])
            about = {key: one[key] for key in ("name", "words", "upper")} | {"unit": printed_unit(one["unit"])}
            found[name] = about | _distribution(values, upper) | _converging(values, share, upper, confidence)
        found[name].setdefault("quantiles", []).append({key: one[key] for key in ("share", "value", "low", "high")})
    return {
        "confidence": confidence,
        "met": _met(alone["met"].values, confidence),
        "quantities": list(found.values()),
        "series": series_data(shown.bands),
        **_flights(shown, list(found.values())),
    }


def _usual(quantiles: Sequence[Mapping[str, Any]]) -> float:
    """The share whose convergence is drawn: the nearest to 95 % of those whose bound is known, if one is."""
    known = [one["share"] for one in quantiles if one["value"] is not None]
    return min(known or [one["share"] for one in quantiles], key=lambda share: abs(share - 0.95))


def _counts(size: int) -> np.ndarray:
    return np.unique(np.linspace(1, size, min(size, _COUNTS)).round().astype(int)) if size else np.empty(0, int)


def _met(met: np.ndarray, confidence: float) -> dict[str, Any]:
    counts = _counts(met.size)
    successes = np.cumsum(met)[counts - 1] if met.size else counts
    pairs = zip(successes.tolist(), counts.tolist(), strict=True)
    ends = np.array([wilson_interval(*pair, confidence) for pair in pairs]).reshape(-1, 2)
    middle = 100.0 * successes / np.maximum(counts, 1)
    return {
        "n": counts.tolist(),
        "value": json_numbers(middle),
        "low": json_numbers(100 * ends[:, 0]),
        "high": json_numbers(100 * ends[:, 1]),
    }


def _converging(values: np.ndarray, share: float, upper: bool, confidence: float) -> dict[str, Any]:
    """A quantile and its interval against the number of flights."""
    counts, sign = _counts(values.size), 1.0 if upper else -1.0
    rows = []
    for count in counts:
        low, high = order_statistic_interval(sign * values[:count], share, confidence)
        value = sign * quantile(sign * values[:count], share)
        rows.append((value, low, high) if upper else (value, -high, -low))
    value, low, high = np.array(rows).reshape(-1, 3).T
    return {
        "share": share,
        "converging": {
            "n": counts.tolist(),
            "value": json_numbers(value),
            "low": json_numbers(low),
            "high": json_numbers(high),
        },
    }


def _distribution(values: np.ndarray, upper: bool) -> dict[str, Any]:
    """Part of the flights (%) that keep each bound; one that failed keeps none."""
    ordered = np.sort(values) if upper else np.sort(values)[::-1]
    shares = 100.0 * np.arange(1, ordered.size + 1) / max(ordered.size, 1)
    known = np.flatnonzero(np.isfinite(ordered))
    if known.size > _STEPS:
        known = known[np.unique(np.linspace(0, known.size - 1, _STEPS).round().astype(int))]
    kept, share = ordered[known], shares[known]
    return {"kept": json_numbers(kept if upper else kept[::-1]), "part": json_numbers(share if upper else share[::-1])}


def _flights(shown: CampaignReport, quantities: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Flights against the inputs; evenly spaced ones where there are too many, half of them such that failed."""
    data, met = shown.dataset, shown.dataset["met"].values
    failed = _spaced(np.flatnonzero(~met), max(_POINTS // 2, _POINTS - int(met.sum())))
    rows = np.sort(np.concatenate([failed, _spaced(np.flatnonzero(met), _POINTS - failed.size)]))
    inputs = []
    for path in shown.varied_paths:
        values = data[path].values[rows]
        levels = None
        if values.dtype.kind not in "fiu":
            levels = [str(one) for one in shown.levels.get(path, ())] or sorted({str(one) for one in values})
            values = np.array([levels.index(str(one)) for one in values.tolist()], dtype=float)
        inputs.append({"path": path, "levels": levels, "values": json_numbers(values)})
    outputs = {
        one["name"]: json_numbers(worst_of_fleet(data, one["name"], upper=one["upper"])[rows]) for one in quantities
    }
    return {
        "inputs": inputs,
        "outputs": outputs,
        "numbers": data["flight"].values[rows].tolist(),
        "failed": (~met[rows]).astype(int).tolist(),
        "drawn": [int(rows.size), int(met.size)],
    }


def _spaced(values: np.ndarray, count: int) -> np.ndarray:
    if values.size <= count:
        return values
    return values[np.linspace(0, values.size - 1, count).round().astype(int)] if count else values[:0]
