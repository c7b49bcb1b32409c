"""Checks of a scenario that need its built flight: starts without steady flight, and varied keys without effect."""

from collections.abc import Iterable, Mapping
from typing import Any

import jax
import numpy as np

from anser.config.errors import Problem, ScenarioError, describe_value, format_number
from anser.config.key_paths import indexed_path
from anser.scenario.build import build_flight
from anser.scenario.schema import Scenario
from anser.scenario.unused_keys import find_unused_keys
from anser.simulation.flight import Flight
from anser.steady.trim_diagnosis import nearest_trims


def check_trimmable(scenario: Scenario, flight: Flight, steady: Any) -> None:
    """Refuse starts without steady flight: say which limit stops it and where the nearest trim points are.

    Parameters
    ----------
    scenario, flight
        What is to be flown.
    steady
        Whether each aircraft of the flight has one, as `TrimmedFleet` says; those that only fill the fleet up too.
    """
    problems = []
    for k in np.flatnonzero(~np.asarray(steady)[: len(scenario.aircraft)]):
        vehicle, target, _ = flight.aircraft(int(k))
        found = nearest_trims(vehicle.airframe, flight.environment, target)
        aircraft, start = scenario.aircraft[k], scenario.aircraft[k].start
        asked = f"{start.speed_m_s:g} m/s at {start.altitude_m:g} m, path angle {start.path_angle_deg:g} deg"
        nearest = "; ".join(near.message() for near in found.nearest) or "none by speed, path angle or turn rate alone"
        problems.append(
            Problem(
                f"aircraft[{k}].start",
                f"{asked}, where no steady flight exists ({'; '.join(found.violations)})",
                f"a start with steady flight (all else unchanged: {nearest})",
                f'aircraft "{aircraft.name}"',
            )
        )
    if problems:
        raise ScenarioError(scenario.name, problems)


_DIRECT_TABLES = ("timing", "limits", "arrival", "separation", "requirements", "network", "event")
"""Tables that planner, closed loop and verdict read from the scenario itself."""
_DIRECT_AIRCRAFT_KEYS = ("arrive_s", "arrive_from_s", "arrive_to_s")


def refuse_unused_keys(source: str, cases: Iterable[tuple[Scenario, Mapping[str, Any]]]) -> None:
    """Refuse paths that are varied and change nothing.

    Parameters
    ----------
    source
        What varies them, in messages.
    cases
        A few flights with the values that were put into each, by path.

    Raises
    ------
    ScenarioError
        A path has no effect in any of them.
    """
    tried = list(cases)
    problems = []
    for path in dict.fromkeys(path for _, values in tried for path in values):
        values = [_plain(values[path]) for _, values in tried]
        others = [next((other for other in values if other != value), None) for value in values]
        pairs = [
            (scenario, value, other)
            for (scenario, _), value, other in zip(tried, values, others, strict=True)
            if other is not None
        ]
        if pairs and not any(_has_effect(scenario, path, other) for scenario, _, other in pairs):
            problems.append(_problem(path, *pairs[0]))
    if problems:
        raise ScenarioError(source, problems)


def _has_effect(scenario: Scenario, path: str, value: object) -> bool:
    """Whether another value at a path changes a flight; a value with which there is none does."""
    number = indexed_path(scenario, path)
    try:
        other = scenario.replace(path, value)
        return _differs(scenario, other, number)
    except ScenarioError:
        return True


def _differs(scenario: Scenario, other: Scenario, number: str) -> bool:
    """Whether two scenarios that differ at a numbered path make different flights."""
    if any(idle.contains(number) for idle in find_unused_keys(scenario)) and any(
        idle.contains(number) for idle in find_unused_keys(other)
    ):
        return False
    return _direct_values(scenario) != _direct_values(other) or not _is_same(
        _flight_arrays(scenario), _flight_arrays(other)
    )


def _direct_values(scenario: Scenario) -> list[Any]:
    """What is read from the scenario itself."""
    aircraft = [[getattr(one, key) for key in _DIRECT_AIRCRAFT_KEYS] for one in scenario.aircraft]
    return [*(getattr(scenario, name) for name in _DIRECT_TABLES), aircraft]


def _flight_arrays(scenario: Scenario) -> tuple[Any, list[np.ndarray]]:
    """Structure and numbers of the flight as built."""
    leaves, structure = jax.tree.flatten(build_flight(scenario))
    return structure, [np.asarray(leaf) for leaf in leaves]


def _is_same(one: tuple[Any, list[np.ndarray]], other: tuple[Any, list[np.ndarray]]) -> bool:
    return one[0] == other[0] and all(
        a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in zip(one[1], other[1], strict=True)
    )


def _problem(path: str, scenario: Scenario, value: object, other: object) -> Problem:
    number = indexed_path(scenario, path)
    idle = next((idle for idle in find_unused_keys(scenario) if idle.contains(number)), None)
    words = "a path that changes something in the flight as built" if idle is None else idle.remedy
    cause = "" if idle is None else f" {idle.cause}"
    arrived = f"values such as {_shown(value)} and {_shown(other)}, which change nothing in the flight{cause}"
    return Problem(path, arrived, words)


def _shown(value: object) -> str:
    return format_number(value) if isinstance(value, float) else describe_value(value)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic | np.ndarray) else value
