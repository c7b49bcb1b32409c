"""Content of a DAVE-ML file as plain data (DAVEfunc document type 2.0)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from anser.dave_ml.elements import DaveMlError
from anser.dave_ml.formulas import Formula

Extrapolate = Literal["neither", "min", "max", "both"]
Interpolate = Literal["linear", "discrete", "floor", "ceiling"]
Role = Literal["isInput", "isControl", "isDisturbance", "isState", "isStateDeriv", "isOutput", "isStdAIAA"]
ROLES: Final[tuple[Role, ...]] = (
    "isInput", "isControl", "isDisturbance", "isState", "isStateDeriv", "isOutput", "isStdAIAA"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Note:
    """Element of a DAVE-ML file that documents only: header, provenance or uncertainty.

    Attributes
    ----------
    tag, text
        Name of the element, and character data without surrounding blanks.
    attributes
        Pairs of name and value.
    children
        Child elements in file order.
    """

    tag: str
    attributes: tuple[tuple[str, str], ...] = ()
    text: str = ""
    children: tuple["Note", ...] = ()

    def get(self, attribute: str, otherwise: str = "") -> str:
        """Return the value of an attribute, or `otherwise` if absent."""
        return dict(self.attributes).get(attribute, otherwise)

    def all(self, tag: str) -> tuple["Note", ...]:
        """Return the children with a tag."""
        return tuple(child for child in self.children if child.tag == tag)


@dataclass(frozen=True, slots=True)
class SourceLocation:
    """Position in a DAVE-ML file: line and column from 1, or None for a definition made in Python."""

    file: str = ""
    line: int | None = None
    column: int | None = None

    def fault(self, arrived: str, expected: str) -> DaveMlError:
        """Return an error at this position, with the content that arrived and the content expected."""
        return DaveMlError(self.file, arrived, expected, self.line, self.column)


@dataclass(frozen=True, slots=True)
class Variable:
    """Variable of a DAVE-ML file: signal, constant or parameter.

    Attributes
    ----------
    id, name, units
        varID, name (ANSI/AIAA S-119 name for standard variables), and units as written.
    description, axis_system, sign, alias, symbol
        Documentation from the file.
    initial
        Constant, initial value of a state, or default of an input.
    minimum, maximum
        Limits that clip every value of the variable.
    formula
        Calculation of the value from other variables.
    roles
        Roles marked in the file, a subset of `ROLES`: input, output, state and so on.
    notes
        Provenance and uncertainty.
    location
        Position in the file.
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Described:
    """Documentation shared by tables and breakpoints; base class."""

    name: str = ""
    units: str = ""
    description: str = ""
    notes: tuple[Note, ...] = ()
    location: SourceLocation = SourceLocation()


@dataclass(frozen=True, slots=True, eq=False)
class Breakpoints(_Described):
    """Breakpoints of one axis of gridded tables; shape (n,), strictly increasing."""

    id: str
    points: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class GriddedTable(_Described):
    """Table with values on a grid of breakpoints.

    Attributes
    ----------
    id
        Identifier (gtID).
    axes
        Breakpoint identifier (bpID) of each axis.
    values
        Array with one dimension per entry of `axes`.
    """

    id: str
    axes: tuple[str, ...]
    values: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class UngriddedTable(_Described):
    """Table with values at scattered points.

    Attributes
    ----------
    id
        Identifier (utID).
    points
        Coordinates; shape (n, arguments).
    values
        Value at each point; shape (n,).
    """

    id: str
    points: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, slots=True)
class Argument:
    """Independent variable of a function.

    Attributes
    ----------
    id
        varID.
    minimum, maximum
        Limits that clip the argument before the lookup.
    extrapolate, interpolate
        Extrapolation beyond the table's ends, and interpolation between breakpoints.
    """

    id: str
    minimum: float | None = None
    maximum: float | None = None
    extrapolate: Extrapolate = "neither"
    interpolate: Interpolate = "linear"


@dataclass(frozen=True, slots=True)
class Function:
    """Function of a DAVE-ML file: computes a variable by looking up a table.

    Attributes
    ----------
    result
        varID of the dependent variable.
    arguments
        Independent variables in the order of the table's axes.
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
    """Value of a variable in a check shot, with its unit and tolerance.

    Attributes
    ----------
    id
        varID of the variable.
    value
        Input value, or expected value of an output.
    units
        Units of value and tolerance; the variable's units if the file omits them.
    tolerance
        Greatest permitted difference from the computed value; None if the file omits it.
    """

    id: str
    value: float
    units: str
    tolerance: float | None = None


@dataclass(frozen=True, slots=True)
class Shot:
    """Check shot: input values with the outputs and internal values that the model must give."""

    name: str
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    internal: tuple[Signal, ...] = ()
    reference: str = ""
    description: str = ""
    notes: tuple[Note, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Definition:
    """Content of a DAVE-ML file.

    Attributes
    ----------
    file
        Name of the file in error messages.
    header
        Author, dates, references and modification records.
    variables, breakpoints, gridded, ungridded
        Definitions by identifier, in file order.
    functions, shots
        In file order.
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
    """Return the header element of a new file; `date` has the form 2026-11-25."""
    children = [
        Note("author", (("name", author), ("org", organization))),
        Note("creationDate", (("date", date),)),
    ]
    if version:
        children.append(Note("fileVersion", text=version))
    if description:
        children.append(Note("description", text=description))
    return Note("fileHeader", (("name", name),), children=tuple(children))
