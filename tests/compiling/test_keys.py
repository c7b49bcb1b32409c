"""Keys of stored programs: an edit of a room invalidates only programs that may depend on the room."""

import contextlib
import importlib
import pkgutil
import sys
from types import ModuleType

import numpy as np
import pytest

import anser
import anser.compiling.keys as keys
import anser.compiling.program
import anser.spatial.rotations as rotations
from anser.aircraft.airframe import MassProperties
from anser.analysis.linear_models import _open_model
from anser.analysis.loop_margins import analyse_rows
from anser.analysis.trim_points import map_points
from anser.missions.first_plan import _start_flight
from anser.missions.segments import fly_large_segment, fly_segment
from anser.results import to_dataset
from anser.steady import solve_trim


@pytest.fixture
def package(tmp_path, monkeypatch):
    kernels = ("shapes.py", "simulation/loop.py", "simulation/numbers.json", "analysis/linearization.py")
    for path in (*kernels, "analysis/margins.py", "report/page.py", "report/page.css"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text("1")
    monkeypatch.setattr(keys, "_PACKAGE", tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("path", "of_kernels", "of_all"),
    [
        ("shapes.py", True, True),
        ("simulation/loop.py", True, True),
        ("simulation/numbers.json", True, True),
        ("analysis/linearization.py", True, True),
        ("analysis/margins.py", False, True),
        ("report/page.py", False, True),
        ("report/page.css", False, False),
    ],
)
def test_edits_change_the_hashes_of_dependent_programs(package, path, of_kernels, of_all):
    former_hashes = keys._hash_sources()
    (package / path).write_text("2")
    new_hashes = keys._hash_sources()
    assert [former != new for former, new in zip(former_hashes, new_hashes, strict=True)] == [of_kernels, of_all]


def test_a_renamed_file_changes_the_hash(package):
    former_hashes = keys._hash_sources()
    (package / "simulation/loop.py").rename(package / "simulation/loops.py")
    assert keys._hash_sources()[0] != former_hashes[0]


def test_programs_of_kernels_depend_on_kernels_only():
    for program in (fly_segment, fly_large_segment, _start_flight, _open_model, analyse_rows):
        assert keys._source_hash(keys.describe_value(program._function)) == keys._KERNEL_SOURCES
    for function in (to_dataset, (solve_trim, to_dataset), map_points._function):
        assert keys._source_hash(keys.describe_value(function)) == keys._ALL_SOURCES


def test_the_key_depends_on_the_modules_behind_a_program_only(monkeypatch):
    description = keys.describe_value(fly_segment._function)
    former_hash = keys._hash_loaded_code(description)
    monkeypatch.setitem(sys.modules, "anser.steady.unused", ModuleType("anser.steady.unused"))
    monkeypatch.setattr(sys.modules["anser.steady.unused"], "NUMBER", 1.0, raising=False)
    assert keys._hash_loaded_code(description) == former_hash
    monkeypatch.setattr(rotations, "_EPSILON", 1.0, raising=False)  # two imports away
    assert keys._hash_loaded_code(description) != former_hash
    monkeypatch.undo()
    assert keys._hash_loaded_code(description) == former_hash
    for constant in (np.arange(3.0), (1.0, ("a", 2))):
        monkeypatch.setattr(rotations, "_TABLE", constant, raising=False)
        with_constant = keys._hash_loaded_code(description)
        other = (1.0, ("a", 3)) if isinstance(constant, tuple) else 2.0 * constant
        monkeypatch.setattr(rotations, "_TABLE", other)
        assert len({former_hash, with_constant, keys._hash_loaded_code(description)}) == 3
        monkeypatch.undo()
    monkeypatch.setattr(MassProperties, "doubled", keys.program_key, raising=False)  # a method of a class
    assert keys._hash_loaded_code(description) != former_hash


def test_every_program_of_the_package_has_a_key():
    """A program without a key is traced and lowered anew in every process."""
    for module in pkgutil.walk_packages(anser.__path__, "anser."):
        if not module.name.endswith("__main__"):
            with contextlib.suppress(ImportError):  # without its extra
                importlib.import_module(module.name)
    functions = [program._function for program in anser.compiling.program._programs]
    functions = [function for function in functions if getattr(function, "__module__", "anser.").startswith("anser.")]
    assert len(functions) > 60
    for function in functions:
        keys.program_key((function,))
