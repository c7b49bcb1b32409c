"""Impossible bodies and wrong units in DAVE-ML files are refused with the line."""

from pathlib import Path

import pytest

from anser.aircraft_files import read_airframe
from anser.config import ScenarioError

FOLDER = Path(__file__).parents[2] / "scenarios" / "own-aircraft"
TEXT = (FOLDER / "trainer.dml").read_text(encoding="utf-8")

NO_SHOTS = TEXT[TEXT.index("<checkData>") : TEXT.index("</DAVEfunc>")], ""
"""Replacement that removes the check shots, which refer to variables by name and units."""


def trainer_with(folder, *pairs):
    """Write the trainer's files with replacements; return the path of the aircraft file."""
    text = TEXT
    for old, new in pairs:
        assert text.count(old) == 1
        text = text.replace(old, new)
    (folder / "trainer.dml").write_text(text, encoding="utf-8")
    path = folder / "trainer.toml"
    path.write_text((FOLDER / "trainer.toml").read_text(encoding="utf-8"), encoding="utf-8")
    return path


def variable(key, value):
    """Replacement for the value of a constant of the trainer."""
    start = TEXT.index(f'varID="{key}"')
    old = TEXT[start : TEXT.index(">", start)]
    head, _, _ = old.partition("initialValue=")
    return old, f'{head}initialValue="{value}"'


@pytest.mark.parametrize(
    ("key", "value", "part", "arrived", "expected"),
    [
        ("MASS", "0.0", "inertia", r"0 slug, 0 kg, of totalMass \(MASS\)", "a positive number"),
        ("MASS", "-82.0", "inertia", r"-82 slug, -1196.7\d* kg, of totalMass", "a positive number"),
        ("IXX", "-948.0", "inertia", "-948 slugft2, .* of bodyMomentOfInertia_Roll", "a positive number"),
        ("IZZ", "2500.0", "inertia", "2500 slugft2, .* of bodyMomentOfInertia_Yaw", r"at most Jxx \+ Jyy, 3110"),
        ("IZX", "1400.0", "inertia", "1400 slugft2, .* of bodyProductOfInertia_ZX", "positive definite"),
        ("IZX", "700.0", "inertia", "700 slugft2, .* of bodyProductOfInertia_ZX", "the sum of the other two"),
        ("S", "-174.0", "aerodynamics", "-174 ft2, .* of referenceWingArea", "a positive number"),
        ("B", "0.0", "aerodynamics", "0 ft, 0 m, of referenceWingSpan", "a positive number"),
        ("C", "-4.9", "aerodynamics", "-4.9 ft, .* of referenceWingChord", "a positive number"),
    ],
)
def test_an_impossible_body_is_refused_with_its_position(tmp_path, key, value, part, arrived, expected):
    pair = variable(key, value)
    line = TEXT[: TEXT.index(pair[0])].count("\n") + 1
    position = rf"dave_ml.{part} \(trainer.dml, line {line}, column \d+\)"
    with pytest.raises(ScenarioError, match=f"{position}: arrived {arrived}.*; expected .*{expected}"):
        read_airframe(trainer_with(tmp_path, pair))


def test_a_body_that_can_be_is_read(tmp_path):
    file = read_airframe(trainer_with(tmp_path, variable("IZX", "300.0"), variable("IXX", "1100.0")))
    assert file.name == "trainer"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('varID="MASS" units="slug"', 'varID="MASS" units=""', 'units="" of "totalMass" .* expected a mass'),
        ('varID="S" units="ft2"', 'varID="S" units="ft"', 'units="ft" of "referenceWingArea" .* expected an area'),
        ('varID="ALPHA" units="deg"', 'varID="ALPHA" units=""', 'units="" of "angleOfAttack" .* expected an angle'),
        ('varID="DE" units="deg"', 'varID="DE" units="kt"', 'units="kt" of "elevatorDeflection" .* expected an angle'),
    ],
)
def test_wrong_units_are_refused_with_their_position(tmp_path, old, new, message):
    line = TEXT[: TEXT.index(old)].count("\n") + 1
    position = rf"dave_ml.aerodynamics \(trainer.dml, line {line}, column 3\)"
    with pytest.raises(ScenarioError, match=f"{position}: arrived {message}"):
        read_airframe(trainer_with(tmp_path, (old, new)))


def test_the_input_of_a_surface_is_an_angle(tmp_path):
    path = trainer_with(
        tmp_path, ('name="elevatorDeflection" varID="DE" units="deg"', 'name="tail" varID="DE" units=""'), NO_SHOTS
    )
    text = path.read_text(encoding="utf-8").replace('name = "elevator"', 'name = "elevator"\ninput = "tail"')
    path.write_text(text, encoding="utf-8")
    message = r'surface\[0\].input \(trainer.dml, line \d+, column 3\): arrived units="" of "tail" .* expected an angle'
    with pytest.raises(ScenarioError, match=message):
        read_airframe(path)


def test_a_name_in_the_aircraft_file_needs_its_units(tmp_path):
    path = trainer_with(
        tmp_path, ('name="totalMass" varID="MASS" units="slug"', 'name="m" varID="MASS" units="lbf"'), NO_SHOTS
    )
    text = path.read_text(encoding="utf-8").replace("[dave_ml]", '[dave_ml]\nnames = { totalMass = "m" }')
    path.write_text(text, encoding="utf-8")
    with pytest.raises(
        ScenarioError, match=r'line 67, column 3\): arrived units="lbf" of "totalMass" .* expected a mass'
    ):
        read_airframe(path)
