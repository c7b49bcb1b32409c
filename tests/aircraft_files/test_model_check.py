"""Check of a DAVE-ML file alone: check shots, findings, refusals."""

import re
from pathlib import Path

import pytest

from anser.aircraft_files.check_data import check_model
from anser.config import ScenarioError

TRAINER = Path(__file__).parents[2] / "scenarios" / "own-aircraft" / "trainer.dml"
TEXT = TRAINER.read_text(encoding="utf-8")
NO_SHOTS = TEXT[TEXT.index("<checkData>") : TEXT.index("</DAVEfunc>")], ""


def checked(folder, *pairs):
    text = TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = folder / "mine.dml"
    path.write_text(text, encoding="utf-8")
    return check_model(path)


def test_check_shots_are_computed(tmp_path):
    good = check_model(TRAINER)
    assert (len(good.checked_values), good.findings) == (120, ())
    assert all(v.passed for v in good.checked_values)
    modified = checked(tmp_path, ('varID="C" units="ft" initialValue="4.9"', 'varID="C" units="ft" initialValue="5.0"'))
    assert {"C", "CM"} <= {v.location for v in modified.checked_values if not v.passed}


def test_inputs_and_outputs_have_their_names():
    names = [v.name for v in check_model(TRAINER).inputs]
    assert names[:2] == ["trueAirspeed", "angleOfAttack"]
    assert "aeroBodyMomentCoefficient_Pitch" in [v.name for v in check_model(TRAINER).outputs]


@pytest.mark.parametrize(
    ("pairs", "line", "text"),
    [
        ([('varID="IXX" units="slugft2" initialValue="948.0"', 'varID="IXX" units="slugft2" initialValue="-948.0"'),
          NO_SHOTS], 72, "bodyMomentOfInertia_Roll .IXX.: expected a positive number"),
        ([('varID="PH" units="nd"', 'varID="PH" units="none"'), NO_SHOTS], 137, 'units "none" of PH: no unit of'),
        ([("<cn>-19.67</cn>", "<cn>19.67</cn>"), NO_SHOTS], None, "Pitch by bodyAngularRate_Pitch: .* drives itself"),
        ([("<isOutput/>", ""), NO_SHOTS], None, "no variable is marked <isOutput/>"),
    ],
)  # fmt: skip
def test_a_finding_has_its_line(tmp_path, pairs, line, text):
    findings = checked(tmp_path, *pairs).findings
    matches = [f for f in findings if re.search(text, f.text)]
    assert len(matches) == 1
    assert line is None or matches[0].location == f"line {line}"


def test_a_table_and_an_input_without_use(tmp_path):
    path = tmp_path / "mine.dml"
    path.write_text(
        '<DAVEfunc><variableDef name="x" varID="x" units="nd"><isInput/></variableDef>'
        '<variableDef name="y" varID="y" units="nd" initialValue="1"><isOutput/></variableDef>'
        '<breakpointDef bpID="b"><bpVals>0 1</bpVals></breakpointDef><griddedTableDef gtID="t"><breakpointRefs>'
        '<bpRef bpID="b"/></breakpointRefs><dataTable>0 1</dataTable></griddedTableDef></DAVEfunc>',
        encoding="utf-8",
    )
    texts = [f.text for f in check_model(path).findings]
    assert texts == ["table t: no function uses it", "input x (x): no output depends on it"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<DAVEfunc>", "no XML"),
        (
            TEXT.replace('varID="MASS" units="slug"', 'varID="MASS" units="lbf"'),
            'line 67, column 3.*units="lbf" of "tot',
        ),
        (
            TEXT.replace(">angleOfAttack</signalName>", ">alphaRadians</signalName>").replace(
                "<signalUnits>deg</signalUnits>", ""
            ),
            "checkData: arrived .*no input",
        ),
    ],
)
def test_an_unreadable_file_is_refused(tmp_path, content, message):
    path = tmp_path / "mine.dml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(ScenarioError, match=message):
        check_model(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read"):
        check_model(tmp_path / "none.dml")
