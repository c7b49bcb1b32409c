"""Sweeps: flights of a scenario with every combination of values of some keys, as one labelled dataset."""

import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.config.errors import Problem, ScenarioError
from anser.config.key_paths import repeated_paths
from anser.missions.batches import Progress
from anser.missions.flight_batches import FlightCase, fly_many
from anser.results.documents import version_attributes
from anser.results.flight_rows import FLEET_QUANTITIES, FlightRow, tabulate_flights
from anser.results.variable_labels import unit_attributes
from anser.scenario.build_wind_field import check_wind_field
from anser.scenario.files import as_scenario
from anser.scenario.flight_checks import refuse_unused_keys
from anser.scenario.schema import Scenario
from anser.scenario.user_parts import UserParts, attach_parts


def sweep_dataset(
    swept: Mapping[str, Sequence[object]],  # values by scenario path; the values of the last path vary fastest
    aircraft: Sequence[str],
    flight_rows: Sequence[FlightRow],  # results of the flights, in the order of the combinations
    attributes: Mapping[str, str | int],  # attributes of the dataset
) -> xr.Dataset:
    """Put the results of a sweep's flights into one dataset with a dimension and a coordinate for each swept key.

    The numbers of a flight that could not start are NaN, and `reason` has the reason. A quantity of the fleet is left
    out if every flight lacks a value.
    """
    shape = tuple(len(values) for values in swept.values())
    dimensions = tuple(swept)

    data: dict[str, Any] = {
        key: ((*dimensions, *flight_dimensions), values.reshape(*shape, *values.shape[1:]), variable_attributes)
        for key, (flight_dimensions, values, variable_attributes) in tabulate_flights(
            flight_rows, len(aircraft)
        ).items()
        if key not in FLEET_QUANTITIES or not np.isnan(values).all()
    }
    coordinates: dict[str, Any] = {
        path: (path, _coordinate_values(values), unit_attributes("", f"{path} of the scenario"))
        for path, values in swept.items()
    }
    coordinates["aircraft"] = ("aircraft", np.array(aircraft, dtype=np.str_), {"long_name": "Aircraft"})
    variable_attributes = {**attributes, "swept": json.dumps(list(swept)), **version_attributes()}
    return xr.Dataset(data, coordinates, variable_attributes)


def _coordinate_values(values: Sequence[object]) -> np.ndarray:
    """Return an array of booleans, of numbers (float64) or of texts; among texts, other values as JSON texts."""
    values = [value.item() if isinstance(value, np.generic) else value for value in values]
    if all(isinstance(value, bool) for value in values):
        return np.array(values, dtype=bool)
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=float)
    return np.array([value if isinstance(value, str) else json.dumps(value) for value in values], dtype=np.str_)


_MESSAGES_MAX = 5
"""Greatest number of invalid combinations in a message."""


def sweep(
    scenario: Scenario | str | os.PathLike[str],
    swept: Mapping[str, Sequence[object]],
    progress: Progress | None = None,
    **user_parts: Any,
) -> "xr.Dataset":
    """Fly a scenario with every combination of values of some of its keys.

    All combinations are validated before the first flight. The flights share the scenario's seed and thus the random
    numbers, and differ only by the swept values.

    Parameters
    ----------
    scenario
        From `load`, or the path of a scenario file.
    swept
        Values by path, as in `Scenario.replace`: `{"wind.speed_m_s": [0, 5, 10]}`.
    progress
        Called with a description of the current work and the share of finished flights, 0..1.
    **user_parts
        User-defined parts: `controller`, `guidance`, `sensors`, `estimator`, `planner`, as for `anser.run`.

    Returns
    -------
    xr.Dataset
        One dimension for each path, with the name of the path, and `aircraft`. Variables as in `summary.json`: arrival
        times, miss distances, airspeeds, distances, spread, and whether every requirement is met. A flight that could
        not start has a `reason`.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is not a valid scenario, a path does not exist, or a combination is not a valid
        scenario or has another fleet; the message names the combination.
    ValueError
        If `swept` is empty, or a path has no values or duplicate values.
    """
    scenario = attach_parts(as_scenario(scenario), UserParts(**user_parts))
    scenarios = swept_scenarios(scenario, swept)
    flight_rows = fly_many([FlightCase(variant) for variant in scenarios], progress)

    attributes = {
        "title": scenario.name,
        "scenario_hash": scenario.hash,
        "scenario": scenario.model_dump_json(),
        "scenario_written": scenario.model_dump_json(exclude_unset=True),
    }
    names = [aircraft.name for aircraft in scenario.aircraft]
    return sweep_dataset(swept, names, flight_rows, attributes | {"seed": scenario.seed})


def swept_scenarios(scenario: Scenario, swept: Mapping[str, Sequence[object]]) -> list[Scenario]:
    """Return the scenarios of a sweep, one for each combination of values; the value of the last path changes fastest.

    Raises ScenarioError and ValueError as `sweep` does.
    """
    if not swept:
        raise ValueError("sweep: arrived no path; expected one at least, such as {'wind.speed_m_s': [0, 5, 10]}")
    for path, values in swept.items():
        if isinstance(values, str) or not hasattr(values, "__getitem__") or not len(values):
            raise ValueError(f"sweep, {path}: arrived {values!r}; expected a list with one value at least")
        if any(values[k] == earlier for k in range(len(values)) for earlier in values[:k]):
            raise ValueError(f"sweep, {path}: arrived a value twice in {list(values)!r}; expected each once")
    if repeated := repeated_paths(scenario, swept):
        raise ValueError(f"sweep, {repeated[1]}: arrived the key of {repeated[0]} again; expected each key once")
    scenarios, problems = [], []
    for values_by_path in itertools.product(*swept.values()):
        combination = dict(zip(swept, values_by_path, strict=True))
        try:
            changes: list[Any] = list(itertools.chain(*combination.items()))
            variant = scenario.replace(*changes)
            check_wind_field(variant)
        except ScenarioError as error:
            problems.append((combination, error.problems))
            continue
        if [aircraft.name for aircraft in variant.aircraft] != [aircraft.name for aircraft in scenario.aircraft]:
            received = ", ".join(aircraft.name for aircraft in variant.aircraft)
            expected = "the aircraft of the scenario, as all flights of a sweep have the same fleet"
            problems.append((combination, [Problem("aircraft", received, expected)]))
            continue
        scenarios.append(variant)
    if problems:
        raise _refused(scenario, problems, len(scenarios) + len(problems))
    refuse_unused_keys(f"sweep of {scenario.name}", _first_cases(scenarios, swept))
    return scenarios


def _first_cases(
    scenarios: Sequence[Scenario], swept: Mapping[str, Sequence[object]]
) -> Iterator[tuple[Scenario, dict[str, object]]]:
    """Yield a few combinations for a first check, each as the scenario and the values by path.

    The first combination has the first value of every path; each other combination has the second value of one path.
    """
    sizes = [len(values) for values in swept.values()]
    strides = [math.prod(sizes[k + 1 :]) for k in range(len(sizes))]
    for index in [0, *(stride for stride, size in zip(strides, sizes, strict=True) if size > 1)]:
        indices = [index // stride % size for stride, size in zip(strides, sizes, strict=True)]
        yield (
            scenarios[index],
            {path: values[k] for (path, values), k in zip(swept.items(), indices, strict=True)},
        )


def _refused(scenario: Scenario, problems: list, count: int) -> ScenarioError:
    """Return one error with the problems of at most `_MESSAGES_MAX` invalid combinations.

    `problems` are pairs (values by path, problems); `count` is the number of all combinations.
    """
    messages = []
    for combination, combination_problems in problems[:_MESSAGES_MAX]:
        assignments = ", ".join(f"{path} = {value}" for path, value in combination.items())
        messages += [Problem(f"{p.path} (with {assignments})", p.arrived, p.expected) for p in combination_problems]
    suffix = (
        f" ({len(problems)} of {count} combinations, the first {_MESSAGES_MAX} told)"
        if len(problems) > _MESSAGES_MAX
        else ""
    )
    return ScenarioError(f"sweep of {scenario.name}{suffix}", messages)
