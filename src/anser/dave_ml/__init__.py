"""DAVE-ML 2 (ANSI/AIAA S-119): read, evaluate, check and write models of aircraft."""

from anser.dave_ml.adapting import adapted
from anser.dave_ml.checking import CheckResult
from anser.dave_ml.definition import (
    Argument,
    Breakpoints,
    Definition,
    Function,
    GriddedTable,
    Note,
    Shot,
    Signal,
    UngriddedTable,
    Variable,
    header,
)
from anser.dave_ml.errors import DaveMlError
from anser.dave_ml.evaluator import Evaluator
from anser.dave_ml.formulas import Applied, Chosen, Formula, Named, Number
from anser.dave_ml.model import Model, model_of, read_dave_ml
from anser.dave_ml.standard_names import ANGLE, STANDARD, Measure, refuse_other_units
from anser.dave_ml.unit_names import Unit, unit_of
from anser.dave_ml.writing import write_dave_ml

__all__ = [
    "ANGLE",
    "STANDARD",
    "Applied",
    "Argument",
    "Breakpoints",
    "CheckResult",
    "Chosen",
    "DaveMlError",
    "Definition",
    "Evaluator",
    "Formula",
    "Function",
    "GriddedTable",
    "Measure",
    "Model",
    "Named",
    "Note",
    "Number",
    "Shot",
    "Signal",
    "UngriddedTable",
    "Unit",
    "Variable",
    "adapted",
    "header",
    "model_of",
    "read_dave_ml",
    "refuse_other_units",
    "unit_of",
    "write_dave_ml",
]
