"""What all tables of a scenario share: strictness, and fields that know in words what they expect."""

import bisect
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Never, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator
from pydantic_core import PydanticUndefined

from anser.config.errors import Problem, ScenarioError, format_number

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"
NAME_EXPECTED = "a name of 1 to 64 letters, digits, hyphens and underscores"
SLUG_PATTERN = r"^[a-z0-9]+(-[a-z0-9]+)*$"
SLUG_EXPECTED = 'a name in small letters, digits and single hyphens, such as "three-aircraft"'

GAIN_MAX = 1000.0

Vector = tuple[float, float, float]
"""North, east, up."""


class Table(BaseModel):
    """A table of a scenario: frozen, strict about types, refusing unknown keys, NaN and infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_default=True)

    def consistency_problems(self) -> list[Problem]:
        """Find what is wrong between keys of the table, each valid by itself; paths are those within the table."""
        return []

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        found = self.consistency_problems()
        if found:
            raise ScenarioError("", found)
        return self

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy the table as it is.

        Raises
        ------
        TypeError
            If something is to be changed on the way, which nothing would check.
        """
        if update is not None:
            raise _unchecked(f"{type(self).__name__}.model_copy(update=...)")
        return super().model_copy(deep=deep)

    def copy(self, **options: Any) -> Never:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Refused: pydantic's older way to change values that nothing checks (TypeError)."""
        raise _unchecked(f"{type(self).__name__}.copy()")

    @classmethod
    def model_construct(cls, _fields_set: set[str] | None = None, **values: Any) -> Never:
        """Refused: it makes a table that nothing has checked (TypeError)."""
        raise _unchecked(f"{cls.__name__}.model_construct()")


def content_hash(table: Table, beside: Mapping[str, Any] | None = None) -> str:
    """SHA-256 of the canonical JSON of a table (keys sorted, no blanks, ASCII), 64 hexadecimal digits.

    `beside` are keys of what belongs to the content and stands in no table.
    """
    text = json.dumps(
        {**table.model_dump(mode="json"), **(beside or {})}, sort_keys=True, separators=(",", ":"), allow_nan=False
    )
    return hashlib.sha256(text.encode()).hexdigest()


def _unchecked(what: str) -> TypeError:
    return TypeError(
        f"{what} would make a scenario that nothing has checked; change a scenario by path, which checks it: "
        'scenario.replace("fleet.speed_m_s", 160.0, "wind.speed_m_s", 8.0)'
    )


def ordering_problems(table: Table, low_key: str, high_key: str, unit: str) -> list[Problem]:
    """Find a key of a table that is not less than another one."""
    low, high = getattr(table, low_key), getattr(table, high_key)
    return (
        []
        if low < high
        else [Problem(low_key, format_number(low), f"less than {high_key}, which is {format_number(high)} {unit}")]
    )


def velocity_on_course(speed_m_s: float, course_deg: float, up_m_s: float = 0.0) -> Vector:
    """Velocity (north, east, up) of a horizontal speed in a direction clockwise from north, m/s."""
    course = math.radians(course_deg)
    return speed_m_s * math.cos(course), speed_m_s * math.sin(course), up_m_s


def interpolate(points: Sequence[tuple[float, Vector]], at: float) -> Vector:
    """Value at a place between points, linear from one to the next, beyond the ends as there.

    Parameters
    ----------
    points
        Place (such as a time or an altitude) and value, in rising order; one or more.
    at
        The place wanted.
    """
    after = bisect.bisect_right(points, at, key=lambda point: point[0])
    if after in (0, len(points)):
        return points[0 if after == 0 else -1][1]
    (low, begin), (high, end) = points[after - 1], points[after]
    share = (at - low) / (high - low)
    north, east, up = (a + share * (b - a) for a, b in zip(begin, end, strict=True))
    return north, east, up


def expects(expected: str, unit: str | None = None) -> dict[str, Any]:
    """`json_schema_extra` of a field: what it expects, in words that messages put after "expected", and its unit."""
    return {"expected": expected} if unit is None else {"expected": expected, "unit": unit}


def number(
    description: str,
    low: float,
    high: float,
    unit: str,
    default: object = PydanticUndefined,
    *,
    exclusive_minimum: bool = False,
) -> Any:
    """Declare a field that holds a finite number within a range.

    Parameters
    ----------
    about
        What it is, in one line.
    low, high
        The range, in `unit`; `high` belongs to it, and so does `low` unless `above`.
    unit
        As written in messages; empty for a pure number.
    default
        None for "may be left out"; without it the key is required.
    above
        The number must exceed `low`.
    """
    span = f"above {low:.10g} and at most {high:.10g}" if exclusive_minimum else f"from {low:.10g} to {high:.10g}"
    words = f"a number {span} {unit}".rstrip()
    lower: dict[str, Any] = {"gt": low} if exclusive_minimum else {"ge": low}
    return Field(default, **lower, le=high, description=description, json_schema_extra=expects(words, unit))


def choice(description: str, options: tuple[str, ...], default: object = PydanticUndefined) -> Any:
    """Declare a field that holds one of some words.

    `options` are the words of its Literal type; without a default the key is required.
    """
    words = " or ".join(f'"{option}"' for option in options)
    return Field(default, description=description, json_schema_extra=expects(words))


def identifier(description: str) -> Any:
    """Declare a required field that holds the name of an aircraft or a goal."""
    return Field(pattern=NAME_PATTERN, description=description, json_schema_extra=expects(NAME_EXPECTED))


def table(description: str, expected: str, default: object = PydanticUndefined) -> Any:
    """Declare a field that holds one table.

    `about` says what it is, `words` what messages expect; without a default the table is required.
    """
    return Field(default, description=description, json_schema_extra=expects(expected))


def tables(description: str, expected: str, *, at_least: int, default: object = PydanticUndefined) -> Any:
    """Declare a field that holds a list of tables.

    As `table`, of `at_least` so many.
    """
    # a TOML list arrives as a Python list, which a strict tuple would refuse; the items stay strict
    return Field(
        default, min_length=at_least, strict=False, description=description, json_schema_extra=expects(expected)
    )


def _spread_over_axes(value: object) -> object:
    """Spread one number over the three axes."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (value, value, value)
    return value


_GAIN = expects(f"a number from 0 to {GAIN_MAX:g}, or a list of three such numbers", "")
_Gain = Annotated[float, Field(ge=0, le=GAIN_MAX)]
_GAIN_SCHEMA = {"type": "number", "minimum": 0, "maximum": GAIN_MAX}
Gain3 = Annotated[
    tuple[_Gain, _Gain, _Gain],
    BeforeValidator(_spread_over_axes),
    Field(strict=False),
    WithJsonSchema({"anyOf": [_GAIN_SCHEMA, {"type": "array", "items": _GAIN_SCHEMA, "minItems": 3, "maxItems": 3}]}),
]


def gain(description: str, default: float) -> Any:
    """Declare a gain: one number, or a list of three, one for each axis of the loop; its value is a tuple of three."""
    return Field((default, default, default), description=description, json_schema_extra=_GAIN)


def optional_gain(description: str, unit: str = "") -> Any:
    """Declare what a gain may be derived from: one number, a list of three, or nothing (None)."""
    return Field(None, description=description, json_schema_extra={**_GAIN, "unit": unit})
