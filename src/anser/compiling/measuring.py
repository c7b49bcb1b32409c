"""Measurement of compilation: size and CPU time of each program compiled in this process, and the time left."""

import contextlib
import os
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(eq=False)
class Compilation:
    """Record of one program that this process traces and compiles."""

    title: str  # name of the program for users
    options: Mapping[str, bool | str]  # compiler options
    equations: int = 0  # number of JAX equations, with those of called programs; 0 until traced
    code_bytes: int = 0  # size of the serialized code; 0 until compiled, or if the code cannot be serialized
    # CPU time by stage, s; simultaneous stages of several programs share the time equally
    cpu_s: dict[str, float] = field(default_factory=lambda: dict.fromkeys(("tracing", "lowering", "compiling"), 0.0))
    start_s: float = 0.0  # reading of `time.monotonic` at the start of the latest stage
    is_compiled: bool = False  # True: the compilation has ended

    @property
    def estimate_s(self) -> float:
        """Expected CPU time of compiling, s: the number of equations times a mean CPU time per equation.

        The mean is over a prior estimate and the programs that this process has compiled with the same compiler
        options.
        """
        similar = [r for r in compilations if r.is_compiled and dict(r.options) == dict(self.options)]
        equations = _PRIOR_EQUATIONS + sum(r.equations for r in similar)
        seconds = _PRIOR_EQUATIONS * _prior_s(self.options) + sum(r.cpu_s["compiling"] for r in similar)
        return self.equations * seconds / equations


compilations: list[Compilation] = []
"""Records of this process, in the order of tracing; programs loaded from the store are left out."""
_PRIOR_EQUATIONS = 10_000
"""Weight of the prior estimate of the compiling time, as a number of equations."""
_waits: list[None] = []
_lock = threading.RLock()
_at_work: list[tuple[Compilation, str]] = []
_elsewhere: list[Compilation] = []
_clock = [0.0]


def _prior_s(options: Mapping[str, bool | str]) -> float:
    """Return the CPU time of compiling per equation, s, that is assumed before any measurement in this process."""
    # measured on two cores of a server of 2024 with XLA of September 2026
    return 0.5e-3 if "xla_backend_optimization_level" in options else 0.6e-3 if options else 1.1e-3


def _share_time() -> None:
    """Add the process's CPU time since the last call to the records of the stages now at work, in equal parts."""
    now = time.process_time()
    for record, stage in _at_work:
        record.cpu_s[stage] += (now - _clock[0]) / len(_at_work)
    _clock[0] = now


@contextlib.contextmanager
def measured(record: Compilation, stage: str) -> Iterator[None]:
    """Add the CPU time (s) of the `with` block to the stage `stage` (tracing, lowering or compiling) of a record."""
    entry = (record, stage)
    with _lock:
        _share_time()
        _at_work.append(entry)
        record.start_s = time.monotonic()
    try:
        yield
    finally:
        with _lock:
            _share_time()
            _at_work[:] = [other for other in _at_work if other is not entry]


@contextlib.contextmanager
def waiting() -> Iterator[None]:
    """Count the `with` block as a wait for a program; `compilation_message` then names the program."""
    _waits.append(None)
    try:
        yield
    finally:
        _waits.pop()


@contextlib.contextmanager
def compiled_elsewhere(record: Compilation) -> Iterator[None]:
    """Count the `with` block as a wait for another process that may be compiling the program of `record`."""
    _elsewhere.append(record)
    try:
        yield
    finally:
        _elsewhere.remove(record)


def compilation_message() -> str | None:
    """Return a text with the awaited program and, if known, the time left; None if the process waits for no program."""
    awaited = awaited_compilation()
    if awaited is None:
        return None
    record, time_left = awaited
    records = list(compilations)
    if record not in records:
        return None  # loaded from the store since, or its trace failed
    message = f"compiling program {records.index(record) + 1} ({record.title})"
    return message if time_left is None else f"{message}, {time_left}"


def awaited_compilation() -> tuple[Compilation, str | None] | None:
    """Return the record of the awaited program, and the time left as text; None if the process waits for no program.

    The time left is None until all programs in compilation are traced and lowered, and if the process only waits for a
    program that another process compiles.
    """
    with _lock:
        _share_time()
        if not _waits or not (_at_work or _elsewhere):
            return None
        if not _at_work:
            return _elsewhere[0], None
        record, stage = _at_work[0]
        if any(other != "compiling" for _, other in _at_work):
            return record, None  # the size of a program is unknown before it is traced
        wait_s = time.monotonic() - record.start_s
        spent_s = sum(r.cpu_s[stage] for r, _ in _at_work)
        left_s = sum(max(r.estimate_s - r.cpu_s[stage], 0.1 * r.estimate_s) for r, _ in _at_work)
    cores = min(len(_at_work), usable_cores())
    # seconds of CPU time per second: fewer beside other processes
    pace = cores if wait_s < _PACE_AFTER_S else max(spent_s / wait_s, 0.2)
    return record, _time_left(left_s / pace)


_PACE_AFTER_S = 3.0


def usable_cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _time_left(seconds: float) -> str:
    return f"about {5 * round(seconds / 5)} s left" if seconds >= 7.5 else "a few seconds left"


def count_equations(jaxpr: Any) -> int:
    """Return the number of equations (operations) in a traced program, including the programs that it calls."""
    counts: dict[int, int] = {}

    def count(program: Any) -> int:
        if id(program) not in counts:
            counts[id(program)] = sum(1 + sum(map(count, _called(equation))) for equation in program.eqns)
        return counts[id(program)]

    return count(jaxpr)


def _called(equation: Any) -> Iterator[Any]:
    for value in equation.params.values():
        for item in value if isinstance(value, tuple | list) else (value,):
            program = getattr(item, "jaxpr", item)
            if hasattr(program, "eqns"):
                yield program
