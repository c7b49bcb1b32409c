"""Size and depth limits of TOML before parsing, and line numbers of problems in linear time."""

import time
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anser.config import ScenarioError
from anser.config.toml_text import DEPTH_MAX, SIZE_MAX, end_of_value, excessive_depth, parse_toml, read_text
from anser.scenario import loads
from anser.scenario.files import starter_scenario

DEEP = {
    "dotted key": "x = 1\n" + "a." * 50_000 + "b = 1",
    "table": "x = 1\n[" + "a . " * 50_000 + "b]",
    "array of tables": "x = 1\n[[" + '"a".' * 50_000 + "b]]",
    "key of an inline table": "x = 1\nb = { " + "'a'." * 50_000 + "b = 1}",
    "lists": "x = 1\nb = " + "[" * 50_000 + "]" * 50_000,
    "tables": "x = 1\nb = " + "{a = " * 50_000 + "1" + "}" * 50_000,
}


@pytest.mark.parametrize("name", DEEP)
def test_excessive_depth_is_refused_before_parsing(name):
    began = time.process_time()
    with pytest.raises(ScenarioError, match="line 2: arrived a key, list or table of more than 32 levels"):
        loads(DEEP[name], "deep.toml")
    assert time.process_time() - began < 1.0


def test_brackets_in_texts_and_comments_do_not_count():
    dots = "a." * 100 + "[" * 100
    text = f'x = "{dots}"\ny = \'{dots}\'\n# {dots}\nz = """\n{dots}\\""" "" {dots}""""\nw = \'\'\'{dots}\n\'\'\'\n'
    assert parse_toml(text, "texts")["w"] == f"{dots}\n"
    assert excessive_depth(text) is None
    key = ".".join(["a"] * DEPTH_MAX)
    assert excessive_depth(f"{key} = 1\n[{key}]\n") is None
    assert excessive_depth(f"{key}.a = 1") == 0


@pytest.mark.parametrize("text", ['"""' * 100_001, '"""\\' * 100_000, "'''" * 100_001, '"' * 100_001, "a." * 100_000])
def test_the_scan_takes_linear_time(text):
    began = time.process_time()
    excessive_depth(text)
    assert time.process_time() - began < 2.0


def test_a_large_file_is_refused_unread(tmp_path):
    path = tmp_path / "large.toml"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # sparse
    with pytest.raises(ScenarioError, match="more than 8,388,608 bytes"):
        read_text(path)
    with pytest.raises(ScenarioError, match="more than 8,388,608 bytes"):
        read_text("/dev/zero")
    with pytest.raises(ScenarioError, match="expected a text of at most 8,388,608"):
        loads("#" * (SIZE_MAX + 1))


@given(
    st.recursive(
        st.integers() | st.text("\"'#[]{}\\,\n=x", max_size=6), lambda v: st.lists(v, max_size=4), max_leaves=8
    )
)
def test_the_end_of_a_value_is_found(value):
    def written(item):
        if isinstance(item, list):
            return "[" + "".join(f"\n  {written(element)}, # ]{{\n" for element in item) + "]"
        if isinstance(item, int):
            return str(item)
        text = item.replace("\\", "\\\\").replace('"', '\\"')
        return f'"""\n{text}"""' if "\n" in item else f'"{text}"'

    text = f"a = {written(value)} # [\nb = 1\n"
    if not isinstance(value, int) or value.bit_length() < 64:
        assert tomllib.loads(text) == {"a": value, "b": 1}
    assert text[end_of_value(text, 3) :] == "\nb = 1\n"


def waypoints(count, wrong):
    points = "".join(f"  [{k}.0, 0.0, 1000.0],\n" for k in range(count))
    return starter_scenario().replace("[[goal]]\n", f"[[goal]]\nwaypoints = [\n{points}]\n", 1) + wrong


def test_the_line_of_a_wrong_value_beside_a_long_list_is_found_in_linear_time():
    text = waypoints(2000, "\n[air]\nbad = 1\n")
    line = text.count("\n", 0, text.index("[air]")) + 2
    began = time.process_time()
    with pytest.raises(ScenarioError, match=f"line {line - 1}, air"):
        loads(text, "long.toml")
    assert time.process_time() - began < 3.0
