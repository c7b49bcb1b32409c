"""Measurement of a scenario's computing cost by two flights in new processes, which share a new, empty cache."""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from anser.cli.console import InputError, columns, print_line, print_table
from anser.compiling.options import CACHE_VARIABLE

_FLY = """
import atexit, json, sys, time
path = sys.argv.pop(1)
def write():
    from anser.compiling.measuring import compilations
    try:
        import resource
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    except ImportError:  # Windows
        peak = None
    programs = [
        {"title": r.title, "equations": r.equations, **{f"{stage}_s": s for stage, s in r.cpu_s.items()}}
        | {"code_mb": r.code_bytes / 1e6}
        for r in compilations
        if r.is_compiled
    ]
    with open(path, "w") as file:
        json.dump({"programs": programs, "cpu_s": time.process_time(), "peak_mb": peak}, file)
atexit.register(write)
from anser.cli import main
main()
"""
_STAGES = ("tracing_s", "lowering_s", "compiling_s")


def measure_scenario(scenario: Path) -> dict[str, Any]:
    """Fly a scenario twice in new processes; return a JSON document of the cost of both runs.

    The document has the CPU time (s) of tracing, lowering and compiling for each compiled program and in sum, the first
    run's peak memory (MB; None if unknown), and CPU and wall time (s) of each run. Raises InputError if the scenario
    cannot be flown.
    """
    with tempfile.TemporaryDirectory(prefix="anser-") as folder:
        first, second = (_run_once(scenario, Path(folder), number) for number in (1, 2))
    programs = first["programs"]
    sums = {key: sum(program[key] for program in programs) for key in ("equations", *_STAGES, "code_mb")}
    runs = {f"{name}_{key}": run[key] for name, run in (("first", first), ("second", second)) for key in _RUN}
    return {"scenario": scenario.stem, "programs": programs, **sums, "peak_mb": first["peak_mb"], **runs}


_RUN = ("cpu_s", "wall_s")


def _run_once(scenario: Path, folder: Path, number: int) -> dict[str, Any]:
    record = folder / "record.json"
    command = [sys.executable, "-c", _FLY, record, "run", scenario, "--out", folder / str(number), "--quiet"]
    environment = {**os.environ, CACHE_VARIABLE: str(folder / "cache")}
    start_s = time.perf_counter()
    completed = subprocess.run(command, env=environment, stderr=subprocess.PIPE, text=True, check=False)
    wall_s = time.perf_counter() - start_s
    if completed.returncode not in (0, 1) or not (folder / str(number)).is_dir():
        raise InputError(f"--scenario: arrived {scenario}, which was not flown: {completed.stderr.strip()}")
    return {**json.loads(record.read_text(encoding="utf-8")), "wall_s": wall_s}


def print_budgets(budgets: list[dict[str, Any]]) -> None:
    """Print a table with a row of computing costs for each result of `measure_scenario`.

    For a single result, a table of its compiled programs comes first.
    """
    stages = ("equations", "tracing", "lowering", "compiling", "code MB")
    if len(budgets) == 1:
        keys = (*_STAGES, "code_mb")
        rows = [(r["title"], f"{r['equations']:,}", *(r[key] for key in keys)) for r in budgets[0]["programs"]]
        headings = [*columns("program"), *columns(*stages, justify="right", digits=1)]
        print_table(f"programs of {budgets[0]['scenario']}, CPU seconds", headings, rows)
    runs = ("peak MB", "first CPU", "wall", "second CPU", "wall")
    print_table(
        "first run with an empty cache, and second run; seconds",
        [*columns("scenario"), *columns("programs", *stages, *runs, justify="right", digits=1)],
        [
            (
                *(b["scenario"], str(len(b["programs"])), f"{b['equations']:,}"),
                *(b[key] for key in (*_STAGES, "code_mb")),
                *("" if b["peak_mb"] is None else f"{b['peak_mb']:.0f}", b["first_cpu_s"], b["first_wall_s"]),
                *(b["second_cpu_s"], b["second_wall_s"]),
            )
            for b in budgets
        ],
    )
    print_line("compiling: XLA's passes and LLVM together; programs compiled at the same time share the time equally")
