"""Commands that Ctrl-C interrupts at random moments: `python -m trials.interrupted_commands --trials 20`.

Each command is flown once undisturbed, for its duration and its files. Then it is interrupted, its processes as a
terminal does it, at moments that are spread evenly over that duration, imports of modules among them. It must end with
exit code 130 and one message, and leave all of its files, each complete, or none; a campaign and a rare event leave
what can be resumed. An interrupt that arrives when all is written may end with the command's own exit code.
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
_PROGRAM = "import os, sys; os.write({ready}, b'x'); from anser.cli import main; sys.argv[0] = 'anser'; main()"
_TIMEOUT_S = 600.0
RESUMED = {"campaign": "flights.zarr", "rare": "rare-asked.json"}
"""Commands whose folder stays to be resumed, and what it holds then."""
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
    """End of one process: its exit code, its standard error, its duration, and its end after the interrupt, s."""

    code: int
    said: str
    duration_s: float
    after_s: float | None


def prepare(folder: Path) -> None:
    """Write the scenario, the studies and the run that the commands read."""
    text = (_ROOT / "scenarios" / "single-aircraft.toml").read_text(encoding="utf-8")
    (folder / _SCENARIO).write_text(text, encoding="utf-8")
    for name, part in _STUDIES.items():
        (folder / name).write_text(_SAMPLED + part, encoding="utf-8")
    ended = run_command(("run", _SCENARIO, "--out", _RUN), folder, None)
    if ended.code != 0:
        raise RuntimeError(f"the run that other commands read ended with exit code {ended.code}: {ended.said}")


def run_command(words: tuple[str, ...], folder: Path, delay_s: float | None) -> Ended:
    """Run a command in a folder, and interrupt its processes so long after it begins to import the package."""
    reading, writing = os.pipe()
    command = [sys.executable, "-c", _PROGRAM.format(ready=writing), *words]
    after_s = None
    with (folder / "stderr.txt").open("w+b") as said:
        process = subprocess.Popen(
            command, cwd=folder, start_new_session=True, pass_fds=[writing], stdout=subprocess.DEVNULL, stderr=said
        )
        os.close(writing)
        os.read(reading, 1)
        os.close(reading)
        began = time.perf_counter()
        try:
            process.wait(_TIMEOUT_S if delay_s is None else delay_s)
        except subprocess.TimeoutExpired:
            interrupted = time.perf_counter()
            os.killpg(process.pid, signal.SIGINT)
            process.wait(_TIMEOUT_S)
            after_s = time.perf_counter() - interrupted
        said.seek(0)
        return Ended(process.returncode, said.read().decode(errors="replace"), time.perf_counter() - began, after_s)


def outputs_of(folder: Path, name: str) -> set[str]:
    """Files that a command has left under the name of its output, relative to the folder."""
    places = [path for path in folder.iterdir() if path.name.startswith((f"{name}.", ".anser-")) or path.name == name]
    files = [path for place in places for path in ([place] if place.is_file() else place.rglob("*"))]
    empty = [path for path in places if path.is_dir()]
    return {path.relative_to(folder).as_posix() for path in [*files, *empty]}


def faults_of(command: str, ended: Ended, left: set[str], whole: set[str]) -> list[str]:
    """Faults of an interrupted command: of its exit code, its messages and the files that it left."""
    found = []
    if ended.code == _STOPPED:
        if ended.said.count("stopped\n") != 1 or "Traceback" in ended.said or "ignored" in ended.said:
            found.append(f"messages {ended.said[-2000:]!r}")
    elif ended.code in (0, 1):
        if left != whole:
            found.append(f"exit code {ended.code} with {len(left)} of {len(whole)} files")
    else:
        found.append(f"exit code {ended.code}: {ended.said[-2000:]!r}")
    if any(".anser-" in name or name.endswith(".part") for name in left):
        found.append(f"temporary files {sorted(left)}")
    resumed = RESUMED.get(command)
    if left and left != whole and not (resumed and any(f"/{resumed}" in name for name in left)):
        found.append(f"files {sorted(left)} instead of {sorted(whole)}")
    return found


def interrupt(command: str, folder: Path, trials: int, draw: random.Random) -> tuple[list[str], str]:
    """Interrupt one command so many times; return its faults, and a line that sums them up."""
    words = COMMANDS[command]

    def filled(name: str) -> tuple[str, ...]:
        return tuple(word.format(out=name) for word in words)

    run_command(filled("out"), folder, None)  # what is compiled, it finds in the cache from now on
    _remove(folder, "out")
    undisturbed = run_command(filled("out"), folder, None)
    whole, duration_s = outputs_of(folder, "out"), undisturbed.duration_s
    _remove(folder, "out")
    if undisturbed.code not in (0, 1):
        return [f"{command}: undisturbed, exit code {undisturbed.code}: {undisturbed.said}"], command
    ends, faults, slowest_s = Counter[str](), [], 0.0
    while ends["stopped"] + ends["finished"] + len(faults) < trials:
        delay_s = draw.uniform(0.0, duration_s)
        ended = run_command(filled("out"), folder, delay_s)
        left = outputs_of(folder, "out")
        _remove(folder, "out")
        if ended.after_s is None:  # it was faster than the first time
            duration_s = max(0.9 * duration_s, 0.2)
            ends["too late"] += 1
            continue
        slowest_s = max(slowest_s, ended.after_s)
        found = faults_of(command, ended, left, whole)
        faults += [f"{command}, interrupted after {delay_s:.3f} s: {one}" for one in found]
        if not found:
            ends["stopped" if ended.code == _STOPPED else "finished"] += 1
    counts = (
        f"{ends['stopped']} stopped, {ends['finished']} finished, {len(faults)} faults, {ends['too late']} too late"
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
    """Interrupt the commands that are named, or all; 1 if one of them has a fault."""
    parser = argparse.ArgumentParser(prog="python -m trials.interrupted_commands", description=__doc__)
    parser.add_argument("commands", nargs="*", choices=[*COMMANDS, []], help="commands to interrupt; none: all")
    parser.add_argument("--trials", type=int, default=20, help="interrupts of each command")
    parser.add_argument("--seed", type=int, default=1, help="seed of the moments")
    given = parser.parse_args()
    count = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        prepare(folder)
        for command in given.commands or COMMANDS:
            faults, line = interrupt(command, folder, given.trials, random.Random(f"{given.seed} {command}"))
            count += len(faults)
            sys.stdout.write("\n".join([line, *faults]) + "\n")
            sys.stdout.flush()
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main())
