"""What a DAVE-ML file says, as plain data (DAVEfunc document type 2.0)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from anser.dave_ml.elements import DaveMlError, Element
from anser.dave_ml.formulas import Formula

Extrapolate = Literal["neither", "min", "max", "both"]
Interpolate = Literal["linear", "discrete", "floor", "ceiling"]
Role = Literal["isInput", "isControl", "isDisturbance", "isState", "isStateDeriv", "isOutput", "isStdAIAA"]
ROLES: Final[tuple[Role, ...]] = (
    "isInput", "isControl", "isDisturbance", "isState", "isStateDeriv", "isOutput", "isStdAIAA"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Note:
    """An element that says something about the model and computes nothing: header, provenance, uncertainty.

    Attributes
    ----------
    tag, text
        Its name, and its character data without blanks around.
    attributes
        Pairs of name and value.
    children
        In their order.
    """

    tag: str
    attributes: tuple[tuple[str, str], ...] = ()
    text: str = ""
    children: tuple["Note", ...] = ()

    def get(self, attribute: str, otherwise: str = "") -> str:
        """The value of an attribute."""
        return dict(self.attributes).get(attribute, otherwise)

    def all(self, tag: str) -> tuple["Note", ...]:
        """The children of a name."""
        return tuple(child for child in self.children if child.tag == tag)


@dataclass(frozen=True, slots=True)
class SourceLocation:
    """Where something stands in a file; line and column from 1, None where it came from no file."""

    file: str = ""
    line: int | None = None
    column: int | None = None

    def fault(self, arrived: str, expected: str) -> DaveMlError:
        """The error at this place."""
        return DaveMlError(self.file, arrived, expected, self.line, self.column)


def source_location_of(element: Element) -> SourceLocation:
    """Where an element begins."""
    return SourceLocation(element.file, element.line, element.column)


@dataclass(frozen=True, slots=True)
class Variable:
    """A signal, constant or parameter.

    Attributes
    ----------
    id, name, units
        Its varID, its name (for standard ones that of ANSI/AIAA S-119), its units as written.
    initial
        Initial, constant or usual value.
    least, greatest
        What its value is limited to, however it arises.
    formula
        How it is calculated.
    roles
        Those of `ROLES` that it has.
    notes
        Provenance and uncertainty.
    """

    id: str
    name: str
    units: str
    description: str = ""
    axis_system: str = ""
    sign: str = ""
    alias: str = ""
    symbol: str = ""
    initial: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    formula: Formula | None = None
    roles: frozenset[Role] = frozenset()
    notes: tuple[Note, ...] = ()
    location: SourceLocation = field(default=SourceLocation(), compare=False)


@dataclass(frozen=True, slots=True, eq=False)
class Breakpoints:
    """Points of one axis of gridded tables; shape (n,), strictly increasing."""

    id: str
    points: np.ndarray
    name: str = ""
    units: str = ""
    description: str = ""
    location: SourceLocation = SourceLocation()


@dataclass(frozen=True, slots=True, eq=False)
class GriddedTable:
    """Values on a grid.

    Attributes
    ----------
    id
        Its gtID.
    axes
        Identifiers of the breakpoints of each axis.
    values
        One axis for each of `axes`.
    """

    id: str
    axes: tuple[str, ...]
    values: np.ndarray
    name: str = ""
    units: str = ""
    description: str = ""
    notes: tuple[Note, ...] = ()
    location: SourceLocation = SourceLocation()


@dataclass(frozen=True, slots=True, eq=False)
class UngriddedTable:
    """Values at scattered points.

    Attributes
    ----------
    id
        Its utID.
    points
        Coordinates; shape (n, arguments).
    values
        Shape (n,).
    """

    id: str
    points: np.ndarray
    values: np.ndarray
    name: str = ""
    units: str = ""
    description: str = ""
    notes: tuple[Note, ...] = ()
    location: SourceLocation = SourceLocation()


@dataclass(frozen=True, slots=True)
class Argument:
    """A variable that a function depends on.

    Attributes
    ----------
    id
        Its varID.
    least, greatest
        What it is limited to before the table is looked up.
    extrapolate, interpolate
        Beyond the ends of the table and between its points.
    """

    id: str
    minimum: float | None = None
    maximum: float | None = None
    extrapolate: Extrapolate = "neither"
    interpolate: Interpolate = "linear"


@dataclass(frozen=True, slots=True)
class Function:
    """A table as the source of a variable.

    Attributes
    ----------
    result
        The varID of the variable that it gives.
    arguments
        One for each axis of the table, in their order.
    table
        Identifier of a gridded or ungridded table.
    """

    name: str
    result: str
    arguments: tuple[Argument, ...]
    table: str
    description: str = ""
    notes: tuple[Note, ...] = ()
    location: SourceLocation = field(default=SourceLocation(), compare=False)


@dataclass(frozen=True, slots=True)
class Signal:
    """A value of a check shot.

    Attributes
    ----------
    id
        The varID of the variable.
    units
        In which value and tolerance stand; those of the variable where they are not given.
    tolerance
        Greatest difference to what is computed; None where the file gives none.
    """

    id: str
    value: float
    units: str
    tolerance: float | None = None


@dataclass(frozen=True, slots=True)
class Shot:
    """A static check: inputs, what comes out, and what stands in between."""

    name: str
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    internal: tuple[Signal, ...] = ()
    reference: str = ""
    description: str = ""
    notes: tuple[Note, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Definition:
    """The content of a DAVE-ML file.

    Attributes
    ----------
    file
        What errors call it.
    header
        Who made it, when, from what, with what changes.
    variables, breakpoints, gridded, ungridded
        By their identifiers, in the file's order.
    functions, shots
        In the file's order.
    """

    file: str
    header: Note
    variables: Mapping[str, Variable]
    breakpoints: Mapping[str, Breakpoints] = field(default_factory=dict)
    gridded: Mapping[str, GriddedTable] = field(default_factory=dict)
    ungridded: Mapping[str, UngriddedTable] = field(default_factory=dict)
    functions: tuple[Function, ...] = ()
    shots: tuple[Shot, ...] = ()


def header(name: str, author: str, organization: str, date: str, description: str = "", version: str = "") -> Note:
    """The header of a file of one's own; the date as in 2026-11-25."""
    children = [
        Note("author", (("name", author), ("org", organization))),
        Note("creationDate", (("date", date),)),
    ]
    if version:
        children.append(Note("fileVersion", text=version))
    if description:
        children.append(Note("description", text=description))
    return Note("fileHeader", (("name", name),), children=tuple(children))
