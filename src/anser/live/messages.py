"""Validated requests of the page: strict types, no unknown keys, bounded size and depth.

A document (`scenario`) is a scenario as nested dictionaries and lists; this module does not validate documents.
"""

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

SIZE_MAX = 8 * 1024 * 1024
"""Greatest size of a message from the page, bytes."""
_DEPTH_MAX = 16
_Number = Annotated[int, Field(ge=0, le=2**53)]
_Name = Annotated[str, Field(min_length=1, max_length=120)]
_Document = dict[str, Any]


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class _Request(_Message):
    number: _Number  # number of the request; the answer repeats the number


class PlanRequest(_Request):
    """Request to plan a document; a `final` request, at the end of a drag, stops the plan in progress."""

    type: Literal["plan"]
    scenario: _Document
    final: bool = False


class FlyRequest(_Request):
    """Request to fly a document, and to compare the flight with the earlier flight `compare`, if any."""

    type: Literal["fly"]
    scenario: _Document
    compare: _Name | None = None


class StopRequest(_Request):
    """Request to stop the flight in progress."""

    type: Literal["stop"]


class FilesRequest(_Request):
    """Request for the names of the scenario files in the folder."""

    type: Literal["files"]


class OpenRequest(_Request):
    """Request for the content of a scenario file in the folder."""

    type: Literal["open"]
    name: _Name


class SaveRequest(_Request):
    """Request to write a document to the file `name` of the folder, with the comments of the file `base`, if any."""

    type: Literal["save"]
    name: _Name
    scenario: _Document
    base: _Name | None = None
    overwrite: bool = False


class TextRequest(_Request):
    """Request for a document as TOML text, with the comments of the file `base`, if any."""

    type: Literal["text"]
    scenario: _Document
    base: _Name | None = None


class RecordedRequest(_Request):
    """Request for an HTML page that shows a document and its plan without a server."""

    type: Literal["recorded"]
    scenario: _Document


class ResumeRequest(_Request):
    """First message of a page after a reconnect: its session, and the identifiers of the flights that the page has."""

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
    """Parse and validate a request of the page.

    Raises ValueError if the request is malformed, larger than 8 MiB or nested more than 16 levels deep.
    """
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
