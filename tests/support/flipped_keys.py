"""Every key of a scenario with a different value: refused, effective in the flight, or read by another part."""

import math
import typing

from pydantic import BaseModel

from anser.config import ScenarioError
from anser.scenario import Scenario
from anser.scenario.flight_checks import _are_equal, _direct_values, _flight_arrays
from anser.scenario.unused_keys import unused_key_cautions, unused_key_problems

REFUSED, NO_EFFECT_REFUSED, NO_EFFECT_CAUTION, BESIDE, BUILT, NONE, FIXED = (
    "refused",
    "refused as without effect",
    "a caution: without effect",
    "read by planner, loop or verdict",
    "changes the flight as built",
    "accepted without effect",
    "no other value tried",
)


def keys_of(model, table, prefix=""):
    """Path, field and value of the keys of a table and its nested tables; for a list of tables, of the first table."""
    for name, field in model.model_fields.items():
        value = getattr(table, name)
        if isinstance(value, BaseModel):
            yield from keys_of(type(value), value, f"{prefix}{name}.")
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            yield from keys_of(type(value[0]), value[0], f"{prefix}{name}[0].")
        else:
            yield f"{prefix}{name}", field, value


def answers(scenario):
    """Effect of a different value, by the path of the key."""
    answers_by_path, built = {}, _flight_arrays(scenario)
    for path, field, value in keys_of(Scenario, scenario):
        answers_by_path[path] = _answer(scenario, built, path, _others(field, value))
    return answers_by_path


def _answer(scenario, built, path, alternatives):
    """The best answer over the alternative values: an effect before a refusal."""
    answer = FIXED
    for value in alternatives:
        try:
            alternative_scenario = scenario.replace(path, value)
        except ScenarioError:
            answer = REFUSED if answer == FIXED else answer
            continue
        if any(problem.path == path for problem in unused_key_problems(alternative_scenario)):
            return NO_EFFECT_REFUSED
        if any(text.startswith(f"{path}: ") for text in unused_key_cautions(alternative_scenario)):
            return NO_EFFECT_CAUTION
        if _direct_values(scenario) != _direct_values(alternative_scenario):
            return BESIDE
        if not _are_equal(built, _flight_arrays(alternative_scenario)):
            return BUILT
        answer = NONE
    return answer


def _others(field, value):
    """Alternative values of a key."""
    if isinstance(value, bool):
        return [not value]
    choices = [choice for part in (field.annotation, *typing.get_args(field.annotation)) for choice in _literals(part)]
    if choices:
        return [choice for choice in choices if choice != value]
    if isinstance(value, tuple) and value and isinstance(value[0], float):
        return [[0.5 * x for x in value], [1.1 * x + 0.01 for x in value]]
    if "float" not in str(field.annotation) and "int" not in str(field.annotation):
        return []
    low = max(
        (x for x in (getattr(m, k, None) for m in field.metadata for k in ("ge", "gt")) if x is not None), default=-1e4
    )
    high = min(
        (x for x in (getattr(m, k, None) for m in field.metadata for k in ("le", "lt")) if x is not None), default=1e4
    )
    if value is None:
        return [low + 0.3 * (min(high, 1e4) - max(low, -1e4)), 50.0, 60.0, 15.0, 5.0, 1.0, 0.1]
    if isinstance(value, int):
        return [value + 1]
    candidates = [0.95 * value, 1.05 * value, 0.5 * value, 2.0 * value, value + 0.01, value + 1.0]
    return [x for x in candidates if low <= x <= high and x != value and math.isfinite(x)]


def _literals(annotation):
    return typing.get_args(annotation) if typing.get_origin(annotation) is typing.Literal else ()
