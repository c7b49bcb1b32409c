"""From the flights of a robustness study to a labelled dataset."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.results.envelope_reasons import Verdicts
from anser.results.flight_variables import flight_axes, flight_variables
from anser.results.provenance import version_attributes
from anser.results.variable_labels import attributes_of, flags_of, scattered
from anser.simulation import TRIM_STOPS, FlightSummary, MapPoint


def robustness_dataset(
    inversions: Sequence[str],
    conditions: Sequence[str],
    factors: Mapping[str, tuple[str, str, float, float]],
    parts: Sequence[str],
    cases: Mapping[str, np.ndarray],
    trims: MapPoint,
    summaries: Sequence[FlightSummary],
    verdicts: Sequence[Verdicts],
    surfaces: Sequence[str],
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
    surfaces
        Names of the airframe's control surfaces.
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
    spread = attributes_of("percent", "Greatest change, or the only one")
    alone = attributes_of("1", "Index of the only factor that is changed; -1: all are")
    values = attributes_of("1", "Value of what is dispersed (factor_unit)")
    data: dict[str, Any] = {
        "part": ("flight", cases["part"].astype(np.int32), flags_of("Part of the study", parts)),
        "condition": (
            "flight",
            cases["condition"].astype(np.int32),
            flags_of("Steady flight that is left", conditions),
        ),
        "spread_percent": ("flight", 100.0 * cases["spread"], spread),
        "alone": ("flight", cases["alone"].astype(np.int32), alone),
        "factor_value": (("flight", "factor"), cases["values"], values),
        "trim_stop": ("flight", stop, flags_of("What stops the steady flight", ("none", *TRIM_STOPS))),
    }
    columns = [flight_variables(*of) for of in zip(summaries, verdicts, strict=True)]
    for name, (_, labels, over) in columns[0].items():
        both = np.stack([scattered(found[name][0], steady) for found in columns])
        data[name] = (("inversion", "flight", *over), both, labels)
    meaning, unit, nominal, scale = (np.array(column) for column in zip(*factors.values(), strict=True))
    coordinates: dict[str, Any] = {
        "inversion": ("inversion", np.array(inversions), attributes_of("", "What the autopilot inverts")),
        "factor": ("factor", np.array(list(factors)), attributes_of("", "What is dispersed")),
        "factor_meaning": ("factor", meaning),
        "factor_unit": ("factor", unit),
        "factor_nominal": ("factor", nominal, attributes_of("1", "Value without a change (factor_unit)")),
        "factor_scale": ("factor", scale, attributes_of("1", "What a change of 100 % adds (factor_unit)")),
        "condition_meaning": ("place", np.array(conditions)),
        **flight_axes(surfaces),
    }
    return xr.Dataset(data, coordinates, {**attributes, **version_attributes()})
