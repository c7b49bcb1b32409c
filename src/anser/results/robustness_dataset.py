"""From the flights of a robustness study to a labelled dataset."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.results.envelope_reasons import OUTCOMES, REASONS, Verdicts
from anser.results.flight_variables import add_flights, attributes_of
from anser.results.provenance import versions
from anser.simulation import AUTOPILOT_LIMITS, TABLE_AXES, TRIM_STOPS, FlightSummary, MapPoint


def robustness_dataset(
    inversions: Sequence[str],
    conditions: Sequence[str],
    factors: Mapping[str, tuple[str, str, float, float]],
    parts: Sequence[str],
    cases: Mapping[str, np.ndarray],
    trims: MapPoint,
    summaries: Sequence[FlightSummary],
    verdicts: Sequence[Verdicts],
    attributes: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Label a study.

    Parameters
    ----------
    inversions
        Names, in the order of `summaries` and `verdicts`.
    conditions
        What the flights left.
    factors
        Meaning, unit, nominal value, and what a change of 1 adds, by name of what is dispersed.
    parts
        Names of the parts of a study.
    cases
        Of each flight its `part`, `condition` and `alone` (indices; -1 for none), its `spread`, and the `values` of all
        factors, shape (flights, factors).
    trims
        Steady flight of each truth.
    summaries, verdicts
        Of the flights from those truths that have one, in order.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        Over (flight,) what was dispersed, over (inversion, flight) what came of it; NaN and outcome 0 where the truth
        has no steady flight.
    """
    steady = np.asarray(trims.trimmable)
    stop = np.where(steady, 0, 1 + np.asarray(trims.stopped_by).argmax(axis=1)).astype(np.int32)
    data: dict[str, Any] = {
        "part": ("flight", cases["part"].astype(np.int32), _flags("Part of the study", parts)),
        "condition": ("flight", cases["condition"].astype(np.int32), _flags("Steady flight that is left", conditions)),
        "spread_percent": (
            "flight",
            100.0 * cases["spread"],
            attributes_of("percent", "Greatest change, or the only one"),
        ),
        "alone": (
            "flight",
            cases["alone"].astype(np.int32),
            attributes_of("1", "Index of the only factor that is changed; -1: all are"),
        ),
        "factor_value": (
            ("flight", "factor"),
            cases["values"],
            attributes_of("1", "Value of what is dispersed (factor_unit)"),
        ),
        "trim_stop": ("flight", stop, _flags("What stops the steady flight", ("none", *TRIM_STOPS))),
    }
    columns: list[dict[str, tuple[np.ndarray, dict[str, Any], tuple[str, ...]]]] = []
    for summary, verdict in zip(summaries, verdicts, strict=True):
        found: dict[str, tuple[np.ndarray, dict[str, Any], tuple[str, ...]]] = {}

        def add(name: str, values: Any, unit: str, words: str, over: str | None = None, found: dict = found) -> None:
            array = np.asarray(values)
            full = np.full((len(steady), *array.shape[1:]), 0 if array.dtype.kind == "i" else np.nan, array.dtype)
            full[steady] = array
            found[name] = (full, attributes_of(unit, words), () if over is None else (over,))

        add_flights(add, summary)
        add("outcome", verdict.outcome, "1", "What became of the flight")
        add("reason", verdict.reason, "1", "Limit that stood in the way")
        columns.append(found)
    for name, (_, labels, over) in columns[0].items():
        data[name] = (("inversion", "flight", *over), np.stack([found[name][0] for found in columns]), labels)
    for name, meanings in (("outcome", OUTCOMES), ("reason", REASONS)):
        data[name][2].update(_flags(data[name][2]["long_name"], meanings))
    number = {name: np.array([of[k] for of in factors.values()]) for k, name in ((2, "nominal"), (3, "scale"))}
    coordinates: dict[str, Any] = {
        "inversion": ("inversion", np.array(inversions), attributes_of("", "What the autopilot inverts")),
        "factor": ("factor", np.array(list(factors)), attributes_of("", "What is dispersed")),
        "factor_meaning": ("factor", np.array([of[0] for of in factors.values()])),
        "factor_unit": ("factor", np.array([of[1] for of in factors.values()])),
        "factor_nominal": ("factor", number["nominal"], attributes_of("1", "Value without a change (factor_unit)")),
        "factor_scale": ("factor", number["scale"], attributes_of("1", "What a change of 100 % adds (factor_unit)")),
        "condition_meaning": ("place", np.array(conditions)),
        "surface": ("surface", np.array(("elevator", "aileron", "rudder"))),
        "axis": ("axis", np.array(("roll", "pitch", "yaw"))),
        "limit": ("limit", np.array(AUTOPILOT_LIMITS)),
        "table": ("table", np.array(TABLE_AXES)),
    }
    of = {**attributes, **{f"version_{name}": version for name, version in versions().items()}}
    return xr.Dataset(data, coordinates, of)


def _flags(words: str, meanings: Sequence[str]) -> dict[str, Any]:
    """Labels of an index; blanks of a meaning become underscores, as the meanings stand in one line."""
    values = np.arange(len(meanings), dtype=np.int32)
    names = " ".join(meaning.replace(", ", ",").replace(" ", "_") for meaning in meanings)
    return {**attributes_of("1", words), "flag_values": values, "flag_meanings": names}
