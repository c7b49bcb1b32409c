"""Base class of all tables, and declarations of fields with descriptions for messages."""

import bisect
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Never, Self, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, WithJsonSchema, model_validator
from pydantic_core import PydanticUndefined

from anser.config.errors import Problem, ScenarioError, format_number, quoted_list

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"
NAME_EXPECTED = "a name of 1 to 64 letters, digits, hyphens and underscores"
SLUG_PATTERN = r"^[a-z0-9]+(-[a-z0-9]+)*$"
SLUG_EXPECTED = 'a name in small letters, digits and single hyphens, such as "three-aircraft"'

GAIN_MAX = 1000.0

Vector = tuple[float, float, float]
"""Vector with the components (north, east, up)."""


def is_stored(info: ValidationInfo) -> bool:
    """Whether the tables come from stored results, in which contradictions between keys are accepted."""
    return bool(info.context and info.context.get("is_stored"))


class Table(BaseModel):
    """Table of a file: frozen, strict about types; unknown keys, NaN and infinity are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_default=True)

    def consistency_problems(self) -> list[Problem]:
        """List contradictions between keys whose values are valid one by one; key paths are relative to the table."""
        return []

    @model_validator(mode="after")
    def _holds_together(self, info: ValidationInfo) -> Self:
        self._refuse_contradictions(info)
        return self

    def _refuse_contradictions(self, info: ValidationInfo) -> None:
        """Raise ScenarioError for contradictions between keys, unless the table comes from stored results."""
        # the version that stored the results has checked them, perhaps by other rules
        problems = [] if is_stored(info) else self.consistency_problems()
        if problems:
            raise ScenarioError("", problems)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy the table; raises TypeError if `update` is given: the changes would skip validation."""
        if update is not None:
            raise _unchecked(f"{type(self).__name__}.model_copy(update=...)")
        return super().model_copy(deep=deep)

    def copy(self, **options: Any) -> Never:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Raise TypeError: pydantic's older copy method would skip validation."""
        raise _unchecked(f"{type(self).__name__}.copy()")

    def with_defaults(self, **defaults: Any) -> Self:
        """Return the table with the values `defaults` for keys that the file omits.

        `model_fields_set`, the set of the keys in the file, is unchanged.
        """
        return self._with_values(**{key: value for key, value in defaults.items() if key not in self.model_fields_set})

    def _with_values(self, **values: Any) -> Self:
        """Return the table with some values replaced, without validation; `model_fields_set` is unchanged."""
        return super().model_construct(self.model_fields_set, **{**self.__dict__, **values})

    @classmethod
    def model_construct(cls, _fields_set: set[str] | None = None, **values: Any) -> Never:
        """Raise TypeError: the table would skip validation."""
        raise _unchecked(f"{cls.__name__}.model_construct()")


def content_hash(table: Table, extra: Mapping[str, Any] | None = None) -> str:
    """Return the SHA-256 of a table's canonical JSON (keys sorted, no blanks, ASCII), 64 hexadecimal digits.

    `extra` adds keys, or replaces values, before the hash.
    """
    text = json.dumps(
        {**table.model_dump(mode="json"), **(extra or {})}, sort_keys=True, separators=(",", ":"), allow_nan=False
    )
    return hashlib.sha256(text.encode()).hexdigest()


def _unchecked(call: str) -> TypeError:
    return TypeError(
        f"{call} would make a scenario that nothing has checked; change a scenario by path, which checks it: "
        'scenario.replace("fleet.speed_m_s", 160.0, "wind.speed_m_s", 8.0)'
    )


def ordering_problems(table: Table, low_key: str, high_key: str, unit: str) -> list[Problem]:
    """Return a list with one problem unless the value of `low_key` is less than the value of `high_key`."""
    low, high = getattr(table, low_key), getattr(table, high_key)
    return (
        []
        if low < high
        else [Problem(low_key, format_number(low), f"less than {high_key}, which is {format_number(high)} {unit}")]
    )


def velocity_on_course(speed_m_s: float, course_deg: float, up_m_s: float = 0.0) -> Vector:
    """Compute the velocity (north, east, up), m/s, from horizontal speed, course (from north) and vertical speed."""
    course = math.radians(course_deg)
    return speed_m_s * math.cos(course), speed_m_s * math.sin(course), up_m_s


def interpolate(points: Sequence[tuple[float, Vector]], position: float) -> Vector:
    """Interpolate a vector linearly at `position` between pairs (rising position, vector); constant beyond the ends."""
    upper_index = bisect.bisect_right(points, position, key=lambda point: point[0])
    if upper_index in (0, len(points)):
        return points[0 if upper_index == 0 else -1][1]
    (low, low_value), (high, high_value) = points[upper_index - 1], points[upper_index]
    fraction = (position - low) / (high - low)
    north, east, up = (a + fraction * (b - a) for a, b in zip(low_value, high_value, strict=True))
    return north, east, up


def expects(expected: str, unit: str | None = None) -> dict[str, Any]:
    """Build the `json_schema_extra` of a field: the text that messages put after "expected", and the key's unit."""
    return {"expected": expected} if unit is None else {"expected": expected, "unit": unit}


def number(
    description: str,
    low: float,
    high: float,
    unit: str,
    default: object = PydanticUndefined,
    *,
    exclusive_minimum: bool = False,
    omit_default: bool = False,
) -> Any:
    """Declare a field for a finite number within a range.

    Parameters
    ----------
    description
        Meaning, in one line.
    low, high
        Range in `unit`; `high` is allowed, and `low` is allowed unless `exclusive_minimum` is True.
    unit
        As written in messages; empty for a pure number.
    default
        None for an optional key; without a default the key is required.
    exclusive_minimum
        Whether the number must exceed `low`.
    omit_default
        Whether the default is left out of a dump, so that files without a newer key keep their hash.
    """
    span = f"above {low:.10g} and at most {high:.10g}" if exclusive_minimum else f"from {low:.10g} to {high:.10g}"
    expected = f"a number {span} {unit}".rstrip()
    lower: dict[str, Any] = {"gt": low} if exclusive_minimum else {"ge": low}
    exclude_if = (lambda value: value == default) if omit_default else None
    return Field(
        default,
        **lower,
        le=high,
        description=description,
        json_schema_extra=expects(expected, unit),
        exclude_if=exclude_if,
    )


def whole_number(description: str, low: int, high: int, default: object = PydanticUndefined) -> Any:
    """Declare a field for a whole number from `low` to `high`, both allowed; without a default the key is required."""
    expected = f"a whole number from {low} to {high}"
    return Field(default, ge=low, le=high, description=description, json_schema_extra=expects(expected))


def slug(description: str) -> Any:
    """Declare a required field for a name in small letters, digits and single hyphens."""
    return Field(pattern=SLUG_PATTERN, max_length=64, description=description, json_schema_extra=expects(SLUG_EXPECTED))


def identifier(description: str, expected: str = NAME_EXPECTED, default: object = PydanticUndefined) -> Any:
    """Declare a field for the name of an aircraft or a goal; without a default the key is required."""
    return Field(default, pattern=NAME_PATTERN, description=description, json_schema_extra=expects(expected))


def literal_options(annotation: object) -> str:
    """Return the options of a Literal in an annotation as text, such as `"right" or "left"`; empty if there is none."""
    if get_origin(annotation) is Literal:
        return quoted_list(get_args(annotation), " or ")
    return next(filter(None, map(literal_options, get_args(annotation))), "")


def table(description: str, expected: str, default: object = PydanticUndefined, *, omit_default: bool = False) -> Any:
    """Declare a field for a table; without a default the table is required.

    `expected` is the text that messages put after "expected"; `omit_default` leaves the default out of a dump.
    """
    exclude_if = (lambda value: value == default) if omit_default else None
    return Field(default, description=description, json_schema_extra=expects(expected), exclude_if=exclude_if)


def tables(
    description: str,
    expected: str,
    *,
    at_least: int,
    default: object = PydanticUndefined,
    omit_default: bool = False,
) -> Any:
    """Declare a field for a list of `at_least` or more tables; for the other arguments, see `table`."""
    # strict=False: a TOML list is a Python list, not a tuple; the items stay strict
    return Field(
        default,
        min_length=at_least,
        strict=False,
        description=description,
        json_schema_extra=expects(expected),
        exclude_if=(lambda value: value == default) if omit_default else None,
    )


def _spread_over_axes(value: object) -> object:
    """Return a number as a tuple of three, for the three axes; every other value is returned unchanged."""
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
    """Declare a gain: in the file a number, or a list of three numbers, one per axis; the value is a tuple of three."""
    return Field((default, default, default), description=description, json_schema_extra=_GAIN)


def optional_gain(description: str, unit: str = "") -> Any:
    """Declare an optional key (number, list of three, or None) from which gains are computed, such as a bandwidth."""
    return Field(None, description=description, json_schema_extra={**_GAIN, "unit": unit})
