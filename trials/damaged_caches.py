"""Files of the cache of compiled programs, damaged in every way: each is rebuilt, none is used, nothing fails.

``python -m trials.damaged_caches --mutations 1000``

Each mutation damages a store of three small programs, by its own seed, with every kind in turn. Then the program is
called as in a new process: its result must be exact to the last bit, and the damaged file must have been replaced or,
in a folder not exclusive to the user, ignored. Out of scope: machine code changed and resealed with a valid checksum,
which is executed (docs/command-line.md).
"""

import argparse
import collections
import hashlib
import json
import os
import pickle
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from anser.compiling.options import compiled, program_store
from anser.compiling.program import use_program_store
from anser.compiling.store import FolderStore
from anser.numerics.linear import cross, solve3, times3

Damage = Callable[[Path, np.random.Generator], None]
_MATRIX = jnp.array([[2.0, 1.0, 0.0], [0.5, 3.0, 0.2], [0.0, 0.1, 1.5]])
_VECTOR = jnp.array([1.0, 2.0, 3.0])
_PROGRAMS: tuple[tuple[Callable[..., Any], tuple[Any, ...]], ...] = (
    (solve3, (_MATRIX, _VECTOR)),
    (times3, (_MATRIX, _VECTOR)),
    (cross, (_VECTOR, _VECTOR[::-1])),
)
_HEAD = 16 + 32  # mark and checksum
_ANOTHER_USER = 12_345


class Outcome(NamedTuple):
    """Result of a mutation: its kind, and the fault, if any."""

    kind: str
    fault: str | None


class FileCreator:
    """Object that creates a file when unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Any, ...]:
        """Call made by the unpickler."""
        return Path.touch, (self.trace,)


def _rewritten(change: Callable[[bytearray, np.random.Generator], bytes | bytearray]) -> Damage:
    def damage(path: Path, random: np.random.Generator) -> None:
        path.write_bytes(change(bytearray(path.read_bytes()), random))

    return damage


def _flipped(content: bytearray, random: np.random.Generator, end: int | None = None) -> bytearray:
    content[int(random.integers(len(content) if end is None else end))] ^= 1 << int(random.integers(8))
    return content


def _zeroed(content: bytearray, random: np.random.Generator) -> bytearray:
    start = int(random.integers(len(content) - 1))
    length = min(int(random.integers(1, 4096)), len(content) - start)
    while not any(content[start : start + length]):  # already zero
        start, length = start - 1, length + 1
    content[start : start + length] = bytes(length)
    return content


def _sealed(path: Path, content: bytes) -> None:
    FolderStore(path.parent).save(path.stem, content)


def _with_header(path: Path, header: bytes) -> None:
    """Replace the structure, with a valid checksum."""
    content = path.read_bytes()[_HEAD:]
    end = 8 + int.from_bytes(content[:8], "big")
    _sealed(path, len(header).to_bytes(8, "big") + header + content[end:])


def _foreign_structure(path: Path, random: np.random.Generator) -> None:
    name = str(random.choice(["os:system", "anser.compiling.store:os", "builtins:eval", "anser.__main__:main", "x"]))
    kind = str(random.choice(["class", "enum", "call", "tuple"]))
    _with_header(path, json.dumps({"result": {kind: [name, {"x": 1}]}, "argument_indices": [0, 1]}).encode())


def _random_structure(path: Path, random: np.random.Generator) -> None:
    _with_header(path, random.bytes(int(random.integers(0, 200))))


def _pickled_structure(path: Path, random: np.random.Generator) -> None:
    del random
    _with_header(path, pickle.dumps(FileCreator(path.parent / "harm")))


def _pickled_code(path: Path, random: np.random.Generator) -> None:
    del random
    content = path.read_bytes()[_HEAD:]
    end = 8 + int.from_bytes(content[:8], "big")
    _sealed(path, content[:end] + pickle.dumps(FileCreator(path.parent / "harm")))


def _of_another_program(path: Path, random: np.random.Generator) -> None:
    other_files = [other_file for other_file in sorted(path.parent.glob("*.program")) if other_file != path]
    path.write_bytes(other_files[int(random.integers(len(other_files)))].read_bytes())


def _sealed_without_key(path: Path, random: np.random.Generator) -> None:
    """Seal as in the first format: the checksum covers the content alone."""
    del random
    content = path.read_bytes()[_HEAD:]
    path.write_bytes(path.read_bytes()[:16] + hashlib.sha256(content).digest() + content)


def _linked(path: Path, random: np.random.Generator) -> None:
    del random
    path.rename(path.parent / "elsewhere")
    path.symlink_to("elsewhere")


def _replaced(make: Callable[[Path], None]) -> Damage:
    def damage(path: Path, random: np.random.Generator) -> None:
        del random
        path.unlink()
        make(path)

    return damage


def _writable(path: Path, random: np.random.Generator) -> None:
    path.chmod(0o600 | int(random.choice([0o020, 0o002, 0o022, 0o066])))


def _folder_writable(path: Path, random: np.random.Generator) -> None:
    path.parent.chmod(0o700 | int(random.choice([0o020, 0o002, 0o077])))


def _given_away(path: Path, random: np.random.Generator) -> None:
    os.chown(path if random.random() < 0.5 else path.parent, _ANOTHER_USER, -1)


DAMAGES: dict[str, Damage] = {
    "bit flipped": _rewritten(_flipped),
    "bit of the head flipped": _rewritten(lambda held, random: _flipped(held, random, _HEAD)),
    "bit of the structure flipped": _rewritten(lambda held, random: _flipped(held, random, _HEAD + 200)),
    "cut": _rewritten(lambda held, random: held[: int(random.integers(len(held)))]),
    "longer": _rewritten(lambda held, random: held + random.bytes(int(random.integers(1, 100)))),
    "zeros in it": _rewritten(_zeroed),
    "random bytes": _rewritten(lambda held, random: random.bytes(int(random.integers(0, 2 * len(held))))),
    "of another program": _of_another_program,
    "sealed without its key": _sealed_without_key,
    "foreign structure, sealed": _foreign_structure,
    "random structure, sealed": _random_structure,
    "pickled structure, sealed": _pickled_structure,
    "pickled code, sealed": _pickled_code,
    "link": _linked,
    "folder": _replaced(Path.mkdir),
    "pipe": _replaced(os.mkfifo),
    "writable for others": _writable,
    "in a folder writable for others": _folder_writable,
} | ({"of another user": _given_away} if os.geteuid() == 0 else {})
_UNUSED = ("folder", "in a folder writable for others", "of another user")
"""Kinds of damage after which the file may remain: it is ignored."""


def mutate(seed: int, store: FolderStore, expected: list[bytes]) -> Outcome:
    """Damage a file of the store, and call its program as in a new process; the store is restored afterwards."""
    random = np.random.default_rng([17, seed])
    kind = sorted(DAMAGES)[seed % len(DAMAGES)]
    number = int(random.integers(len(_PROGRAMS)))
    function, arguments = _PROGRAMS[number]
    contents = {path: path.read_bytes() for path in store.files()}
    path = _file_of(number, store)
    DAMAGES[kind](path, random)
    damaged = path.read_bytes() if stat.S_ISREG(path.lstat().st_mode) else None
    try:
        fault = None
        if np.asarray(compiled(function)(*arguments)).tobytes() != expected[number]:
            fault = "another result"
        elif (store.folder / "harm").exists():
            fault = "a pickle was run"
        elif kind not in _UNUSED and (path.is_symlink() or path.read_bytes() == damaged != contents[path]):
            fault = "the damaged file stayed"
        elif kind not in _UNUSED and store.load(path.stem) is None:
            fault = "not made anew"
    except Exception as error:  # noqa: BLE001 - the fault is what is looked for
        fault = repr(error)
    shutil.rmtree(store.folder)
    store.folder.mkdir(mode=0o700)
    for whole, content in contents.items():
        whole.write_bytes(content)
        whole.chmod(0o600)
    return Outcome(kind, fault)


def _file_of(number: int, store: FolderStore) -> Path:
    """File used by a call of a program."""
    for path in store.files():
        os.utime(path, ns=(0, 0))
    function, arguments = _PROGRAMS[number]
    compiled(function)(*arguments)
    return store.files()[-1]


def run_trial(mutations: int, folder: Path, first_seed: int = 0) -> list[Outcome]:
    """Outcomes of the mutations of consecutive seeds, in a new folder."""
    store = FolderStore(folder / "programs")
    use_program_store(store)
    try:
        expected = [np.asarray(compiled(function)(*arguments)).tobytes() for function, arguments in _PROGRAMS]
        return [mutate(seed, store, expected) for seed in range(first_seed, first_seed + mutations)]
    finally:
        use_program_store(program_store())


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutations", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        outcomes = run_trial(options.mutations, Path(folder), options.first)
    for kind, count in sorted(collections.Counter(outcome.kind for outcome in outcomes).items()):
        print(f"{kind}: {count}")  # noqa: T201
    faults = [(seed, outcome) for seed, outcome in enumerate(outcomes, options.first) if outcome.fault]
    for seed, (kind, fault) in faults:
        print(f"seed {seed}, {kind}: {fault}")  # noqa: T201
    print(f"{len(outcomes)} mutations, {len(faults)} faults")  # noqa: T201
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
