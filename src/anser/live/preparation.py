"""Compilation of programs before they are needed, in a process of low priority.

The process compiles the programs for refusals and flights of the present fleet, and stores the programs on disk, where
the server finds them. The process runs `python -m anser.live.preparation`. Standard input has the folder and the
document as JSON; the process ends when standard input is closed.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import jax

from anser.compiling.options import cache_folder
from anser.compiling.program import PreparedProgram
from anser.config.errors import ScenarioError
from anser.missions.first_plan import CertifiedFirstPlan, NoPlanError
from anser.missions.plans import plan
from anser.missions.segments import prepare_flight
from anser.planning.certified.arrival_times import prepare_reachable
from anser.planning.certified.certified_plan import choose_interval_count, prepare_extra_candidates
from anser.scenario.files import from_values

_FLEET_STEP = 4  # fleets are padded to multiples of this number of aircraft
_NICENESS = 19
_PAUSE_S = 1.0
_FAR_KEEP_OUT = {"name": "far keep-out", "north_m": 4e5, "east_m": 4e5, "radius_m": 100.0}


@dataclass
class Preparation:
    """Owner of the process that compiles programs in advance; a fleet that needs other programs gets a new process."""

    folder: Path  # folder of the page's scenario files
    _kind: str = ""  # number of intervals, and result of the function `_kind`, for the last requested document
    _finished: set[str] = field(default_factory=set)  # values of `_kind` with completely compiled programs
    _process: "subprocess.Popen[str] | None" = None
    _resume_s: float = 0.0  # reading of `time.monotonic` until which the process is suspended, s
    _paused: "subprocess.Popen[str] | None" = None  # the process that is suspended
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def pause(self) -> None:
        """Suspend the process for one second, so that plans have all computing time; not on Windows."""
        with self._lock:
            self._resume_s, process = time.monotonic() + _PAUSE_S, self._process
            if process is None or process is self._paused or not hasattr(signal, "SIGSTOP"):
                return
            process.send_signal(signal.SIGSTOP)
            self._paused = process
        threading.Thread(target=self._resume_later, args=(process,), daemon=True).start()

    def _resume_later(self, process: "subprocess.Popen[str]") -> None:
        while True:
            time.sleep(max(0.01, self._resume_s - time.monotonic()))
            with self._lock:
                if time.monotonic() >= self._resume_s:
                    process.send_signal(signal.SIGCONT)
                    if self._paused is process:
                        self._paused = None
                    return

    def request(self, document: dict[str, Any], last_s: float | None) -> None:
        """Compile the programs for a document's fleet in a new process, in place of the running process.

        Nothing is done if the document needs the same programs as the last request or has user-defined parts, if
        compiled programs are not stored on disk, or if JAX does not run on the CPU. No process starts if an earlier
        process has compiled the programs. `last_s` is the last planned arrival time, s; None if there is none.
        """
        kind = f"{choose_interval_count(last_s or 0.0)} {json.dumps(_kind(document))}"
        if kind == self._kind or "parts" in document or cache_folder() is None or jax.default_backend() != "cpu":
            return
        if self._process is not None and self._process.poll() == 0:
            self._finished.add(self._kind)
        self.close()
        self._kind = kind
        if kind not in self._finished:
            self._process = _start({"folder": str(self.folder), "document": document})

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            _input_of(self._process).close()
            self._process = None


def _start(task: dict[str, Any]) -> "subprocess.Popen[str]":
    process = subprocess.Popen(
        [sys.executable, "-m", "anser.live.preparation"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
        # Ctrl-C is for the server; a group whose parent ends is continued and ended by the system
        process_group=0 if os.name == "posix" else None,
    )
    with contextlib.suppress(OSError):
        _input_of(process).write(json.dumps(task) + "\n")
        _input_of(process).flush()
    return process


def _input_of(process: "subprocess.Popen[str]") -> IO[str]:
    assert process.stdin is not None
    return process.stdin


def _kind(value: Any) -> Any:
    """Return what selects the compiled programs of a document: the document without numbers, names and events.

    A list is replaced by [length / `_FLEET_STEP`, rounded up; distinct entries].
    """
    if isinstance(value, dict):
        return {key: _kind(value[key]) for key in sorted(value) if key != "event" and not _is_name(key, value[key])}
    if isinstance(value, list):
        kinds = sorted({json.dumps(_kind(entry)) for entry in value})
        return [-(-len(value) // _FLEET_STEP), kinds]
    return value if isinstance(value, str) else None


def _is_name(key: str, value: Any) -> bool:
    return key in ("name", "description", "goal") and isinstance(value, str)


def compile_ahead(document: dict[str, Any], folder: Path) -> None:
    """Compile the programs that plan, explain a refusal and fly the fleet of a document.

    If the document has no keep-out, the programs for the same fleet with a keep-out are compiled, too. Relative paths
    in the document refer to `folder`.
    """
    _compile_for(document, folder)
    if not document.get("keep_out"):
        with contextlib.suppress(ScenarioError):  # outside the map of a round Earth, for example
            _compile_for(document | {"keep_out": [_FAR_KEEP_OUT]}, folder)


def _compile_for(document: dict[str, Any], folder: Path) -> None:
    planned = plan(from_values(document, str(folder / "document.toml")))
    programs: list[PreparedProgram] = []
    if isinstance(planned, CertifiedFirstPlan):
        tasks, airspace = planned.padded_tasks, planned.airspace
        last_s = 0.0 if planned.refusals else planned.arrival_s
        for prepare in (
            prepare_extra_candidates(tasks, airspace, choose_interval_count(last_s)),
            prepare_reachable(tasks, airspace),
        ):
            programs.extend(program.start() for program in prepare)
    with contextlib.suppress(NoPlanError):
        programs.append(prepare_flight(planned.flight, planned.initial_state()).start())
    for program in programs:
        program.function  # noqa: B018 - waits for the compilation


def _main() -> None:
    with contextlib.suppress(AttributeError, OSError):
        os.nice(_NICENESS)
    task = json.loads(sys.stdin.readline())

    def end_with_input() -> None:
        sys.stdin.read()
        os._exit(0)

    threading.Thread(target=end_with_input, daemon=True).start()
    compile_ahead(task["document"], Path(task["folder"]))


if __name__ == "__main__":
    _main()
