"""Content of the report page of a campaign, and its conversion to plain data for JSON."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import evenly_spaced
from anser.report.labels import printed_unit
from anser.results.flight_rows import worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, quantile, wilson_interval


def json_numbers(values: np.ndarray) -> list[float | None]:
    """Return values as a list for JSON, rounded to nine significant digits; None for NaN or infinity."""
    return [float(f"{value:.9g}") if np.isfinite(value) else None for value in np.asarray(values, dtype=float)]


@dataclass(frozen=True)
class SeriesBands:
    """Quantiles of one recorded variable over flights of a campaign, for a selection of times and aircraft."""

    name: str
    long_name: str
    unit: str  # of the quantiles
    times_s: np.ndarray
    aircraft: tuple[str, ...]  # names
    quantiles: np.ndarray  # 5, 50 and 95 % quantiles; shape (3, aircraft, times); NaN if no flight has a finite value


def series_data(bands: "tuple[SeriesBands, ...]") -> list[dict[str, Any]]:
    """Return `bands` as plain data for JSON, an entry per variable."""
    return [
        {
            "name": band.name,
            "words": band.long_name,
            "unit": band.unit,
            "time": json_numbers(band.times_s),
            "aircraft": [
                {
                    "name": name,
                    **{end: json_numbers(band.quantiles[q, k]) for q, end in enumerate(("low", "middle", "high"))},
                }
                for k, name in enumerate(band.aircraft)
            ],
        }
        for band in bands
    ]


_CONVERGENCE_POINTS_MAX = 100
"""Greatest number of points of a curve that shows how an estimate converges with the number of flights."""
_DISTRIBUTION_POINTS_MAX = 1500
"""Greatest number of points of a cumulative distribution."""
_SCATTER_POINTS_MAX = 4000
"""Greatest number of flights plotted against the inputs."""


@dataclass(frozen=True)
class ReplayedFlight:
    """A flight of a campaign that was simulated again for the report's map."""

    number: int  # number of the flight in the campaign
    worst: bool  # True: one of the worst flights; False: drawn in the background
    tracks: xr.Dataset  # positions of the aircraft, in the format of `flight.nc`


@dataclass(frozen=True)
class CampaignReport:
    """Content of the report page of a campaign."""

    dataset: xr.Dataset  # dataset of a `CampaignStore`
    estimates: Mapping[str, Any]  # estimates of the campaign as a dictionary
    influences: Mapping[str, Any]  # `Influences.as_dict` of the campaign
    study: Mapping[str, Any]  # study file as plain data
    folder: str  # campaign's folder as the user entered it
    independent: np.ndarray  # mask of the statistically independent flights, shape (flights,)
    worst: Sequence[int]  # numbers of the worst flights
    is_converged: bool = False  # True: the stopping rule ended the campaign early
    levels: Mapping[str, Sequence[str]] = field(default_factory=dict)  # ordered values of text inputs, by key path
    replays: Sequence[ReplayedFlight] = ()  # flights on the map
    replay_differences: Sequence[int] = ()  # numbers of the replayed flights with results that differ from the campaign
    bands: tuple[SeriesBands, ...] = ()  # quantiles of the variables recorded over time

    @property
    def varied_paths(self) -> list[str]:
        """Key paths, in the scenario, of the inputs that the study varies."""
        return json.loads(self.dataset.attrs["varied"])


def campaign_data(report: CampaignReport) -> dict[str, Any]:
    """Return the data that the report page plots, for JSON: estimates, distributions, time series, flights."""
    independent_flights = report.dataset.isel(flight=np.flatnonzero(report.independent))
    confidence = float(report.estimates["confidence"])
    quantities: dict[str, dict[str, Any]] = {}
    for estimate in report.estimates["quantiles"]:
        name, upper = estimate["name"], estimate["upper"]
        if name not in quantities:
            values = worst_of_fleet(independent_flights, name, upper=upper)
            share = _share_to_plot([other for other in report.estimates["quantiles"] if other["name"] == name])
            quantities[name] = {
                **{key: estimate[key] for key in ("name", "words", "upper")},
                "unit": printed_unit(estimate["unit"]),
                **_distribution(values, upper),
                **_quantile_convergence(values, share, upper, confidence),
            }
        quantities[name].setdefault("quantiles", []).append(
            {key: estimate[key] for key in ("share", "value", "low", "high")}
        )
    return {
        "confidence": confidence,
        "met": _curve(**success_convergence(independent_flights["met"].values, confidence, _CONVERGENCE_POINTS_MAX)),
        "quantities": list(quantities.values()),
        "series": series_data(report.bands),
        **_flights(report, list(quantities.values())),
    }


def _share_to_plot(quantiles: Sequence[Mapping[str, Any]]) -> float:
    """Return the quantile probability nearest to 0.95; quantiles with a finite value have priority."""
    bounded_shares = [estimate["share"] for estimate in quantiles if estimate["value"] is not None]
    return min(bounded_shares or [estimate["share"] for estimate in quantiles], key=lambda share: abs(share - 0.95))


def _counts(size: int, points: int) -> np.ndarray:
    """Return at most `points` numbers of flights, from 1 to `size`, for a convergence curve."""
    return np.unique(np.linspace(1, size, min(size, points)).round().astype(int)) if size else np.empty(0, int)


def success_convergence(succeeded: np.ndarray, confidence: float, points: int) -> dict[str, np.ndarray]:
    """Compute the success rate and its Wilson confidence interval for growing numbers of flights.

    Returns arrays of at most `points` entries:

    - `n`: number of flights
    - `value`: success rate of the first n flights, %
    - `low`, `high`: bounds of the confidence interval of the rate, %
    """
    counts = _counts(succeeded.size, points)
    successes = np.cumsum(succeeded)[counts - 1] if succeeded.size else counts
    pairs = zip(successes.tolist(), counts.tolist(), strict=True)
    intervals = 100 * np.array([wilson_interval(*pair, confidence) for pair in pairs]).reshape(-1, 2)
    return {"n": counts, "value": 100.0 * successes / counts, "low": intervals[:, 0], "high": intervals[:, 1]}


def _curve(n: np.ndarray, **columns: np.ndarray) -> dict[str, list[float | None]]:
    return {"n": n.tolist()} | {name: json_numbers(values) for name, values in columns.items()}


def _quantile_convergence(values: np.ndarray, share: float, upper: bool, confidence: float) -> dict[str, Any]:
    counts, sign = _counts(values.size, _CONVERGENCE_POINTS_MAX), 1.0 if upper else -1.0
    estimates = []
    for count in counts:
        low, high = order_statistic_interval(sign * values[:count], share, confidence)
        value = sign * quantile(sign * values[:count], share)
        estimates.append((value, low, high) if upper else (value, -high, -low))
    value, low, high = np.array(estimates).reshape(-1, 3).T
    return {"share": share, "converging": _curve(counts, value=value, low=low, high=high)}


def _distribution(values: np.ndarray, upper: bool) -> dict[str, Any]:
    """Return the distribution of `values` for a plot: increasing bounds, `kept`, and % of flights within each, `part`.

    A flight is within a bound if its value is at most the bound (`upper` True) or at least the bound (False). Infinite
    values, of failed flights, are within no bound.
    """
    ordered = np.sort(values) if upper else np.sort(values)[::-1]
    shares = 100.0 * np.arange(1, ordered.size + 1) / max(ordered.size, 1)
    finite = evenly_spaced(np.flatnonzero(np.isfinite(ordered)), _DISTRIBUTION_POINTS_MAX)
    bounds, share = ordered[finite], shares[finite]
    return {
        "kept": json_numbers(bounds if upper else bounds[::-1]),
        "part": json_numbers(share if upper else share[::-1]),
    }


def _flights(report: CampaignReport, quantities: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return inputs, outputs and numbers of the flights for scatter plots of the `quantities` over the inputs.

    More than `_SCATTER_POINTS_MAX` flights are reduced to a selection, of which at least half is reserved for failed
    flights; other flights fill the rest. `drawn` is [number of selected flights, number of all flights].
    """
    data, succeeded = report.dataset, report.dataset["met"].values
    failed_max = max(_SCATTER_POINTS_MAX // 2, _SCATTER_POINTS_MAX - int(succeeded.sum()))
    failed = evenly_spaced(np.flatnonzero(~succeeded), failed_max)
    good = evenly_spaced(np.flatnonzero(succeeded), _SCATTER_POINTS_MAX - failed.size)
    selected = np.sort(np.concatenate([failed, good]))
    inputs = []
    for path in report.varied_paths:
        values = data[path].values[selected]
        levels = None
        if values.dtype.kind not in "fiu":
            levels = [str(entry) for entry in report.levels.get(path, ())] or sorted({str(entry) for entry in values})
            values = np.array([levels.index(str(entry)) for entry in values.tolist()], dtype=float)
        inputs.append({"path": path, "levels": levels, "values": json_numbers(values)})
    outputs = {
        entry["name"]: json_numbers(worst_of_fleet(data, entry["name"], upper=entry["upper"])[selected])
        for entry in quantities
    }
    return {
        "inputs": inputs,
        "outputs": outputs,
        "numbers": data["flight"].values[selected].tolist(),
        "failed": (~succeeded[selected]).astype(int).tolist(),
        "drawn": [int(selected.size), int(succeeded.size)],
    }
