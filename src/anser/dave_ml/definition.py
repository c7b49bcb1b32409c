"""Content of a DAVE-ML file as plain data (DAVEfunc document type 2.0)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, get_args

import numpy as np

from anser.dave_ml.elements import DaveMlError
from anser.dave_ml.formulas import Formula

Extrapolate = Literal["neither", "min", "max", "both"]
Interpolate = Literal["linear", "discrete", "floor", "ceiling"]
Role = Literal["isInput", "isControl", "isDisturbance", "isState", "isStateDeriv", "isOutput", "isStdAIAA"]
ROLES: Final[tuple[Role, ...]] = get_args(Role)


@dataclass(frozen=True, slots=True)
class Note:
    """Element of a DAVE-ML file without effect on the model: header, provenance or uncertainty."""

    tag: str
    attributes: tuple[tuple[str, str], ...] = ()
    text: str = ""
    children: tuple["Note", ...] = ()

    def get(self, attribute: str, otherwise: str = "") -> str:
        """Return the value of an attribute; `otherwise` if the attribute is absent."""
        return dict(self.attributes).get(attribute, otherwise)

    def all(self, tag: str) -> tuple["Note", ...]:
        """Return the children with the tag `tag`, in file order."""
        return tuple(child for child in self.children if child.tag == tag)


@dataclass(frozen=True, slots=True)
class SourceLocation:
    """Position in a DAVE-ML file: line and column from 1; None for a definition made in Python."""

    file: str = ""
    line: int | None = None
    column: int | None = None

    def fault(self, arrived: str, expected: str) -> DaveMlError:
        """Return an error at this position; `arrived` describes the faulty content, `expected` the correct one."""
        return DaveMlError(self.file, arrived, expected, self.line, self.column)


@dataclass(frozen=True, slots=True)
class Variable:
    """Variable of a DAVE-ML file: input, output, state, constant or computed quantity."""

    id: str  #: varID.
    name: str  #: Name; of a standard variable, the name in ANSI/AIAA S-119.
    units: str  #: Units of `initial`, `minimum` and `maximum`, as written in the file.
    description: str = ""  #: From here to `symbol`: documentation, as written in the file.
    axis_system: str = ""
    sign: str = ""
    alias: str = ""
    symbol: str = ""
    initial: float | None = None  #: Value of a constant, initial value of a state, or default of an input.
    #: Limits to which every value of the variable is clipped; None: no limit.
    minimum: float | None = None
    maximum: float | None = None
    formula: Formula | None = None  #: Calculation of the value from other variables, if any.
    roles: frozenset[Role] = frozenset()
    notes: tuple[Note, ...] = ()  #: Provenance and uncertainty.
    location: SourceLocation = field(default=SourceLocation(), compare=False)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Described:
    """Base class of tables and breakpoints: documentation from the file. `units` is empty if the file has none."""

    name: str = ""
    units: str = ""
    description: str = ""
    notes: tuple[Note, ...] = ()
    location: SourceLocation = SourceLocation()


@dataclass(frozen=True, slots=True, eq=False)
class Breakpoints(_Described):
    """Breakpoints of one axis of gridded tables: bpID `id`, and `points` of shape (n,), strictly increasing."""

    id: str
    points: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class GriddedTable(_Described):
    """Table (gtID `id`) with values on a grid; `axes` are the bpIDs of the breakpoints of each dimension."""

    id: str
    axes: tuple[str, ...]
    values: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class UngriddedTable(_Described):
    """Table (utID `id`) with `values`, shape (n,), at scattered `points`, shape (n, arguments)."""

    id: str
    points: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, slots=True)
class Argument:
    """Independent variable (varID `id`) of a function, clipped to `minimum` and `maximum` before the lookup."""

    id: str
    minimum: float | None = None  #: None: no limit.
    maximum: float | None = None  #: None: no limit.
    extrapolate: Extrapolate = "neither"  #: Ends of the table beyond which values are extrapolated instead of held.
    interpolate: Interpolate = "linear"


@dataclass(frozen=True, slots=True)
class Function:
    """Function of a DAVE-ML file, which computes the variable `result` (varID) from the table `table` (gtID or utID).

    The arguments are in the order of the table's axes.
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
    """Value of a variable in a check shot: value of an input, or expected value of a computed variable."""

    id: str  #: varID.
    value: float
    units: str  #: Units of value and tolerance; units of the variable if the file omits them.
    tolerance: float | None = None  #: None if the file states no tolerance.


@dataclass(frozen=True, slots=True)
class Shot:
    """Check shot: values of inputs, and the values of outputs and internal variables that the model must compute."""

    name: str
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    internal: tuple[Signal, ...] = ()
    reference: str = ""
    description: str = ""
    notes: tuple[Note, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Definition:
    """Content of a DAVE-ML file, in file order; variables, breakpoints and tables by varID, bpID, gtID or utID."""

    file: str  #: Name of the file in error messages.
    header: Note
    variables: Mapping[str, Variable]
    breakpoints: Mapping[str, Breakpoints] = field(default_factory=dict)
    gridded: Mapping[str, GriddedTable] = field(default_factory=dict)
    ungridded: Mapping[str, UngriddedTable] = field(default_factory=dict)
    functions: tuple[Function, ...] = ()
    shots: tuple[Shot, ...] = ()
    check_notes: tuple[Note, ...] = ()  #: Provenance of the check shots.
