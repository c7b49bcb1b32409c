"""Documents of the live page: TOML with comments kept, files and code confined to the folder."""

import json
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.config.errors import ScenarioError
from anser.config.shipped_files import shipped_files
from anser.live.documents import DocumentFolder, merge_into_toml

TEXT = Path(shipped_files()["storm-sampling"]).read_text(encoding="utf-8")


def document():
    return tomllib.loads(TEXT)


def test_an_unchanged_document_keeps_its_text():
    assert merge_into_toml(TEXT, json.loads(json.dumps(document()))) == TEXT


def test_comments_stay_where_values_change():
    values = document()
    values["goal"][0]["north_m"] = 1234.5
    values["wind"]["speed_m_s"] = 3.0
    merged = merge_into_toml(TEXT, values)
    assert tomllib.loads(merged) == values
    comments = [line for line in TEXT.splitlines() if line.startswith("#")]
    assert comments
    assert all(comment in merged for comment in comments)


COMMENTED = """
[[event]]
time_s = 5.0 # first
kind = "goal-stops"

[[event]]
time_s = 10.0 # second
kind = "goal-stops"

[[event]]
time_s = 20.0 # third
kind = "goal-stops"
"""


@pytest.mark.parametrize(
    ("times_s", "comments"),
    [
        ((5, 11, 20), ["first", "second", "third"]),  # one is changed; the page writes 5.0 as 5
        ((5, 20), ["first", "third"]),
        ((10, 20), ["second", "third"]),
        ((5, 7, 10, 20, 30), ["first", "second", "third"]),
        ((6, 11, 21), ["first", "second", "third"]),
    ],
)
def test_tables_without_a_name_keep_their_comments(times_s, comments):
    values = {"event": [{"time_s": time_s, "kind": "goal-stops"} for time_s in times_s]}
    merged = merge_into_toml(COMMENTED, values)
    assert tomllib.loads(merged) == values
    assert [line.rpartition("# ")[2] for line in merged.splitlines() if "#" in line] == comments


numbers = st.floats(-1e6, 1e6, allow_nan=False) | st.integers(-(10**6), 10**6)


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_any_edit_is_read_back(data):
    """Values moved, tables added, removed and sorted anew: the text has exactly the values of the document."""
    values = document()
    for goal in values["goal"]:
        goal["north_m"] = data.draw(numbers)
    values["aircraft"] = data.draw(st.permutations(values["aircraft"]))[: data.draw(st.integers(1, 4))]
    values["aircraft"].append({"name": "new", "goal": "core", "start": {"north_m": data.draw(numbers), "east_m": 0.5}})
    if data.draw(st.booleans()):
        values["keep_out"] = [{"name": "cell", "north_m": 1.0, "east_m": data.draw(numbers), "radius_m": 500}]
    if data.draw(st.booleans()):
        values["event"] = [{"time_s": 3.5, "kind": "goal-turns", "goal": "core", "course_deg": 90.0}]
    if data.draw(st.booleans()):
        del values["wind"]
    assert tomllib.loads(merge_into_toml(TEXT, values)) == values


def test_a_value_without_a_form_in_toml_is_refused():
    with pytest.raises(ValueError, match="seed is None, which has no form in a scenario file"):
        merge_into_toml(TEXT, document() | {"seed": None})


@pytest.mark.parametrize("name", ["../other.toml", "/etc/passwd", "a/b.toml", "x.txt", ".hidden.toml", "x\0.toml", ""])
def test_names_outside_the_folder_are_refused(tmp_path, name):
    folder = DocumentFolder(tmp_path)
    with pytest.raises(ScenarioError, match="the name of a file in the folder"):
        folder.read(name)
    with pytest.raises(ScenarioError, match="the name of a file in the folder"):
        folder.save(name, document(), None, overwrite=True)


def test_links_out_of_the_folder_are_refused(tmp_path):
    inside, outside = tmp_path / "inside", tmp_path / "outside.toml"
    inside.mkdir()
    outside.write_text(TEXT)
    (inside / "link.toml").symlink_to(outside)
    assert DocumentFolder(inside).names() == []
    with pytest.raises(ScenarioError, match="the name of a file in the folder"):
        DocumentFolder(inside).read("link.toml")


def test_nothing_is_overwritten_silently(tmp_path):
    folder = DocumentFolder(tmp_path)
    folder.save("mine.toml", document(), None, overwrite=False)
    written = (tmp_path / "mine.toml").read_bytes()
    changed = document() | {"seed": 7}
    with pytest.raises(FileExistsError):
        folder.save("mine.toml", changed, None, overwrite=False)
    assert (tmp_path / "mine.toml").read_bytes() == written
    folder.save("mine.toml", changed, "mine.toml", overwrite=True)
    assert folder.read("mine.toml")[1] == changed
    assert folder.names() == ["mine.toml"]


def test_an_invalid_document_is_not_saved(tmp_path):
    values = document()
    values["fleet"]["speed_m_s"] = -1.0
    with pytest.raises(ScenarioError, match=r"fleet\.speed_m_s"):
        DocumentFolder(tmp_path).save("mine.toml", values, None, overwrite=False)
    assert not list(tmp_path.iterdir())


def test_code_and_files_from_elsewhere_are_refused(tmp_path):
    folder = DocumentFolder(tmp_path)
    with pytest.raises(ScenarioError, match="does not import other code"):
        folder.scenario(document() | {"parts": {"controller": "os:system"}})
    values = document()
    values["aircraft"][0]["airframe"] = "../../etc/passwd"
    with pytest.raises(ScenarioError, match=r"aircraft\[0\]\.airframe.*a file in the folder"):
        folder.scenario(values)
    values = document() | {"atmosphere": {"sounding": "../sounding.csv"}}
    with pytest.raises(ScenarioError, match=r"atmosphere\.sounding.*a file in the folder"):
        folder.scenario(values)
    values = document() | {"wind": {"field": "../winds.nc"}}
    with pytest.raises(ScenarioError, match=r"wind\.field.*a file in the folder"):
        folder.scenario(values)
    values["wind"]["field"] = {"path": "/etc/hostname", "sha256": "0" * 64}
    with pytest.raises(ScenarioError, match=r"wind\.field\.path.*a file in the folder"):
        folder.scenario(values)
    for begun in ({"path": "/etc/passwd", "sha256": "0" * 64}, None):
        with pytest.raises(ScenarioError, match=r"wind\.field\.path.*a file in the folder"):
            DocumentFolder(tmp_path, wind_field=begun).scenario(values)
    values["wind"].pop("speed_m_s", None)
    DocumentFolder(tmp_path, wind_field=values["wind"]["field"]).scenario(values)


@pytest.mark.parametrize("value", ["inf", "nan", "2026-11-26", "[1, {a = 12:30:00}]"])
def test_a_file_with_a_value_of_no_key_is_not_opened(tmp_path, value):
    (tmp_path / "odd.toml").write_text(f"{TEXT}\n[extra]\nvalue = {value}\n")
    with pytest.raises(ScenarioError, match=r"extra\.value.*expected a text, a finite number"):
        DocumentFolder(tmp_path).read("odd.toml")
