"""Sweeps: a scenario flown with every combination of values of some of its keys, as one labelled dataset."""

import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.config.errors import Problem, ScenarioError
from anser.missions.batches import Progress
from anser.missions.flight_batches import FlightCase, fly_many
from anser.results.documents import version_attributes
from anser.results.flight_rows import FLEET_QUANTITIES, FlightRow, tabulate_flights
from anser.results.variable_labels import unit_attributes
from anser.scenario.files import as_scenario
from anser.scenario.flight_checks import refuse_unused_keys
from anser.scenario.schema import Scenario


def sweep_dataset(
    swept: Mapping[str, Sequence[object]],
    aircraft: Sequence[str],
    rows: Sequence[FlightRow],
    attributes: Mapping[str, str | int],
) -> xr.Dataset:
    """Label the flights of a sweep.

    Parameters
    ----------
    swept
        By path, the values put there, in the order in which they vary: the last fastest.
    aircraft
        Names.
    rows
        What came of each flight, in that order.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        One dimension for each path, with its values as coordinate, and `aircraft`; NaN and "no flight" where a flight
        could not begin, with the reason.
    """
    shape = tuple(len(values) for values in swept.values())
    dimensions = tuple(swept)

    data: dict[str, Any] = {
        key: ((*dimensions, *of_one), values.reshape(*shape, *values.shape[1:]), about)
        for key, (of_one, values, about) in tabulate_flights(rows, len(aircraft)).items()
        if key not in FLEET_QUANTITIES or not np.isnan(values).all()
    }
    coordinates: dict[str, Any] = {
        path: (path, _plain(values), unit_attributes("", f"{path} of the scenario")) for path, values in swept.items()
    }
    coordinates["aircraft"] = ("aircraft", np.array(aircraft, dtype=np.str_), {"long_name": "Aircraft"})
    about = {**attributes, "swept": json.dumps(list(swept)), **version_attributes()}
    return xr.Dataset(data, coordinates, about)


def _plain(values: Sequence[object]) -> np.ndarray:
    """Numbers as numbers, truth values as such; all else in words, tables as JSON."""
    if all(isinstance(value, bool) for value in values):
        return np.array(values, dtype=bool)
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=float)
    return np.array([value if isinstance(value, str) else json.dumps(value) for value in values], dtype=np.str_)


_SAID = 5
"""Combinations that are named where several make no valid scenario."""


def sweep(
    scenario: Scenario | str | os.PathLike[str],
    swept: Mapping[str, Sequence[object]],
    progress: Progress | None = None,
) -> "xr.Dataset":
    """Fly a scenario with every combination of values at some of its places.

    All are validated before one flies. They share the scenario's seed: what is random is the same in all, so that
    flights differ by what was swept alone.

    Parameters
    ----------
    scenario
        Validated, from `load`, or the path of its file.
    swept
        By path, as of `Scenario.replace`, the values to be put there: `{"wind.speed_m_s": [0, 5, 10]}`.
    progress
        Called with what is being done and the part of the flights that is behind, 0..1.

    Returns
    -------
    xr.Dataset
        One dimension for each path, named like it, and `aircraft`: arrival times, misses, airspeeds, distances, spread,
        whether every requirement is met, as in `summary.json`; a flight that could not begin has its `reason`.

    Raises
    ------
    ScenarioError
        The file cannot be read or is no valid scenario; a path leads nowhere, or a combination makes no valid scenario
        or another fleet: the message names it.
    ValueError
        Nothing is swept, or a path has no values or one of them twice.
    """
    scenario = as_scenario(scenario)
    scenarios = swept_scenarios(scenario, swept)
    rows = fly_many([FlightCase(one) for one in scenarios], progress)

    attributes = {"title": scenario.name, "scenario_hash": scenario.hash, "scenario": scenario.model_dump_json()}
    names = [one.name for one in scenario.aircraft]
    return sweep_dataset(swept, names, rows, attributes | {"seed": scenario.seed})


def swept_scenarios(scenario: Scenario, swept: Mapping[str, Sequence[object]]) -> list[Scenario]:
    """Scenarios of a sweep, the last path's values fastest; raises as `sweep` does."""
    if not swept:
        raise ValueError("sweep: arrived no path; expected one at least, such as {'wind.speed_m_s': [0, 5, 10]}")
    for path, values in swept.items():
        if isinstance(values, str) or not len(values):
            raise ValueError(f"sweep, {path}: arrived {values!r}; expected a list with one value at least")
        if any(values[k] == other for k in range(len(values)) for other in values[:k]):
            raise ValueError(f"sweep, {path}: arrived a value twice in {list(values)!r}; expected each once")
    made, problems = [], []
    for chosen in itertools.product(*swept.values()):
        given = dict(zip(swept, chosen, strict=True))
        try:
            (path, value), *more = given.items()
            one = scenario.replace(path, value, *itertools.chain(*more))
        except ScenarioError as error:
            problems.append((given, error.problems))
            continue
        if [a.name for a in one.aircraft] != [a.name for a in scenario.aircraft]:
            arrived = ", ".join(a.name for a in one.aircraft)
            expected = "the aircraft of the scenario, as all flights of a sweep have the same fleet"
            problems.append((given, [Problem("aircraft", arrived, expected)]))
            continue
        made.append(one)
    if problems:
        raise _refused(scenario, problems, len(made) + len(problems))
    refuse_unused_keys(f"sweep of {scenario.name}", _first_cases(made, swept))
    return made


def _first_cases(
    scenarios: Sequence[Scenario], swept: Mapping[str, Sequence[object]]
) -> Iterator[tuple[Scenario, dict[str, object]]]:
    """Flights in which each path in turn has its first two values, the others their first."""
    sizes = [len(values) for values in swept.values()]
    strides = [math.prod(sizes[k + 1 :]) for k in range(len(sizes))]
    for number in [0, *(stride for stride, size in zip(strides, sizes, strict=True) if size > 1)]:
        places = [number // stride % size for stride, size in zip(strides, sizes, strict=True)]
        yield (
            scenarios[number],
            {path: values[k] for (path, values), k in zip(swept.items(), places, strict=True)},
        )


def _refused(scenario: Scenario, problems: list, count: int) -> ScenarioError:
    """One message for all combinations that are no scenario: the first few whole, and how many there are."""
    said = []
    for given, found in problems[:_SAID]:
        words = ", ".join(f"{path} = {value}" for path, value in given.items())
        said += [Problem(f"{one.path} (with {words})", one.arrived, one.expected) for one in found]
    more = f" ({len(problems)} of {count} combinations, the first {_SAID} told)" if len(problems) > _SAID else ""
    return ScenarioError(f"sweep of {scenario.name}{more}", said)
