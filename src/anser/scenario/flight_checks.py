"""Checks that need the built flight: starts without steady flight, and keys that a study varies without effect."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from anser.config.errors import Problem, ScenarioError, format_number, format_value
from anser.config.key_paths import indexed_path
from anser.scenario.build import build_flight
from anser.scenario.schema import Scenario
from anser.scenario.unused_keys import find_unused_keys
from anser.simulation.flight import Flight
from anser.steady.trim_diagnosis import nearest_trims


def check_trimmable(scenario: Scenario, flight: Flight, steady: Any, alphas: Sequence[Any]) -> None:
    """Raise ScenarioError if an aircraft has no steady flight (no trim) within its limits at its start.

    `steady` has a flag for each aircraft of the flight: True if a trim exists. `alphas` has the angles of attack of the
    trims, rad, an array for each aircraft group. The message names the violated limits, and for an aircraft without
    trim the nearest conditions with a trim.
    """
    problems = _alpha_problems(scenario, flight, steady, alphas)
    for k in np.flatnonzero(~np.asarray(steady)[: len(scenario.aircraft)]):
        vehicle, target, position_n = flight.aircraft(int(k))
        diagnosis = nearest_trims(vehicle.airframe, flight.environment, target, position_n)
        aircraft, start = scenario.aircraft[k], scenario.aircraft[k].start
        start_condition = (
            f"{start.airspeed_m_s:g} m/s at {start.altitude_m:g} m, path angle {start.path_angle_deg:g} deg"
        )
        nearest = (
            "; ".join(trim.message() for trim in diagnosis.nearest) or "none by speed, path angle or turn rate alone"
        )
        problems.append(
            Problem(
                f"aircraft[{k}].start",
                f"{start_condition}, where no steady flight exists ({'; '.join(diagnosis.violations)})",
                f"a start with steady flight (all else unchanged: {nearest})",
                f'aircraft "{aircraft.name}"',
            )
        )
    if problems:
        raise ScenarioError(scenario.name, problems)


def _alpha_problems(scenario: Scenario, flight: Flight, steady: Any, alphas: Sequence[Any]) -> list[Problem]:
    """Return a problem for each aircraft whose trim has an angle of attack beyond the scenario's limits."""
    trim_alphas_deg = np.zeros(flight.count)
    for group, group_alphas in zip(flight.groups, alphas, strict=True):
        trim_alphas_deg[list(group.members)] = np.degrees(group_alphas)
    problems = []
    for k, aircraft in enumerate(scenario.aircraft):
        alpha_deg, limits = trim_alphas_deg[k], scenario.limits_for(aircraft)
        low, high = limits.alpha_min_deg, limits.alpha_max_deg
        if np.asarray(steady)[k] and not low - _ALPHA_ROUNDING_DEG <= alpha_deg <= high + _ALPHA_ROUNDING_DEG:
            is_low = alpha_deg < low
            key, limit = ("alpha_min_deg", low) if is_low else ("alpha_max_deg", high)
            bound_deg = (math.floor if is_low else math.ceil)(100.0 * alpha_deg) / 100.0
            relation = "most" if is_low else "least"
            expected = f"at {relation} {bound_deg:g} deg, for the angle of attack of steady flight at the start"
            problems.append(Problem(f"limits.{key}", format_number(limit), expected, f'aircraft "{aircraft.name}"'))
    return problems


_ALPHA_ROUNDING_DEG = 1e-6
_DIRECT_TABLES = ("timing", "limits", "arrival", "separation", "requirements", "network", "event")
"""Tables that planner, closed loop or check of requirements read from the scenario itself, not from the flight."""
_DIRECT_AIRCRAFT_KEYS = ("arrive_s", "arrive_from_s", "arrive_to_s")


def refuse_unused_keys(source: str, cases: Iterable[tuple[Scenario, Mapping[str, Any]]]) -> None:
    """Raise ScenarioError if a study varies a key path that has no effect on any of the flights in `cases`.

    `cases` are a few flights of the study: pairs of scenario and values by varied key path. `source` names the study in
    messages. A key path with equal values in all cases is not checked.
    """
    case_list = list(cases)
    problems = []
    for path in dict.fromkeys(path for _, values in case_list for path in values):
        values = [_builtin_value(values[path]) for _, values in case_list]
        alternatives = [next((alternative for alternative in values if alternative != value), None) for value in values]
        pairs = [
            (scenario, value, alternative)
            for (scenario, _), value, alternative in zip(case_list, values, alternatives, strict=True)
            if alternative is not None
        ]
        if pairs and not any(_has_effect(scenario, path, alternative) for scenario, _, alternative in pairs):
            problems.append(_problem(path, *pairs[0]))
    if problems:
        raise ScenarioError(source, problems)


def _has_effect(scenario: Scenario, path: str, value: object) -> bool:
    """Whether `value` at a key path gives another flight than the scenario; an invalid value counts as a change."""
    numbered_path = indexed_path(scenario, path)
    try:
        changed_scenario = scenario.replace(path, value)
        return _differs(scenario, changed_scenario, numbered_path)
    except ScenarioError:
        return True


def _differs(scenario: Scenario, changed_scenario: Scenario, numbered_path: str) -> bool:
    """Whether two scenarios that differ at one key path (list items by index) give different flights."""
    if any(unused_keys.contains(numbered_path) for unused_keys in find_unused_keys(scenario)) and any(
        unused_keys.contains(numbered_path) for unused_keys in find_unused_keys(changed_scenario)
    ):
        return False
    return _direct_values(scenario) != _direct_values(changed_scenario) or not _are_equal(
        _flight_arrays(scenario), _flight_arrays(changed_scenario)
    )


def _direct_values(scenario: Scenario) -> list[Any]:
    """Return the values that planner, closed loop or check of requirements read from the scenario, not the flight."""
    aircraft = [[getattr(aircraft_table, key) for key in _DIRECT_AIRCRAFT_KEYS] for aircraft_table in scenario.aircraft]
    return [*(getattr(scenario, name) for name in _DIRECT_TABLES), aircraft]


def _flight_arrays(scenario: Scenario) -> tuple[Any, list[np.ndarray]]:
    """Build the flight of a scenario; return tree structure and arrays, by which two flights are compared."""
    leaves, structure = jax.tree.flatten(build_flight(scenario))
    return structure, [np.asarray(leaf) for leaf in leaves]


def _are_equal(flight_a: tuple[Any, list[np.ndarray]], flight_b: tuple[Any, list[np.ndarray]]) -> bool:
    return flight_a[0] == flight_b[0] and all(
        a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in zip(flight_a[1], flight_b[1], strict=True)
    )


def _problem(path: str, scenario: Scenario, value: object, alternative: object) -> Problem:
    numbered_path = indexed_path(scenario, path)
    unused_keys = next(
        (unused_keys for unused_keys in find_unused_keys(scenario) if unused_keys.contains(numbered_path)), None
    )
    expected = "a path that changes something in the flight as built" if unused_keys is None else unused_keys.remedy
    cause = "" if unused_keys is None else f" {unused_keys.cause}"
    examples = f"{format_value(value)} and {format_value(alternative)}"
    arrived = f"values such as {examples}, which change nothing in the flight{cause}"
    return Problem(path, arrived, expected)


def _builtin_value(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic | np.ndarray) else value
