"""Reading of DAVE-ML files, and messages for invalid files: position, content, expected content."""

import numpy as np
import pytest
from files import FEATURES, HEAD, NASA, formula_model, model

from anser.dave_ml import DaveMlError, read_dave_ml
from anser.dave_ml.formulas import Number, Operation, Piecewise, VariableReference


def test_the_aerodynamics_of_nasa():
    file = model("F16_aero").definition
    assert (len(file.variables), len(file.breakpoints), len(file.gridded), len(file.functions)) == (50, 4, 18, 18)
    beta = file.variables["beta"]
    assert (beta.name, beta.units, beta.sign, beta.symbol) == ("angleOfSideslip", "deg", "wind in right ear", "β")
    assert beta.roles == {"isInput", "isStdAIAA"}
    assert file.variables["vt"].minimum == 0.1
    lift = file.gridded["CX_table_def"]
    assert lift.axes == ("DE1", "ALPHA1")
    assert lift.values.shape == (5, 12)
    assert (lift.values[0, 0], lift.values[4, 11]) == (-0.099, 0.040)
    function = next(f for f in file.functions if f.result == "cxt")
    assert [(a.id, a.minimum, a.maximum, a.extrapolate, a.interpolate) for a in function.arguments] == [
        ("el", -24.0, 24.0, "neither", "linear"),
        ("alpha", -10.0, 45.0, "neither", "linear"),
    ]


def test_the_header_has_author_dates_and_references():
    header = model("F16_aero").definition.header
    assert header.get("name") == "F-16 Subsonic Aerodynamics Model (a la Garza)"
    assert header.all("author")[0].get("email") == "bruce.jackson@nasa.gov"
    assert header.all("creationDate")[0].get("date") == "2003-06-10"
    assert len(header.all("modificationRecord")) == 16
    assert [note.get("refID") for note in header.all("reference")] == ["REF01", "REF02", "REF03", "REF04", "NOTE1"]
    function = model("F16_aero").definition.functions[0]
    assert [note.get("refID") for note in function.notes[0].all("documentRef")] == ["REF01", "REF02", "REF03"]


def test_calculations_become_formulas():
    variables = model("F16_aero").definition.variables
    assert variables["del"].formula == Operation("divide", (VariableReference("el"), Number(25.0)))
    negative = Operation("minus", (VariableReference("absCl0"),))
    below = Operation("lt", (VariableReference("beta"), Number(0.0)))
    assert variables["clt"].formula == Piecewise(((negative, below),), VariableReference("absCl0"))
    gnc = model("F16_gnc").definition.variables["baseChiCmdEquatorIDL"].formula
    assert gnc.arguments[0].arguments[0] == Operation(
        "atan2", (VariableReference("ownshipN_ft"), VariableReference("ownshipE_ft"))
    )


def test_text_and_bytes_in_any_of_the_encodings_read_the_same():
    text = FEATURES.decode()
    bare = text.partition("?>")[2]
    for content in (text, bare.encode(), bare.encode("utf-16"), ("\ufeff" + text).encode(), "\ufeff" + text):
        assert read_dave_ml(content, "f").definition.variables == model("features").definition.variables
    latin = f'<?xml version="1.0" encoding="ISO-8859-1"?>{bare}'.replace("no aircraft", "no aéroplane").encode(
        "latin-1"
    )
    assert "aéroplane" in read_dave_ml(latin, "f").definition.header.all("description")[0].text


def test_definitions_may_stand_in_any_order():
    # NASA's control law uses trimmedTheta before it defines it.
    order = list(model("F16_control").definition.variables)
    assert order.index("thetaCmd") < order.index("trimmedTheta")


X = "<ci>x</ci>"
FAULTS = {
    "not XML": ("<DAVEfunc>", "no XML: no element found; expected well-formed XML"),
    "not DAVE-ML": ("<svg/>", "line 1, column 1: arrived <svg>; expected <DAVEfunc>"),
    "no variables": ("<DAVEfunc/>", "no <variableDef>; expected at least one"),
    "unknown element": (f"{HEAD}<table/></DAVEfunc>", "<table> in <DAVEfunc>; expected elements breakpointDef,"),
    "unknown attribute": (
        HEAD.replace("units", "unit", 1) + "</DAVEfunc>",
        'attribute "unit" of <variableDef>; expected attributes alias',
    ),
    "missing attribute": (HEAD.replace('varID="y"', "") + "</DAVEfunc>", "<variableDef> without attribute varID"),
    "varID twice": (HEAD.replace('varID="y"', 'varID="x"') + "</DAVEfunc>", 'a second varID "x", the first in line 1'),
    "limits crossed": (
        HEAD.replace('units="nd"', 'units="nd" minValue="2" maxValue="1"', 1) + "</DAVEfunc>",
        "minValue 2 above",
    ),
    "no number": (
        HEAD.replace('units="nd"', 'units="nd" initialValue="nan"', 1) + "</DAVEfunc>",
        '"nan" as initialValue',
    ),
    "too large a number": (
        HEAD.replace('units="nd"', 'units="nd" maxValue="1e999"', 1) + "</DAVEfunc>",
        "that 64 bits can hold",
    ),
    "entity": (f"<!DOCTYPE DAVEfunc>{HEAD}&bomb;</DAVEfunc>", "no XML: undefined entity"),
    "declared entity": (f'<!DOCTYPE DAVEfunc [<!ENTITY a "b">]>{HEAD}</DAVEfunc>', "declarations of its own"),
    "entity of a file that is not fetched": (
        f'<!DOCTYPE DAVEfunc SYSTEM "file:///etc/passwd">{HEAD}<description>&secret;</description></DAVEfunc>',
        'entity "secret"',
    ),
    "too deep": (HEAD + "<a>" * 200, "nested more than 100 deep"),
    "encoding": (b'<?xml version="1.0" encoding="ebcdic"?><DAVEfunc/>', "expected UTF-8"),
    "encoding that is no plain text": (
        b'<?xml version="1.0" encoding="punycode"?><DAVEfunc/>',
        '"punycode"; expected UTF-8',
    ),
    "bytes of another encoding": (b"<DAVEfunc>\xff</DAVEfunc>", "bytes that are not utf-8"),
    "breakpoints": (
        f'{HEAD}<breakpointDef bpID="b"><bpVals>1 2 2</bpVals></breakpointDef></DAVEfunc>',
        "breakpoint 2 after 2",
    ),
    "no breakpoints": (
        f'{HEAD}<breakpointDef bpID="b"><bpVals> </bpVals></breakpointDef></DAVEfunc>',
        "no numbers in breakpoints b",
    ),
}
FORMULAS = {
    "unknown operation": (f"<apply><integrate/>{X}</apply>", "<integrate> as an operation; expected one of abs, and, arccos"),
    "quotient": (f"<apply><quotient/>{X}{X}</apply>", "expected <divide/> or <floor/>"),
    "unknown function": (f"<apply><csymbol>sgn</csymbol>{X}</apply>", 'function "sgn"; expected atan2'),
    "too few": (f"<apply><divide/>{X}</apply>", "<divide/> of 1 arguments; expected 2"),
    "too many": (f"<apply><minus/>{X}{X}{X}</apply>", "<minus/> of 3 arguments; expected 1 or 2"),
    "degree": (f"<apply><root/>{X}<cn>3</cn></apply>", "<root/> of 2 arguments; expected 1, and <degree>"),
    "no otherwise": (f"<piecewise><piece>{X}<apply><lt/>{X}{X}</apply></piece></piecewise>", "<piecewise> without <otherwise>"),
    "piece": (f"<piecewise><piece>{X}</piece><otherwise>{X}</otherwise></piecewise>", "1 elements in <piece>"),
    "two formulas": (X + X, "2 elements in <math>; expected one"),
    "empty": ("<ci> </ci>", "an empty <ci>"),
    "unknown variable": ("<ci>v</ci>", 'variable "v" as a source of "z"'),
    "number": ("<cn>1_0</cn>", '"1_0" as a number'),
    "kind of number": ('<cn type="rational">1<sep/>2</cn>', 'a number of type "rational"'),
    "itself": ("<apply><plus/><ci>z</ci><cn>1</cn></apply>", "a cycle of calculations: z needs z"),
    "no finite constant": ("<apply><divide/><cn>1</cn><cn>0</cn></apply>", 'inf as the value of "z", calculated from constants'),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_a_fault_of_the_file_is_reported(case):
    content, says = FAULTS[case]
    with pytest.raises(DaveMlError) as caught:
        read_dave_ml(content, "file.dml")
    assert str(caught.value).startswith("file.dml")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("case", FORMULAS)
def test_a_fault_of_a_formula_is_reported(case):
    content, says = FORMULAS[case]
    with pytest.raises(DaveMlError, match=r"^formula, line 1, column \d+: arrived") as caught:
        formula_model(content)
    assert says in str(caught.value)


CHANGES = {
    "table's size": ("3, 1, -2, 4, 4.5", "3, 1, -2, 4", "4 numbers in table LINE; expected 5 = 5, by its breakpoints"),
    "missing breakpoints": ('<bpRef bpID="F"/>', '<bpRef bpID="G"/>', 'bpID "G"; expected the bpID of a <breakpointDef>'),
    "missing table": ('<griddedTableRef gtID="SOLID"/>', '<griddedTableRef gtID="S"/>', 'gtID "S"; expected the gtID'),
    "other kind": ('<griddedTableRef gtID="SOLID"/>', '<griddedTableRef gtID="CUBE"/>', "this is the other kind of table"),
    "arguments": ('<independentVarRef varID="flap" extrapolate="min"/>', "", "2 arguments of a function with a table of 3"),
    "result": ('<dependentVarRef varID="deep"/>', '<dependentVarRef varID="d"/>', 'a function of variable "d"'),
    "two functions": ('<dependentVarRef varID="deep"/>', '<dependentVarRef varID="mixed"/>', "a second function"),
    "two sources": ('<dependentVarRef varID="deep"/>', '<dependentVarRef varID="cube"/>', "with a calculation and function"),
    "calculated input": ('<dependentVarRef varID="deep"/>', '<dependentVarRef varID="x"/>', 'input "x" with function'),
    "argument": ('varID="line_both"/><dep', 'varID="b"/><dep', 'variable "b" as a source of "deep"'),
    "extrapolate": ('extrapolate="max"', 'extrapolate="up"', 'extrapolate="up"; expected neither or min or max or both'),
    "spline": ('interpolate="floor"', 'interpolate="cubicSpline"', "DAVE-ML leaves open which spline it is"),
    "min above max": ('min="-0.7"', 'min="2"', "min 2 above max 1.6"),
    "points in a plane": ("<dataPoint>0.1 0.2 70 5</dataPoint><dataPoint>0.3 -0.2 12 -1</dataPoint>", "", "points span no volume"),
    "points at one place": ("<dataPoint>0.2 -3</dataPoint>", "<dataPoint>1 -3</dataPoint>", "two points at one place"),
    "a point's numbers": ("<dataPoint>0.2 -3</dataPoint>", "<dataPoint>1 -3 4</dataPoint>", "3 numbers of a point; expected 2"),
    "scattered steps": ('varID="flap" min="-5"', 'interpolate="floor" varID="flap" min="-5"', "interpolation other than linear"),
    "scattered ends": ('varID="flap" min="-5"', 'extrapolate="min" varID="flap" min="-5"', "min and neither of scattered"),
    "a cycle": ('<dependentVarRef varID="two_axes"/>', '<dependentVarRef varID="line_limited"/>', "a second function"),
    "signal": ("<signalName>first</signalName>", "<signalName>third</signalName>", 'signal "third", a name of 0 variables'),
    "signal twice": ("<varID>y</varID>", "<varID>x</varID>", 'a second <signal> of "x" in <checkInputs>'),
    "tolerance": ("<tol>1e-12</tol>", "<tol>-1</tol>", "a tolerance of -1"),
    "no value": ("<signalValue>0.25</signalValue>", "", "<signal> without <signalValue>"),
}  # fmt: skip


@pytest.mark.parametrize("case", CHANGES)
def test_a_contradiction_is_reported(case):
    old, new, says = CHANGES[case]
    text = FEATURES.decode()
    assert old in text
    with pytest.raises(DaveMlError) as caught:
        read_dave_ml(text.replace(old, new, 1), "file.dml")
    assert says in str(caught.value)
    assert caught.value.line is not None


def test_a_cycle_through_tables_is_named():
    text = FEATURES.decode().replace('<independentVarRef varID="two_axes"/>', '<independentVarRef varID="chain"/>')
    text = text.replace(
        '<variableDef name="chained value" varID="chained"',
        '<variableDef name="chain" varID="chain" units="nd"><calculation><math><apply><cos/><ci>deep</ci></apply></math>'
        '</calculation></variableDef><variableDef name="chained value" varID="chained"',
    )
    with pytest.raises(
        DaveMlError, match=r"a cycle of calculations: (deep needs chain needs deep|chain needs deep needs chain)"
    ):
        read_dave_ml(text, "f")


def test_the_place_of_a_fault():
    wrong = NASA["F16_aero"].replace(b"-.099,-.081", b"-.099,-.O81", 1)
    with pytest.raises(DaveMlError) as caught:
        read_dave_ml(wrong, "F16_aero.dml")
    line = wrong[: wrong.index(b"<dataTable>")].count(b"\n") + 1  # where the table begins
    assert str(caught.value).startswith(f'F16_aero.dml, line {line}, column 9: arrived "-.O81" in table')
    assert (caught.value.line, caught.value.column) == (line, 9)


def test_inline_points_of_a_function():
    file = model("features").definition
    function = next(f for f in file.functions if f.result == "simple")
    table = file.gridded[function.table]
    assert [file.breakpoints[axis].points.tolist() for axis in table.axes] == [[-1.0, 0.0, 2.0], [-1.0, 1.0]]
    np.testing.assert_array_equal(table.values, [[1.0, 2.0], [3.0, 5.0], [-4.0, -9.0]])
