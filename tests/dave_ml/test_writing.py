"""Written files read as the same model."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from files import ALL, FEATURES, formula_model, model
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from anser.dave_ml import read_dave_ml, write_dave_ml
from anser.dave_ml.definition import Argument, Breakpoints, Definition, Function, GriddedTable, Note, Variable
from anser.dave_ml.formulas import (
    ARGUMENTS_MAX,
    COMPARISONS,
    LOGICAL,
    NUMERIC,
    Number,
    Operation,
    Piecewise,
    VariableReference,
    format_mathml,
)
from anser.dave_ml.model import make_model

ORDER = ["fileHeader", "variableDef", "breakpointDef", "griddedTableDef", "ungriddedTableDef", "function", "checkData"]
"""Elements in <DAVEfunc> in the order of the document type."""


@pytest.mark.parametrize("name", ALL)
def test_every_written_file_reads_as_the_same_model(name):
    original = model(name)
    text = write_dave_ml(original)
    reread = read_dave_ml(text, "again")
    assert write_dave_ml(reread) == text
    a, b = original.definition, reread.definition
    assert (a.header, a.variables, a.functions, a.shots) == (b.header, b.variables, b.functions, b.shots)
    assert list(a.gridded) == list(b.gridded)
    for key, table in a.gridded.items():
        np.testing.assert_array_equal(table.values, b.gridded[key].values)
    for key, points in a.breakpoints.items():
        np.testing.assert_array_equal(points.points, b.breakpoints[key].points)
    inputs = {key: 0.3 * (k + 1) for k, key in enumerate(original.inputs)}
    variables = tuple(a.variables)
    evaluate = eqx.filter_jit(lambda evaluator: evaluator.evaluate(inputs, variables))
    ours, theirs = evaluate(original.evaluator), evaluate(reread.evaluator)
    assert {key: float(value) for key, value in ours.items()} == {key: float(value) for key, value in theirs.items()}


@pytest.mark.parametrize("name", ALL)
def test_written_files_are_well_formed_and_in_document_order(name):
    root = etree.fromstring(write_dave_ml(model(name)).encode(), etree.XMLParser(load_dtd=False, no_network=True))
    assert root.tag == "{http://daveml.org/2010/DAVEML}DAVEfunc"
    positions = [ORDER.index(etree.QName(child).localname) for child in root]
    assert positions == sorted(positions)
    assert all(child.tag.startswith("{http://www.w3.org/1998/Math/MathML}") for child in root.iter("{*}apply"))


def formulas(depth):
    numbers = st.floats(-1e6, 1e6).map(Number) | st.sampled_from([VariableReference("x"), VariableReference("y")])
    if depth == 0:
        return numbers
    inner = formulas(depth - 1)

    def applied(operation):
        count_min, count_max = {**NUMERIC, **COMPARISONS, **LOGICAL}[operation]
        arguments = st.lists(inner, min_size=count_min, max_size=3 if count_max == ARGUMENTS_MAX else count_max)
        return arguments.map(lambda operands: Operation(operation, tuple(operands)))

    chosen = st.builds(
        lambda v, c, o: Piecewise(((v, c),), o), inner, st.sampled_from(sorted(COMPARISONS)).flatmap(applied), inner
    )
    return numbers | st.sampled_from(sorted({**NUMERIC, **COMPARISONS, **LOGICAL})).flatmap(applied) | chosen


@settings(deadline=None, max_examples=60)
@given(formula=formulas(2).filter(lambda formula: str(VariableReference("x")) in str(formula)))
def test_formulas_are_read_as_they_were_written(formula):
    assert formula_model(format_mathml(formula)).definition.variables["z"].formula == formula


VALUES = {
    "power": (lambda a, b: a**b, (1.7, 2.3)),
    "root": (lambda a, b: a ** (1 / b), (1.7, 3.0)),
    "log": (lambda a, b: math.log(a, b), (1.7, 3.0)),
    "atan2": (math.atan2, (-0.3, -0.4)),
    "sec": (lambda a: 1 / math.cos(a), (0.4,)),
    "csc": (lambda a: 1 / math.sin(a), (0.4,)),
    "cot": (lambda a: 1 / math.tan(a), (0.4,)),
    "arcsin": (math.asin, (0.4,)),
    "arccos": (math.acos, (0.4,)),
    "arctan": (math.atan, (0.4,)),
    "arcsinh": (math.asinh, (0.4,)),
    "arccosh": (math.acosh, (1.4,)),
    "arctanh": (math.atanh, (0.4,)),
    "arcsec": (lambda a: math.acos(1 / a), (-1.4,)),
    "arccsc": (lambda a: math.asin(1 / a), (-1.4,)),
    "arccot": (lambda a: math.atan(1 / a), (-0.4,)),  # Abramowitz and Stegun, eq. 4.4.8: odd, unlike pi/2 - arctan
    "sech": (lambda a: 1 / math.cosh(a), (0.4,)),
    "csch": (lambda a: 1 / math.sinh(a), (-0.4,)),
    "coth": (lambda a: 1 / math.tanh(a), (-0.4,)),
    "arcsech": (lambda a: math.acosh(1 / a), (0.4,)),
    "arccsch": (lambda a: math.asinh(1 / a), (-0.4,)),
    "arccoth": (lambda a: math.atanh(1 / a), (-1.4,)),
    "ln": (math.log, (0.4,)),
    "abs": (abs, (-0.4,)),
    "ceiling": (math.ceil, (-1.4,)),
    "plus": (lambda *a: sum(a), (1.0, 2.5, -4.0)),
    "minus": (lambda a, b: a - b, (1.0, 2.5)),
    "times": (lambda *a: math.prod(a), (1.0, 2.5, -4.0)),
    "divide": (lambda a, b: a / b, (1.0, 2.5)),
    "min": (min, (1.0, 2.5, -4.0)),
    "max": (max, (1.0, 2.5, -4.0)),
    **{name: (getattr(math, name), (0.4,)) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "floor")},
    # of more than two arguments, each with the next
    "lt": (lambda a, b, c: float(a < b < c), (1.0, 2.0, 1.5)),
    "leq": (lambda a, b, c: float(a <= b <= c), (1.0, 1.0, 1.5)),
    "gt": (lambda a, b: float(a > b), (1.0, 2.0)),
    "geq": (lambda a, b: float(a >= b), (2.0, 2.0)),
    "eq": (lambda a, b, c: float(a == b == c), (2.0, 2.0, 3.0)),
    "neq": (lambda a, b: float(a != b), (2.0, 3.0)),
    "and": (lambda a, b: float(bool(a and b)), (2.0, 0.0)),
    "or": (lambda a, b: float(bool(a or b)), (2.0, 0.0)),
    "xor": (lambda a, b: float(bool(a) != bool(b)), (2.0, 1.0)),
    "not": (lambda a: float(not a), (0.0,)),
}  # fmt: skip


@pytest.mark.parametrize("operation", VALUES)
def test_operations_are_those_of_mathml(operation):
    function, arguments = VALUES[operation]
    assert set(VALUES) == {*NUMERIC, *COMPARISONS, *LOGICAL}
    # from inputs in JAX, and from constants at reading
    of_inputs = format_mathml(
        Operation(
            operation, (Operation("plus", (Number(arguments[0]), VariableReference("x"))), *map(Number, arguments[1:]))
        )
    )
    of_constants = format_mathml(Operation(operation, tuple(map(Number, arguments))))
    expected = function(*arguments)
    assert float(formula_model(of_inputs).evaluate({"x": 0.0})["z"]) == pytest.approx(expected, rel=1e-14)
    assert float(formula_model(of_constants).evaluate({})["z"]) == pytest.approx(expected, rel=1e-14)


def test_a_model_made_in_python_is_written_and_read():
    definition = Definition(
        file="own",
        header=Note(
            "fileHeader",
            (("name", "Wing <of> ours"),),
            children=(
                Note("author", (("name", "A. Nyone"), ("org", "anser"))),
                Note("creationDate", (("date", "2026-11-25"),)),
                Note("fileVersion", text="1"),
                Note("description", text='lift & "drag"'),
            ),
        ),
        variables={
            v.id: v
            for v in (
                Variable("alpha", "angleOfAttack", "deg", roles=frozenset({"isInput", "isStdAIAA"}), minimum=-5.0),
                Variable("CL", "liftCoefficient", "nd", roles=frozenset({"isOutput"})),
                Variable("k", "induced drag factor", "nd", initial=0.05, notes=(Note("provenanceRef", (("provID", "P"),)),)),
                Variable(
                    "CD", "dragCoefficient", "nd", roles=frozenset({"isOutput"}),
                    formula=Operation("plus", (Number(0.02), Operation("times", (VariableReference("k"), VariableReference("CL"), VariableReference("CL"))))),
                ),
            )
        },
        breakpoints={"A": Breakpoints("A", np.array([-5.0, 0.0, 10.0]), units="deg")},
        gridded={"T": GriddedTable("T", ("A",), np.array([-0.4, 0.1, 1.0]))},
        functions=(Function("lift", "CL", (Argument("alpha", extrapolate="max"),), "T"),),
    )  # fmt: skip
    original = make_model(definition).with_shots({"cruise": {"alpha": 2.0}, "stall": {"alpha": 12.0}}, tolerance=1e-6)
    reread = read_dave_ml(write_dave_ml(original), "own.dml")
    assert reread.definition.header.get("name") == "Wing <of> ours"
    assert reread.definition.variables == original.definition.variables
    results = reread.check()
    assert [r.id for r in results] == ["k", "CL", "CD"] * 2
    assert all(r.passed for r in results)
    assert [r.tolerance for r in results if r.id == "CL"] == [1e-6, pytest.approx(1.18e-6)]
    np.testing.assert_allclose(reread.evaluate({"alpha": jnp.array(12.0)})["CD"], 0.02 + 0.05 * 1.18**2, rtol=1e-14)


def test_shots_without_outputs_and_the_provenance_of_shots_are_written():
    note = '<provenance><author name="A" org="B"/></provenance>'
    text = FEATURES.decode().replace("<checkData>", f"<checkData>{note}").replace("<isOutput/>", "")
    original = read_dave_ml(text, "f")
    reread = read_dave_ml(write_dave_ml(original), "again")
    assert original.definition.check_notes == reread.definition.check_notes
    assert [child.get("name") for child in reread.definition.check_notes[0].children] == ["A"]
    without_outputs = original.with_shots({"a": {"x": 0.5, "y": 0.25, "flap": 10.0}})
    assert without_outputs.definition.check_notes == ()
    assert read_dave_ml(write_dave_ml(without_outputs), "f").definition.shots == without_outputs.definition.shots


def test_names_of_more_than_one_variable_are_written_by_varid():
    text = FEATURES.decode().replace('name="second"', 'name="first"').replace(
        "<signalName>first</signalName><signalUnits>nd</signalUnits>", "<varID>x</varID>"
    )  # fmt: skip
    written = write_dave_ml(read_dave_ml(text, "f"))
    assert "<signalName>first</signalName>" not in written
    in_other_units = FEATURES.decode().replace('name="second"', 'name="flap"').replace(
        "<signalName>flap</signalName>", "<varID>flap</varID>"
    )  # fmt: skip
    written = write_dave_ml(read_dave_ml(in_other_units, "f"))
    assert "<signalName>flap</signalName>" not in written
    assert all(r.passed for r in read_dave_ml(written, "again").check())
