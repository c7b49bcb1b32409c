"""Names of kept programs: an edit of a room costs those programs that may depend on it, and no others."""

import pytest

import anser.compiling.keys as keys
from anser.analysis.linear_models import _open_model
from anser.missions.plans import _start_flight
from anser.missions.runs import fly_segment
from anser.results import to_dataset
from anser.steady import solve_trim


@pytest.fixture
def package(tmp_path, monkeypatch):
    for place in ("shapes.py", "simulation/loop.py", "simulation/numbers.json", "report/page.py", "report/page.css"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text("1")
    monkeypatch.setattr(keys, "_PACKAGE", tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("place", "of_kernels", "of_all"),
    [
        ("shapes.py", True, True),
        ("simulation/loop.py", True, True),
        ("simulation/numbers.json", True, True),
        ("report/page.py", False, True),
        ("report/page.css", False, False),
    ],
)
def test_which_edits_change_which_hash(package, place, of_kernels, of_all):
    before = keys._hash_sources()
    (package / place).write_text("2")
    after = keys._hash_sources()
    assert [one != other for one, other in zip(before, after, strict=True)] == [of_kernels, of_all]


def test_a_file_of_another_name_is_another_source(package):
    before = keys._hash_sources()
    (package / "simulation/loop.py").rename(package / "simulation/loops.py")
    assert keys._hash_sources()[0] != before[0]


def test_programs_of_kernels_depend_on_kernels_only():
    for program in (fly_segment, _start_flight):
        assert keys._source_hash(keys.describe_value(program._function)) == keys._KERNEL_SOURCES
    for function in (to_dataset, (solve_trim, to_dataset), _open_model._function):
        assert keys._source_hash(keys.describe_value(function)) == keys._ALL_SOURCES
