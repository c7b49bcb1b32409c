"""Messages from the page, validated: strict types, no unknown keys, bounded size and depth."""

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

SIZE_MAX = 8 * 1024 * 1024
"""Greatest size of a message, bytes."""
_DEPTH_MAX = 16
_Number = Annotated[int, Field(ge=0, le=2**53)]
_Name = Annotated[str, Field(min_length=1, max_length=120)]
_Document = dict[str, Any]


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class _Request(_Message):
    number: _Number  # of the request; the answer repeats it


class PlanRequest(_Request):
    """Plan a document; a final one, after a drag, replaces a document that is being planned."""

    type: Literal["plan"]
    scenario: _Document
    final: bool = False


class FlyRequest(_Request):
    """Fly a document, and compare the flight with an earlier one."""

    type: Literal["fly"]
    scenario: _Document
    compare: _Name | None = None


class StopRequest(_Request):
    """Stop the flight in progress."""

    type: Literal["stop"]


class FilesRequest(_Request):
    """List the scenario files of the folder."""

    type: Literal["files"]


class OpenRequest(_Request):
    """Open a scenario file of the folder."""

    type: Literal["open"]
    name: _Name


class SaveRequest(_Request):
    """Write a document to a file of the folder, with the comments of the file `base`."""

    type: Literal["save"]
    name: _Name
    scenario: _Document
    base: _Name | None = None
    overwrite: bool = False


class TextRequest(_Request):
    """Return a document as TOML, with the comments of the file `base`, if given."""

    type: Literal["text"]
    scenario: _Document
    base: _Name | None = None


class RecordedRequest(_Request):
    """Return a document with its plan as a page without a server."""

    type: Literal["recorded"]
    scenario: _Document


class ResumeRequest(_Request):
    """First message after a reconnect: the session of the page, and the flights that it has."""

    type: Literal["resume"]
    session: _Name
    flight_ids: Annotated[list[_Name], Field(max_length=64)] = []


Request = (
    PlanRequest
    | FlyRequest
    | StopRequest
    | FilesRequest
    | OpenRequest
    | SaveRequest
    | TextRequest
    | RecordedRequest
    | ResumeRequest
)
_REQUESTS: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="type")])


def read_message(text: str) -> Request:
    """Parse and validate a message of the page; raises ValueError if it is malformed, too large or too deep."""
    if len(text.encode("utf-8", "surrogatepass")) > SIZE_MAX:
        raise ValueError(f"a message of more than {SIZE_MAX:,} bytes")
    try:
        values = json.loads(text, parse_constant=_refuse_constant)
        depth = _depth(values)
    except RecursionError:
        raise ValueError("a message nested too deeply") from None
    if depth > _DEPTH_MAX:
        raise ValueError(f"a message of more than {_DEPTH_MAX} levels")
    return _REQUESTS.validate_python(values)


def _refuse_constant(name: str) -> float:
    raise ValueError(f"the number {name}")


def _depth(value: Any) -> int:
    if isinstance(value, dict):
        return 1 + max(map(_depth, value.values()), default=0)
    if isinstance(value, list):
        return 1 + max(map(_depth, value), default=0)
    return 0
