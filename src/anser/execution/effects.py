"""Whether a varied path has an effect: the flight as it is built, and all that is read beside it, with two values."""

from collections.abc import Iterable, Mapping
from typing import Any

import jax
import numpy as np

from anser.scenario import Problem, Scenario, ScenarioError, build_flight
from anser.scenario.errors import plain, show
from anser.scenario.no_effect import idle_keys
from anser.scenario.replacing import numbered_path

_BESIDE = ("timing", "limits", "arrival", "separation", "requirements", "network", "event")
"""Tables that planner, closed loop and verdict read from the scenario itself."""
_OF_AIRCRAFT = ("arrive_s", "arrive_from_s", "arrive_to_s")


def refuse_without_effect(source: str, cases: Iterable[tuple[Scenario, Mapping[str, Any]]]) -> None:
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
    number = numbered_path(scenario, path)
    try:
        other = scenario.replace(path, value)
        return _differs(scenario, other, number)
    except ScenarioError:
        return True


def _differs(scenario: Scenario, other: Scenario, number: str) -> bool:
    """Whether two scenarios that differ at a numbered path make different flights."""
    if any(idle.contains(number) for idle in idle_keys(scenario)) and any(
        idle.contains(number) for idle in idle_keys(other)
    ):
        return False
    return _beside(scenario) != _beside(other) or not _is_same(_built(scenario), _built(other))


def _beside(scenario: Scenario) -> list[Any]:
    """What is read from the scenario itself."""
    aircraft = [[getattr(one, key) for key in _OF_AIRCRAFT] for one in scenario.aircraft]
    return [*(getattr(scenario, name) for name in _BESIDE), aircraft]


def _built(scenario: Scenario) -> tuple[Any, list[np.ndarray]]:
    """Structure and numbers of the flight as built."""
    leaves, structure = jax.tree.flatten(build_flight(scenario))
    return structure, [np.asarray(leaf) for leaf in leaves]


def _is_same(one: tuple[Any, list[np.ndarray]], other: tuple[Any, list[np.ndarray]]) -> bool:
    return one[0] == other[0] and all(
        a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in zip(one[1], other[1], strict=True)
    )


def _problem(path: str, scenario: Scenario, value: object, other: object) -> Problem:
    number = numbered_path(scenario, path)
    idle = next((idle for idle in idle_keys(scenario) if idle.contains(number)), None)
    words = "a path that changes something in the flight as built" if idle is None else idle.remedy
    cause = "" if idle is None else f" {idle.cause}"
    arrived = f"values such as {_shown(value)} and {_shown(other)}, which change nothing in the flight{cause}"
    return Problem(path, arrived, words)


def _shown(value: object) -> str:
    return plain(value) if isinstance(value, float) else show(value)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic | np.ndarray) else value
