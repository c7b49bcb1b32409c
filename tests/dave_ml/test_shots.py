"""NASA's check shots, with internal values."""

from dataclasses import replace

import numpy as np
import pytest
from files import FEATURES, NASA, model

from anser.dave_ml import read_dave_ml
from anser.dave_ml.model import make_model

SHOTS = {"F16_aero": (16, 800, 144), "F16_prop": (9, 39, 54)}
"""Shots, internal values and outputs of each file, counted in the files."""


@pytest.mark.parametrize("name", SHOTS)
def test_all_shots_of_nasa_pass(name):
    results = model(name).check()
    kinds = [result.kind for result in results]
    assert len(model(name).definition.shots) == SHOTS[name][0]
    assert (kinds.count("internal"), kinds.count("output")) == SHOTS[name][1:]
    assert [r for r in results if not r.passed] == []
    # Internal values come without a tolerance: printed to all digits, they are met to rounding.
    internal = [abs(r.difference) / max(1.0, abs(r.expected)) for r in results if r.kind == "internal"]
    assert max(internal) < 1e-14


def test_other_files_have_no_shots():
    assert all(model(name).check() == [] for name in NASA if name not in SHOTS)


def test_shots_in_other_units_and_by_varid():
    results = model("features").check()
    assert len(results) == 5
    assert all(r.passed for r in results)


def test_a_wrong_number_in_a_table_fails_shots():
    wrong = NASA["F16_aero"].replace(b"-.416,-.731", b"-.417,-.731", 1)
    failed = [r for r in read_dave_ml(wrong, "wrong").check() if not r.passed]
    assert {"czt", "cz"} <= {r.id for r in failed}
    assert all(r.difference == pytest.approx(-0.001, rel=0.05) for r in failed)


def test_a_tolerance_is_in_the_units_of_its_signal():
    text = FEATURES.decode().replace(
        "<signal><varID>cube</varID><signalValue>0.125</signalValue><tol>1e-12</tol></signal>",
        "<signal><signalName>flap</signalName><signalUnits>rad</signalUnits><signalValue>0.1747</signalValue>"
        "<tol>0.001</tol></signal>",
    )
    flap = next(r for r in read_dave_ml(text, "f").check() if r.id == "flap" and r.kind == "output")
    assert flap.units == "deg"
    assert flap.tolerance == pytest.approx(np.degrees(0.001))
    assert flap.difference == pytest.approx(10.0 - np.degrees(0.1747))


def test_nan_does_not_pass():
    text = FEATURES.decode().replace(
        "<apply><power/><ci>x</ci><cn>3</cn></apply>", "<apply><ln/><cn>-1</cn></apply>", 1
    )
    text = text.replace("<cn>-1</cn>", "<apply><minus/><ci>x</ci><cn>9</cn></apply>", 1)
    cube = next(r for r in read_dave_ml(text, "f").check() if r.id == "cube")
    assert np.isnan(cube.computed)
    assert not cube.passed


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("<signalUnits>rad</signalUnits>", "<signalUnits>furlong</signalUnits>", "furlong"),
        (
            "<signalUnits>rad</signalUnits>",
            "<signalUnits>ft</signalUnits>",
            '"ft" of "flap" .*expected units that convert to .* "deg"',
        ),
        ("<varID>y</varID>", "<varID>k</varID>", "no input"),
    ],
)
def test_a_shot_that_cannot_be_evaluated_says_why(old, new, says):
    text = FEATURES.decode().replace(old, new, 1)
    with pytest.raises(ValueError, match=says):
        read_dave_ml(text, "f").check()


def test_shots_set_the_same_inputs():
    features = model("features")
    assert features.with_shots({}).definition.shots == ()
    with pytest.raises(ValueError, match=r'shot "b": arrived x, y; expected x, as in the first shot'):
        features.with_shots({"a": {"x": 1.0}, "b": {"x": 1.0, "y": 1.0}})


def test_computed_shots_pass_and_detect_a_change():
    aero = model("F16_aero")
    inputs = {
        "level": {
            "trueAirspeed": 500.0,
            "alpha": 3.0,
            "beta": 0.0,
            "p": 0.0,
            "q": 0.0,
            "r": 0.0,
            "el": -2.0,
            "ail": 0.0,
            "rdr": 0.0,
        }
    }
    with_shots = aero.with_shots(inputs)
    results = with_shots.check()
    assert len(results) == len(aero.definition.variables) - len(aero.inputs)
    assert all(r.passed for r in results)
    changed = replace(with_shots.definition, gridded={**with_shots.definition.gridded})
    table = changed.gridded["CX_table_def"]
    changed.gridded["CX_table_def"] = replace(table, values=table.values + 1e-6)
    assert {r.id for r in make_model(changed).check() if not r.passed} == {"cxt", "cx"}
