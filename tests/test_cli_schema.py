"""The command schema, and the schema written by new."""

import json

import pytest


@pytest.mark.parametrize("kind", ["scenario", "study", "aircraft"])
def test_a_schema_goes_to_standard_output_or_a_new_file(anser, tmp_path, kind):
    code, printed, err = anser("schema", kind)
    assert (code, err) == (0, "")
    document = json.loads(printed)
    assert document["title"] == f"anser {kind}"
    assert document["additionalProperties"] is False
    assert json.loads(anser("schema", kind, "--json")[1]) == document
    out = tmp_path / f"anser-{kind}.schema.json"
    assert anser("schema", kind, "--out", out)[0] == 0
    assert json.loads(out.read_text()) == document
    out.write_text("old")
    code, _, err = anser("schema", kind, "--out", out)
    assert code == 2
    assert "which exists; expected a new file, or --force" in err
    assert out.read_text() == "old"
    assert anser("schema", kind, "--out", out, "--force")[0] == 0
    assert json.loads(out.read_text()) == document


def test_the_default_kind_is_scenario_and_unknown_kinds_are_refused(anser):
    assert json.loads(anser("schema")[1])["title"] == "anser scenario"
    code, _, err = anser("schema", "plane")
    assert code == 2
    assert err == "KIND: arrived 'plane'; expected one of 'scenario', 'study', 'aircraft'\n"


@pytest.mark.parametrize(("arguments", "kind"), [(("new",), "scenario"), (("aircraft", "new"), "aircraft")])
def test_new_writes_the_schema_of_its_first_line_and_keeps_an_existing_one(anser, tmp_path, arguments, kind):
    assert anser(*arguments, tmp_path / "mine.toml")[0] == 0
    first_line = (tmp_path / "mine.toml").read_text().splitlines()[0]
    assert first_line.startswith("#:schema ./")
    schema = tmp_path / first_line.removeprefix("#:schema ./")
    assert json.loads(schema.read_text()) == json.loads(anser("schema", kind)[1])
    schema.write_text("mine")
    assert anser(*arguments, tmp_path / "other.toml")[0] == 0
    assert schema.read_text() == "mine"
