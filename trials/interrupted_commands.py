"""Commands interrupted by Ctrl-C at random moments: `python -m trials.interrupted_commands --trials 20`.

Each command first runs undisturbed, to measure its duration and list its files. Then its processes are interrupted, as
by a terminal, at uniformly random moments of that duration, including the import of the package; earlier, while the
interpreter starts and imports the entry point, Ctrl-C is Python's own. The command must end with
exit code 130 and one message, and leave either complete files or none; a campaign and a rare event leave a resumable
folder. An interrupt after the last write may end with the command's normal exit code.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

_ROOT = Path(__file__).parents[1]
_STOPPED = 130
_SCENARIO, _RUN, _STUDY, _RARE = "scenario.toml", "run", "study.toml", "rare.toml"
_PROGRAM = "import os, sys, anser_command; os.write({ready}, b'x'); sys.argv[0] = 'anser'; anser_command.main()"
_TIMEOUT_S = 600.0
RESUMED = {"campaign": "flights.zarr", "rare": "flown"}
"""Commands with a resumable folder, and a file in it."""
COMMANDS: dict[str, tuple[str, ...]] = {
    "run": ("run", _SCENARIO, "--out", "{out}"),
    "plan": ("plan", _SCENARIO, "--out", "{out}"),
    "sweep": ("sweep", _SCENARIO, "--set", "wind.speed_m_s=0,5", "--out", "{out}"),
    "campaign": ("campaign", _STUDY, "--processes", "2", "--out", "{out}"),
    "rare": ("rare", _RARE, "--processes", "1", "--out", "{out}"),
    "envelope": ("envelope", "--coarse", "--out", "{out}"),
    "gallery": ("gallery", "--out", "{out}"),
    "robustness": ("robustness", "--flights", "8", "--at", "150,2000", "--out", "{out}"),
    "margins": ("margins", "--envelope", "--coarse", "--out", "{out}"),
    "verify": ("verify", "--case", "f16-trim", "--case", "nesc-01", "--json"),
    "figures": ("figures", _RUN, "--out", "{out}", "--only", "tracks,bank,miss"),
    "report": ("report", _RUN, "--out", "{out}.html"),
    "export": ("export", _RUN, "--format", "czml,kml,csv,mat", "--out", "{out}"),
    "new": ("new", "{out}.toml"),
}
_SAMPLED = """format = 1
name = "interrupted"
description = "Interrupted again and again"
scenario = "scenario.toml"
seed = 1

[[vary]]
path = "aircraft[0].start.north_m"
distribution = "normal"
mean = 0.0
sigma = 20.0
how = "add"
"""
_STUDIES = {
    _STUDY: '\n[sampling]\nmethod = "monte-carlo"\nflights = 12\n',
    _RARE: '\n[rare]\nstatistic = "miss_m"\nthreshold = 0.5\nflights = 60\nlevel_share = 0.5\nlevels_max = 2\n'
    "repetitions = 3\n",
}


@dataclass(frozen=True)
class Ended:
    """End of one process: exit code, standard error, duration, and time from the interrupt to the end, s."""

    code: int
    said: str
    duration_s: float
    after_s: float | None


def prepare(folder: Path) -> None:
    """Write the input of the commands: scenario, studies and run."""
    text = (_ROOT / "scenarios" / "single-aircraft.toml").read_text(encoding="utf-8")
    (folder / _SCENARIO).write_text(text, encoding="utf-8")
    for name, part in _STUDIES.items():
        (folder / name).write_text(_SAMPLED + part, encoding="utf-8")
    ended = run_command(("run", _SCENARIO, "--out", _RUN), folder, None)
    if ended.code != 0:
        raise RuntimeError(f"the run that other commands read ended with exit code {ended.code}: {ended.said}")


def run_command(arguments: tuple[str, ...], folder: Path, delay_s: float | None) -> Ended:
    """Run a command in a folder, and interrupt its processes `delay_s` after its entry point is imported."""
    reading, writing = os.pipe()
    command = [sys.executable, "-c", _PROGRAM.format(ready=writing), *arguments]
    after_s = None
    with (folder / "stderr.txt").open("w+b") as stderr:
        process = subprocess.Popen(
            command, cwd=folder, start_new_session=True, pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=stderr
        )
        os.close(writing)
        os.read(reading, 1)
        os.close(reading)
        start_time = time.perf_counter()
        try:
            process.wait(_TIMEOUT_S if delay_s is None else delay_s)
        except subprocess.TimeoutExpired:
            interrupted = time.perf_counter()
            os.killpg(process.pid, signal.SIGINT)
            process.wait(_TIMEOUT_S)
            after_s = time.perf_counter() - interrupted
        stderr.seek(0)
        return Ended(
            process.returncode, stderr.read().decode(errors="replace"), time.perf_counter() - start_time, after_s
        )


def outputs_of(folder: Path, name: str) -> set[str]:
    """Files of a command's output in the folder, as relative paths."""
    outputs = [path for path in folder.iterdir() if path.name.startswith((f"{name}.", ".anser-")) or path.name == name]
    files = [path for output in outputs for path in ([output] if output.is_file() else output.rglob("*"))]
    empty = [path for path in outputs if path.is_dir()]
    return {path.relative_to(folder).as_posix() for path in [*files, *empty]}


def faults_of(command: str, ended: Ended, files: set[str], complete_files: set[str]) -> list[str]:
    """Faults of an interrupted command: wrong exit code, messages or files."""
    faults = []
    if ended.code == _STOPPED:
        if ended.said.count("stopped\n") != 1 or "Traceback" in ended.said or "ignored" in ended.said:
            faults.append(f"messages {ended.said[-2000:]!r}")
    elif ended.code in (0, 1):
        if files != complete_files:
            faults.append(f"exit code {ended.code} with {len(files)} of {len(complete_files)} files")
    else:
        faults.append(f"exit code {ended.code}: {ended.said[-2000:]!r}")
    if any(".anser-" in name or name.endswith(".part") for name in files):
        faults.append(f"temporary files {sorted(files)}")
    resumed = RESUMED.get(command)
    if files and files != complete_files and not (resumed and any(f"/{resumed}" in name for name in files)):
        faults.append(f"files {sorted(files)} instead of {sorted(complete_files)}")
    return faults


def interrupt(command: str, folder: Path, trials: int, draw: random.Random) -> tuple[list[str], str]:
    """Interrupt one command `trials` times; return its faults and a summary line."""
    template = COMMANDS[command]

    def filled(name: str) -> tuple[str, ...]:
        return tuple(word.format(out=name) for word in template)

    run_command(filled("out"), folder, None)  # fills the cache of compiled programs
    _remove(folder, "out")
    undisturbed = run_command(filled("out"), folder, None)
    complete_files, duration_s = outputs_of(folder, "out"), undisturbed.duration_s
    _remove(folder, "out")
    if undisturbed.code not in (0, 1):
        return [f"{command}: undisturbed, exit code {undisturbed.code}: {undisturbed.said}"], command
    end_counts, faults, slowest_s = Counter[str](), [], 0.0
    while end_counts["stopped"] + end_counts["finished"] + len(faults) < trials:
        delay_s = draw.uniform(0.0, duration_s)
        ended = run_command(filled("out"), folder, delay_s)
        files = outputs_of(folder, "out")
        _remove(folder, "out")
        if ended.after_s is None:  # faster than the undisturbed run
            duration_s = max(0.9 * duration_s, 0.2)
            end_counts["too late"] += 1
            continue
        slowest_s = max(slowest_s, ended.after_s)
        new_faults = faults_of(command, ended, files, complete_files)
        faults += [f"{command}, interrupted after {delay_s:.3f} s: {fault}" for fault in new_faults]
        if not new_faults:
            end_counts["stopped" if ended.code == _STOPPED else "finished"] += 1
    counts = (
        f"{end_counts['stopped']} stopped, {end_counts['finished']} finished, {len(faults)} faults, "
        f"{end_counts['too late']} too late"
    )
    line = (
        f"{command}: {counts}; undisturbed {undisturbed.duration_s:.1f} s, slowest end {slowest_s:.1f} s after Ctrl-C"
    )
    return faults, line


def _remove(folder: Path, name: str) -> None:
    for path in folder.iterdir():
        if path.name == name or path.name.startswith((f"{name}.", ".anser-")):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def main() -> int:
    """Interrupt the named commands (default: every command); return 1 after a fault."""
    parser = argparse.ArgumentParser(prog="python -m trials.interrupted_commands", description=__doc__)
    parser.add_argument("commands", nargs="*", choices=[*COMMANDS, []], help="commands to interrupt; none: all")
    parser.add_argument("--trials", type=int, default=20, help="interrupts of each command")
    parser.add_argument("--seed", type=int, default=1, help="seed of the moments")
    options = parser.parse_args()
    count = 0
    with tempfile.TemporaryDirectory() as temporary_folder:
        folder = Path(temporary_folder)
        prepare(folder)
        for command in options.commands or COMMANDS:
            faults, line = interrupt(command, folder, options.trials, random.Random(f"{options.seed} {command}"))
            count += len(faults)
            sys.stdout.write("\n".join([line, *faults]) + "\n")
            sys.stdout.flush()
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main())
