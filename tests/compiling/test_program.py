"""Programs stored between processes: bit-identical results, and no failure caused by a defective store."""

import functools
import logging
import os
import pickle
import platform
import subprocess
import sys
import threading
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser.compiling.keys as keys
import anser.compiling.program as memory
import anser.compiling.program as program_module
import anser.compiling.store as store_module
from anser.aircraft_files import load_airframe
from anser.compiling.keys import NotCacheableError, describe_value
from anser.compiling.options import compiled, compiled_quickly, program_store
from anser.compiling.program import (
    PreparedProgram,
    forget_programs,
    memory_region_share,
    release_all_programs,
    use_program_store,
)
from anser.compiling.store import FolderStore
from anser.environment import standard_environment
from anser.numerics.linear import cross, solve3, times3
from anser.steady import solve_trim, trim_target

MATRIX, VECTOR = jnp.array([[2.0, 1.0, 0.0], [0.5, 3.0, 0.2], [0.0, 0.1, 1.5]]), jnp.array([1.0, 2.0, 3.0])


@pytest.fixture
def store(tmp_path):
    """A temporary store in use; afterwards the store of the test suite is restored."""
    temporary = FolderStore(tmp_path / "programs")
    use_program_store(temporary)
    yield temporary
    use_program_store(program_store())


def solved(kind=compiled):
    """A compiled function of the package, without programs in this process."""
    return kind(solve3)


def test_a_second_process_neither_traces_nor_compiles(store, monkeypatch):
    expected = solved()(MATRIX, VECTOR)
    (stored,) = store.files()
    monkeypatch.setattr(jax, "jit", None)  # whoever traces fails
    np.testing.assert_array_equal(solved()(MATRIX, VECTOR), expected)
    assert store.files() == [stored]


def test_programs_with_the_same_operations_on_other_arguments_are_kept_apart(store):
    """Code from outside the package: both functions triple one of two arguments of one shape."""
    pairs = [
        (compiled(lambda first, second: 3.0 * first), VECTOR),
        (compiled(lambda first, second: 3.0 * second), MATRIX[0]),
    ]
    for _ in range(2):  # compiled, then loaded
        for function, argument in pairs:
            np.testing.assert_array_equal(function(VECTOR, MATRIX[0]), 3.0 * argument)
        forget_programs()
    assert len(store.files()) == 2


def test_a_stored_program_accepts_numpy_arrays(store):
    matrix, vector = np.asarray(MATRIX), np.asarray(VECTOR)
    expected = solved()(matrix, vector)
    np.testing.assert_array_equal(solved()(matrix, vector), expected)
    assert len(store.files()) == 1


def test_results_have_types_with_which_another_program_is_compiled_once(store):
    choose = compiled(lambda is_active: {"active": jnp.where(is_active, 1.0, 0.0)})
    total = compiled(lambda values: jnp.sum(values["active"]))
    chosen = choose(jnp.array([True, False]))
    assert total(chosen) == total({"active": jnp.array([1.0, 0.0])}) == 1.0
    assert len(list(total)) == 1


def test_shapes_and_options_distinguish_programs(store):
    solved()(MATRIX, VECTOR)
    solved(compiled_quickly)(MATRIX, VECTOR)
    solved()(MATRIX.astype(jnp.float32), VECTOR.astype(jnp.float32))
    assert len(store.files()) == 3
    solved()(2.0 * MATRIX, VECTOR + 1.0)
    assert len(store.files()) == 3


def test_stored_programs_contain_no_lines_of_source_code(store):
    """The lines would be a third of a large program."""
    solved()(MATRIX, VECTOR)
    (content,) = (path.read_bytes() for path in store.files())
    assert b"linear.py" not in content


def test_stored_programs_are_bit_identical_to_newly_traced_programs(store):
    airframe, environment, target = load_airframe("f16"), standard_environment(), trim_target(150.0, 1000.0)
    trims = []
    for _ in range(2):
        trims.append(compiled_quickly(solve_trim)(airframe, environment, target))
    use_program_store(None)
    trims.append(compiled_quickly(solve_trim)(airframe, environment, target))
    assert len(store.files()) == 1
    if memory_region_share():
        # What is released is unmapped: a loaded trim in one piece takes some 40 memory regions of 65,530.
        use_program_store(store)
        program = compiled_quickly(solve_trim)
        empty_share = memory_region_share()
        jax.block_until_ready(program(airframe, environment, target))
        loaded_share = memory_region_share()
        assert loaded_share - empty_share > 20 / 65_530
        program.forget()
        deadline = time.monotonic() + 60.0
        # as soon as the thread that has run it lets go
        while memory_region_share() > 0.5 * (empty_share + loaded_share):
            assert time.monotonic() < deadline
            time.sleep(0.01)
    for trim in trims[1:]:
        assert eqx.tree_equal(trims[0], trim)
        assert jax.tree.structure(trims[0]) == jax.tree.structure(trim)


@pytest.mark.parametrize(
    "damage",
    [
        lambda held: b"",
        lambda held: held[:1000],
        lambda held: held[:-1] + bytes([held[-1] ^ 1]),
        lambda held: b"something else",
        lambda held: held + b"more",
    ],
)
def test_a_damaged_program_is_recompiled(store, damage):
    expected = solved()(MATRIX, VECTOR)
    (path,) = store.files()
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    np.testing.assert_array_equal(solved()(MATRIX, VECTOR), expected)
    assert len(path.read_bytes()) == len(whole)


def test_a_valid_file_with_other_content_is_recompiled(store):
    expected = solved()(MATRIX, VECTOR)
    (path,) = store.files()
    store.save(path.stem, b"\x00" * 8 + b"no program")
    np.testing.assert_array_equal(solved()(MATRIX, VECTOR), expected)


@pytest.mark.parametrize("part", ["structure", "code"])
def test_a_pickle_in_the_file_is_not_executed(store, tmp_path, part):
    class Harm:
        def __reduce__(self):
            return os.system, (f"touch {tmp_path / 'harm'}",)

    expected = solved()(MATRIX, VECTOR)
    (path,) = store.files()
    content, harm = store.load(path.stem), pickle.dumps(Harm())
    end = 8 + int.from_bytes(content[:8], "big")
    parts = {
        "structure": len(harm).to_bytes(8, "big") + harm + content[end:],
        "code": content[:end] + harm,
    }
    store.save(path.stem, parts[part])
    np.testing.assert_array_equal(solved()(MATRIX, VECTOR), expected)
    assert not (tmp_path / "harm").exists()
    assert store.load(path.stem) != parts[part]  # made anew


def test_a_program_stored_under_another_key_is_recompiled(store):
    """Of a function with the same arguments and result."""
    programs = [compiled(solve3), compiled(times3)]
    expected = [program(MATRIX, VECTOR) for program in programs]
    first, second = store.files()
    contents = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(contents)
    for function, right in zip((solve3, times3), expected, strict=True):
        np.testing.assert_array_equal(compiled(function)(MATRIX, VECTOR), right)


def test_a_program_of_another_processor_is_not_loaded(store, monkeypatch):
    expected = solved()(MATRIX, VECTOR)
    monkeypatch.setattr(keys, "_target_fingerprint", functools.partial(str, "another processor"))
    keys._describe_platform.cache_clear()
    try:
        np.testing.assert_array_equal(solved()(MATRIX, VECTOR), expected)
    finally:
        keys._describe_platform.cache_clear()
    assert len(store.files()) == 2


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="a matter of CPUs")
@pytest.mark.parametrize("function", [solve3, lambda matrix, vector: solve3(matrix, vector)])
def test_programs_are_not_stored_without_a_processor_fingerprint(store, monkeypatch, function):
    monkeypatch.setattr(keys, "_target_fingerprint", str)
    keys._describe_platform.cache_clear()
    try:
        np.testing.assert_allclose(MATRIX @ compiled(function)(MATRIX, VECTOR), VECTOR, rtol=1e-12)
    finally:
        keys._describe_platform.cache_clear()
    assert store.files() == []


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="XLA leaves features away there only")
def test_the_fingerprint_of_the_processor_names_its_features():
    environment = os.environ | {"XLA_FLAGS": "--xla_cpu_max_isa=SSE4_2"}
    command = [
        sys.executable,
        "-c",
        "from anser.compiling.keys import _target_fingerprint\nprint(_target_fingerprint())",
    ]
    fewer = subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout.strip()
    assert fewer
    assert fewer != keys._target_fingerprint() != ""


def test_the_least_recently_used_programs_are_released_above_a_size(store, monkeypatch):
    forget_programs()
    programs = [compiled(solve3), compiled(times3), compiled(cross)]
    arguments = [(MATRIX, VECTOR), (MATRIX, VECTOR), (VECTOR, VECTOR[::-1])]
    expected = [program(*inputs) for program, inputs in zip(programs, arguments, strict=True)]

    def loaded():
        return [len(list(program)) for program in programs]

    assert loaded() == [1, 1, 1]
    total = sum(prepared.size for program in programs for _, prepared in program)
    forget_programs()
    monkeypatch.setattr(program_module, "_CODE_MAX", 0.9 * total)  # compiled anew, code differs by a few bytes
    for use in (0, 1, 0, 2):
        np.testing.assert_array_equal(programs[use](*arguments[use]), expected[use])
    assert loaded() == [1, 0, 1]
    np.testing.assert_array_equal(programs[1](*arguments[1]), expected[1])
    assert loaded() == [0, 1, 1]


@pytest.fixture
def crowded(tmp_path, monkeypatch):
    """A process with two thirds of its memory regions in use."""
    release_all_programs()
    used = memory_region_share()
    if not used:
        pytest.skip("the system sets no limit")
    limit = tmp_path / "max_map_count"
    limit.write_text(str(round(1.5 * used * int(memory._REGIONS_MAX.read_text()))))
    monkeypatch.setattr(memory, "_REGIONS_MAX", limit)


def test_a_process_near_the_limit_of_memory_regions_warns_once_and_releases_programs(store, crowded, caplog):
    program_module._log_crowding.cache_clear()
    solving, multiplying = compiled(solve3), compiled(times3)
    for _ in range(2):
        expected = np.asarray(MATRIX) @ VECTOR
        np.testing.assert_allclose(MATRIX @ solving(MATRIX, VECTOR), VECTOR, rtol=1e-12)
        np.testing.assert_allclose(multiplying(MATRIX, VECTOR), expected, rtol=1e-15)
        assert [len(list(program)) for program in (solving, multiplying)] == [0, 1]
    messages = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    assert len(messages) == 1
    assert "memory regions" in messages[0]


class _ForeignPair(eqx.Module):
    first: jax.Array
    second: jax.Array


def test_user_code_is_traced_in_each_process_but_compiled_once(store, monkeypatch):
    def program(factor):
        return compiled(lambda x: _ForeignPair(factor * x, MATRIX @ x))

    with pytest.raises(NotCacheableError):
        describe_value(lambda x: x)
    for factor in (2.0, 3.0):
        np.testing.assert_array_equal(program(factor)(VECTOR).first, factor * VECTOR)
    assert len(store.files()) == 2
    monkeypatch.setattr(program_module, "_compile_serializable", None)  # compiling anything fails
    for factor in (2.0, 3.0):
        pair = program(factor)(VECTOR)
        assert isinstance(pair, _ForeignPair)
        np.testing.assert_array_equal(pair.first, factor * VECTOR)
        np.testing.assert_array_equal(pair.second, MATRIX @ VECTOR)


def test_programs_that_call_back_into_python_are_not_stored(store):
    def called_back(x):
        return jax.pure_callback(lambda value: 2.0 * value, jax.ShapeDtypeStruct((), x.dtype), x)

    assert float(compiled(called_back)(jnp.asarray(3.0))) == 6.0
    assert store.files() == []


def test_an_unwritable_folder_costs_time_only(tmp_path):
    (tmp_path / "file").write_text("in the way")
    for folder in (tmp_path / "file" / "programs", tmp_path / "full"):
        store = FolderStore(folder)
        if folder.name == "full":
            folder.symlink_to("/dev/full")  # every write fails with "no space left on device"
        use_program_store(store)
        try:
            np.testing.assert_allclose(MATRIX @ solved()(MATRIX, VECTOR), VECTOR, rtol=1e-12)
        finally:
            use_program_store(program_store())
        assert store.files() == []


def test_a_full_disk_leaves_no_partial_file(store, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fdopen", full)
    solved()(MATRIX, VECTOR)
    assert list(store.folder.iterdir()) == []


def test_a_read_only_folder_serves_its_programs(store, monkeypatch):
    expected = solved()(MATRIX, VECTOR)

    def forbidden(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(store_module.tempfile, "mkstemp", forbidden)
    monkeypatch.setattr(store_module.os, "utime", forbidden)
    solved()(MATRIX.astype(jnp.float32), VECTOR.astype(jnp.float32))
    assert len(store.files()) == 1
    monkeypatch.setattr(jax, "jit", None)  # whoever traces fails
    np.testing.assert_array_equal(solved()(MATRIX, VECTOR), expected)


def test_prepared_programs_are_compiled_once_in_the_background(store):
    function = compiled(solve3)
    shapes = jax.ShapeDtypeStruct((3, 3), jnp.float64), jax.ShapeDtypeStruct((3,), jnp.float64)
    prepared = function.prepare(*shapes)
    assert prepared.shapes == shapes[1]
    assert store.files() == []  # traced; compiled from `begin` on
    prepared.start().start()
    expected = function(MATRIX, VECTOR)
    np.testing.assert_allclose(MATRIX @ expected, VECTOR, rtol=1e-12)
    assert len(store.files()) == 1
    # What is kept is loaded at once.
    reloaded = compiled(solve3)
    assert reloaded.prepare(*shapes).shapes == shapes[1]
    np.testing.assert_array_equal(reloaded(MATRIX, VECTOR), expected)


def test_the_oldest_files_are_deleted_above_the_size(tmp_path):
    store = FolderStore(tmp_path, size_max=3_200)
    for number in range(5):
        store.save(f"{number}", bytes(1_000))
        os.utime(tmp_path / f"{number}.program", ns=(number, number))
        if number == 2:
            assert store.load("0") == bytes(1_000)  # used: younger than 1 and 2 now
    assert {path.stem for path in store.files()} == {"0", "3", "4"}
    assert store.clear() == 3
    assert store.files() == []


_WRITER = """
import importlib.util, pathlib, sys
of = importlib.util.spec_from_file_location("store", sys.argv[1])
store = importlib.util.module_from_spec(of)
of.loader.exec_module(store)
kept = store.FolderStore(pathlib.Path(sys.argv[2]))
print("ready", flush=True)
number = 0
while True:
    kept.save("program", bytes([number % 251]) * 3_000_000)
    number += 1
"""


@pytest.mark.long
def test_a_process_killed_while_writing_leaves_a_complete_program_or_none(tmp_path):
    """Fifty times; the store returns complete content only."""
    store, random = FolderStore(tmp_path / "programs"), np.random.default_rng(0)
    command = [sys.executable, "-S", "-c", _WRITER, store_module.__file__, str(store.folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
        assert writer.stdout.readline() == b"ready\n"
        began = time.perf_counter()
        while store.load("program") is None:
            assert writer.poll() is None
            assert time.perf_counter() < began + 120.0
        one_takes_s = time.perf_counter() - began
        writer.kill()
    store.clear()
    whole_count = 0
    for _ in range(50):
        with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
            assert writer.stdout.readline() == b"ready\n"
            time.sleep(random.uniform(0.0, 3.0 * one_takes_s))
            writer.kill()
        content = store.load("program")
        whole_count += content is not None
        assert content is None or (len(content) == 3_000_000 and len(set(content)) == 1)
    assert whole_count > 10
    assert len(store.files()) <= 1


def test_files_left_by_a_killed_process_are_deleted(tmp_path):
    store = FolderStore(tmp_path)
    for name, age_s in ((".new-old", 7_200), (".new-young", 60)):
        (tmp_path / name).write_bytes(b"half")
        os.utime(tmp_path / name, (time.time() - age_s,) * 2)
    store.save("a", b"whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".new-young", "a.program"]
    store.clear()
    assert list(tmp_path.iterdir()) == []


def test_a_replaced_function_is_used_and_has_a_separate_key(store, monkeypatch):
    import anser.numerics.linear as linear

    solved()(MATRIX, VECTOR)
    monkeypatch.setattr(linear, "times3", lambda matrix, vector: 7.0 * vector)
    np.testing.assert_array_equal(solved()(MATRIX, VECTOR), 7.0 * VECTOR)
    monkeypatch.undo()
    np.testing.assert_allclose(MATRIX @ solved()(MATRIX, VECTOR), VECTOR, rtol=1e-12)
    assert len(store.files()) == 2


def test_a_program_is_compiling_until_its_background_thread_ends():
    may_end = threading.Event()

    def compile_slowly():
        may_end.wait(60.0)
        return (lambda arrays: arrays), 0

    prepared = PreparedProgram(jax.ShapeDtypeStruct((), float), lambda: compile_slowly, compiles=True)
    assert not prepared.is_compiling
    prepared.start()
    assert prepared.is_compiling
    may_end.set()
    assert prepared.function([2.5]) == 2.5
    assert not prepared.is_compiling
