"""Conversion of Pydantic's validation errors to messages with key path, value and expected value.

If a value has another unit or is a compass point, the message gives the number to write.
"""

import difflib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from anser.config.errors import Problem, ScenarioError, describe_value
from anser.config.tables import literal_options
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.units import DEG_RAD, FOOT_M, FOOT_PER_MINUTE_M_S, KNOT_M_S, NAUTICAL_MILE_M, POUND_KG, SLUG_KG

_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\D.*?)?\s*")
_MILE_M = 5280.0 * FOOT_M
_UNITS = {
    "length": {"m": 1.0, "km": 1e3, "ft": FOOT_M, "nmi": NAUTICAL_MILE_M, "nm": NAUTICAL_MILE_M, "mi": _MILE_M},
    "speed": {
        "m/s": 1.0,
        "km/h": 1.0 / 3.6,
        "kph": 1.0 / 3.6,
        "mph": _MILE_M / 3600.0,
        "ft/s": FOOT_M,
        **dict.fromkeys(("kt", "kts", "kn", "knot", "knots"), KNOT_M_S),
        **dict.fromkeys(("fpm", "ft/min"), FOOT_PER_MINUTE_M_S),
    },
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "angle": {"deg": DEG_RAD, "\N{DEGREE SIGN}": DEG_RAD, "rad": 1.0, "mrad": 1e-3},
    "rate": {"deg/s": DEG_RAD, "rad/s": 1.0},
    "acceleration": {"m/s^2": 1.0, "m/s2": 1.0, "ft/s^2": FOOT_M, "g": STANDARD_GRAVITY_M_S2},
    "mass": {"kg": 1.0, "lb": POUND_KG, "slug": SLUG_KG},
}
"""Factors from units (in lower case) to SI units, by dimension."""

_POINTS = ("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW")
"""Compass points in steps of 22.5 deg, clockwise from north."""


def conversion_hint(text: str, unit: str) -> str:
    """Return a hint with the number to write for a text such as "9 kt": `; 9 kt is 4.63 m/s: write 4.63`.

    `unit` is the unit of the key; empty for a dimensionless number. The hint is empty if the text is unclear or has an
    unknown unit.
    """
    match = _NUMBER_AND_UNIT.fullmatch(text)
    if match is None:
        point = text.strip()
        if unit != "deg" or point.upper() not in _POINTS:
            return ""
        angle = f"{22.5 * _POINTS.index(point.upper()):g}"
        return f"; {point} is {angle} deg clockwise from north: write {angle}"
    number, written_unit = match.groups()
    if written_unit is None or written_unit.lower() == unit.lower():
        return f"; write {number}, without quotes"
    for factors in _UNITS.values():
        if written_unit.lower() in factors and unit in factors:
            converted = f"{float(number) * factors[written_unit.lower()] / factors[unit]:.6g}"
            return f"; {number} {written_unit} is {converted} {unit}: write {converted}"
    return ""


_ABSENT = object()
_OTHER_NAMES = {
    "std": "sigma",
    "stddev": "sigma",
    "standard_deviation": "sigma",
    "min": "low",
    "minimum": "low",
    "max": "high",
    "maximum": "high",
}
"""Keys of anser files, by names (in lower case) that users write instead."""
_BARE_KEY = re.compile(r"^[A-Za-z0-9_-]+\Z")


def validation_problems(error: ValidationError, model: type[BaseModel], raw: object) -> list[Problem]:
    """Return the problems of a failed validation, in the order of the schema; `raw` are the values of the whole file.

    A required key that is misspelled in the file is reported once, as an unknown key.
    """
    problems: list[Problem] = []
    misspelled_keys: set[str] = set()
    details = error.errors(include_url=False)
    for detail in details:
        loc, kind = detail["loc"], detail["type"]
        if kind == "too_short" and any(inner["loc"][: len(loc)] == loc != inner["loc"] for inner in details):
            continue  # pydantic counts only the valid items: the list is long enough, its items are wrong
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, ScenarioError):
            problems.extend(_with_table_path(loc, problem, raw) for problem in cause.problems)
        elif kind == "extra_forbidden":
            problem, meant = _unknown_key(loc, model, raw)
            problems.append(problem)
            misspelled_keys.add(meant)
        else:
            problems.append(_bad_value(loc, model, raw))
    reported = [
        problem for problem in problems if not (problem.path in misspelled_keys and problem.arrived == "nothing")
    ]
    return list(dict.fromkeys(reported))


def _with_table_path(loc: Sequence[str | int], problem: Problem, raw: object) -> Problem:
    """Return a problem with its path in the file; the original path is relative to the table at the location `loc`."""
    if not loc:
        return problem
    path = f"{_path(loc)}.{problem.path}" if problem.path else _path(loc)
    return replace(problem, path=path, subject=problem.subject or _subject(loc, raw))


def _unknown_key(loc: Sequence[str | int], model: type[BaseModel], raw: object) -> tuple[Problem, str]:
    """Return the problem of an unknown key, and the path of the key that was probably meant (empty if unclear)."""
    key = str(loc[-1])
    table = _model_at(loc[:-1], model)
    valid_keys = list(table.model_fields) if table is not None else []
    synonym = _OTHER_NAMES.get(key.lower())
    matches = [synonym] if synonym in valid_keys else []
    matches = (
        matches
        or difflib.get_close_matches(key, valid_keys, n=1)
        or difflib.get_close_matches(key.lower(), valid_keys, n=1)
    )
    guess = f'perhaps "{matches[0]}"; the keys here are' if matches else "one of the keys"
    owner = _owner_of(key, model) if len(loc) == 1 else None
    if owner is not None:
        matches, guess = [], f"perhaps the table [{owner}.{key}]; the keys here are"
    expected = f"{guess} {', '.join(valid_keys)}"
    meant = _path([*loc[:-1], matches[0]]) if matches else ""
    return Problem(_path(loc), f"the unknown key {describe_value(key)}", expected, _subject(loc, raw)), meant


def _owner_of(key: str, model: type[BaseModel]) -> str | None:
    """Return the name of the table with an inner table `key`, such as `aircraft` for `start`; None if there is none."""
    for name, field in model.model_fields.items():
        table = _model_in(field.annotation)
        inner = table.model_fields.get(key) if table is not None else None
        if inner is not None and _model_in(inner.annotation) is not None:
            return name
    return None


def _bad_value(loc: Sequence[str | int], model: type[BaseModel], raw: object) -> Problem:
    """Return the problem of an invalid or missing value: the value that arrived, and the values expected."""
    loc = _existing(loc, raw)
    value = _value_at(loc, raw)
    arrived = "nothing" if value is _ABSENT else describe_value(value)
    extra = _extra(loc, model)
    expected = str(extra.get("expected", "a table of keys and values"))
    if isinstance(value, str) and "unit" in extra:
        expected += conversion_hint(value, str(extra["unit"]))
    return Problem(_path(loc), arrived, expected, _subject(loc, raw))


def _existing(loc: Sequence[str | int], raw: object) -> Sequence[str | int]:
    """Return a location (Pydantic's sequence of keys and indices) up to the first index or key that `raw` lacks."""
    for end in range(1, len(loc)):
        value = _value_at(loc[:end], raw)
        is_list = isinstance(value, list | tuple)
        step = loc[end]
        if isinstance(step, int) and (not is_list or step >= len(value)):
            return loc[:end]
        is_value = isinstance(loc[end - 1], int) and value is not _ABSENT and not isinstance(value, Mapping)
        if isinstance(step, str) and is_value:  # the name of an alternative type, no key
            return loc[:end]
    return loc


def _value_at(loc: Sequence[str | int], raw: object) -> Any:
    """Return the value at a location (keys and list indices) in `raw`; `_ABSENT` for a missing key or item."""
    value: Any = raw
    for step in loc:
        try:
            value = value[step]
        except (KeyError, IndexError, TypeError):
            return _ABSENT
    return value


def _extra(loc: Sequence[str | int], model: type[BaseModel]) -> dict[str, Any]:
    """Return the texts `expected` and `unit` of the field at a location (keys and list indices), if declared."""
    field_index = max((index for index, step in enumerate(loc) if isinstance(step, str)), default=-1)
    table = _model_at(loc[:field_index], model) if field_index >= 0 else None
    field = table.model_fields.get(str(loc[field_index])) if table is not None else None
    if field is None:
        return {}
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    options = literal_options(field.annotation)
    return {"expected": options, **extra} if options else extra


def _model_at(loc: Sequence[str | int], model: type[BaseModel]) -> type[BaseModel] | None:
    """Return the model of the table at a location (keys and list indices); None if no table is there."""
    table: type[BaseModel] | None = model
    for step in loc:
        if isinstance(step, int):
            continue
        field = table.model_fields.get(step) if table is not None else None
        table = _model_in(field.annotation) if field is not None else None
    return table


def _model_in(annotation: object) -> type[BaseModel] | None:
    """Return the model class inside an annotation such as ``tuple[Aircraft, ...]``; None if there is none."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((inner_model for part in get_args(annotation) if (inner_model := _model_in(part)) is not None), None)


def _path(loc: Sequence[str | int]) -> str:
    """Format a location (keys and list indices) as a key path, such as ``aircraft[1].start.speed_m_s``."""
    text = ""
    for step in loc:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            text += f".{step}" if _BARE_KEY.match(step) else f".{json.dumps(step)}"
    return text.removeprefix(".")


def _subject(loc: Sequence[str | int], raw: object) -> str:
    """Return kind and name of the aircraft, goal or keep-out at a location, such as `aircraft "north"`, or empty."""
    if len(loc) < 2 or loc[0] not in ("aircraft", "goal", "keep_out"):
        return ""
    name = _value_at([*loc[:2], "name"], raw)
    return f"{loc[0]} {describe_value(name)}" if isinstance(name, str) and name else ""
