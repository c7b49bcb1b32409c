"""What every summary of a flight holds, whichever version wrote it."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError


class _Part(BaseModel):
    model_config = ConfigDict(strict=True)


class _Scenario(_Part):
    name: str


class _Aircraft(_Part):
    name: str
    goal: str
    status: str
    planned_arrival_s: FiniteFloat | None
    arrival_s: FiniteFloat | None
    miss_m: FiniteFloat | None


class _Fleet(_Part):
    separation_min_m: FiniteFloat | None
    simulated_s: FiniteFloat


class _Requirement(_Part):
    name: str
    met: bool


class _Summary(_Part):
    scenario: _Scenario
    aircraft: list[_Aircraft] = Field(min_length=1)
    fleet: _Fleet
    requirements: list[_Requirement]


def summary_problem(summary: dict[str, Any]) -> tuple[str, str] | None:
    """What arrived at the first key that is not as in a summary, and what was expected; None if all are."""
    try:
        _Summary.model_validate(summary)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        if first["type"] == "missing":
            return f"no {key}", "a summary of a flight, which has one"
        return f"{first['input']!r:.60} in {key}", first["msg"].removeprefix("Input should be ")
    return None
