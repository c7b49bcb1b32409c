"""Release check (`make release-check`): builds the last commit, and tries the wheel in fresh environments.

Only what is committed is built, in a clean clone. Each environment has one of the supported versions of Python with the
newest libraries that the wheel allows; one more has the oldest Python with the oldest libraries. In an empty folder of
each, the demo, a plan, a campaign of four flights and two verifications must succeed. An interpreter that uv neither
finds nor can install is named and left out.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
WHEEL_BYTES_MAX = 5_000_000
DEMO_SECONDS_MAX = 60.0
STUDY = """format = 1
name = "four-flights"
scenario = "three-aircraft.toml"
seed = 1

[sampling]
method = "monte-carlo"
flights = 4

[[vary]]
path = "wind.speed_m_s"
distribution = "uniform"
low = 0.0
high = 5.0
"""
COMMANDS = {
    "demo": ["demo", "--out", "demo", "--quiet"],
    "new": ["new", "three-aircraft.toml", "--from", "three-aircraft", "--quiet"],
    "plan": ["plan", "three-aircraft.toml", "--quiet"],
    "campaign": ["campaign", "study.toml", "--out", "campaign", "--processes", "1", "--quiet"],
    "verify": ["verify", "--case", "f16-derivatives", "--case", "nesc-11", "--quiet"],
}


class Environment(NamedTuple):
    """Python version, and rule by which uv chooses the libraries."""

    python: str
    resolution: str

    @property
    def name(self) -> str:
        """Name of the environment and of its folder."""
        return f"{self.python}-{self.resolution}"


def main() -> int:
    """Run the check; returns 1 if a build, a limit or an environment fails."""
    parser = argparse.ArgumentParser(description="Build the last commit and try the wheel.")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "release", help="scratch folder, made anew")
    parser.add_argument("--only", nargs="*", default=[], help="such as 3.12-highest or 3.11-lowest-direct")
    options = parser.parse_args()
    folder = options.folder.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    tools = _install_tools(folder)
    wheel = _build(folder, tools)
    environments = [
        *(Environment(python, "highest") for python in PYTHONS),
        Environment(PYTHONS[0], "lowest-direct"),
    ]
    chosen = [environment for environment in environments if environment.name in options.only or not options.only]
    failed, missing = [], []
    for environment in chosen:
        outcome = _try(environment, folder, tools, wheel)
        if outcome is None:
            missing.append(environment.name)
        elif not outcome:
            failed.append(environment.name)
    passed = [environment.name for environment in chosen if environment.name not in failed + missing]
    for title, names in (("passed", passed), ("failed", failed), ("no interpreter", missing)):
        if names:
            _print(f"{title}: {', '.join(names)}")
    return 1 if failed or not passed else 0


def _install_tools(folder: Path) -> Path:
    """Install the build tools into an environment of their own; returns the folder of its programs."""
    _run([sys.executable, "-m", "venv", folder / "tools"])
    tools = folder / "tools" / "bin"
    _run([tools / "python", "-m", "pip", "--quiet", "install", "build", "twine", "uv"])
    return tools


def _build(folder: Path, tools: Path) -> Path:
    """Build source distribution and wheel from a clean clone, check both, and return the wheel."""
    clone, dist = folder / "clone", folder / "dist"
    _run(["git", "clone", "--quiet", ROOT, clone])
    _run([tools / "python", "-m", "build", "--outdir", dist, clone])
    files = sorted(dist.iterdir())
    _run([tools / "twine", "check", "--strict", *files])
    (wheel,) = dist.glob("*.whl")
    for file in files:
        _print(f"{file.name}: {file.stat().st_size / 1e6:.2f} MB, metadata good")
    if wheel.stat().st_size > WHEEL_BYTES_MAX:
        raise SystemExit(f"{wheel.name}: arrived {wheel.stat().st_size} bytes; expected at most {WHEEL_BYTES_MAX}")
    return wheel


def _try(environment: Environment, folder: Path, tools: Path, wheel: Path) -> bool | None:
    """Install the wheel into a fresh environment and run the commands; None without an interpreter."""
    home, work = folder / environment.name, folder / f"{environment.name}-work"
    found = _run([tools / "uv", "venv", "--quiet", "--python", environment.python, home], check=False)
    if found.returncode:
        _print(f"{environment.name}: no interpreter: {found.stderr.strip()}")
        return None
    python = home / "bin" / "python"
    # pip compiles to bytecode too, so that the first command does not have to
    options = ["--quiet", "--compile-bytecode"]
    pinned = folder / f"{environment.name}.txt"
    resolved = ["--resolution", environment.resolution, "--python-version", environment.python]
    _run(
        [tools / "uv", "pip", "compile", "--quiet", *resolved, "--output-file", pinned, folder / "clone/pyproject.toml"]
    )
    installed = _run([tools / "uv", "pip", "install", *options, "--python", python, "-c", pinned, wheel], check=False)
    if installed.returncode:
        _print(f"{environment.name}: not installed:\n{installed.stderr}")
        return False
    work.mkdir()
    (work / "study.toml").write_text(STUDY, encoding="utf-8")
    variables = {key: value for key, value in os.environ.items() if not key.startswith(("ANSER_", "PYTHON", "XLA_"))}
    variables["ANSER_COMPILATION_CACHE"] = str(work / "compiled")
    problems: list[str] = []
    report = [environment.name, _versions(python, variables)]
    for name, arguments in COMMANDS.items():
        start, processor_start = time.perf_counter(), _processor_s()
        done = _run([home / "bin" / "anser", *arguments], check=False, cwd=work, env=variables)
        wall, processor = time.perf_counter() - start, _processor_s() - processor_start
        report.append(f"{name} {wall:.0f} s ({processor:.0f} s of processor)")
        too_slow = name == "demo" and wall > DEMO_SECONDS_MAX
        if done.returncode or too_slow:
            reason = f"longer than {DEMO_SECONDS_MAX:g} s" if too_slow else f"exit code {done.returncode}"
            problems.append(f"{name}: {reason}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    _print("\n".join([", ".join(report), *problems]))
    return not problems


def _versions(python: Path, variables: dict[str, str]) -> str:
    """Return the versions of the interpreter, of anser with its commit, and of the libraries in its provenance."""
    program = "from anser.results.documents import software_versions as v; print(*map(' '.join, v().items()), sep=', ')"
    return _run([python, "-c", program], env=variables).stdout.strip()


def _processor_s() -> float:
    """Return the processor time of all finished commands, s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _run(command: list, *, check: bool = True, **options) -> subprocess.CompletedProcess[str]:
    completed = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, **options)
    if check and completed.returncode:
        raise SystemExit(f"{command}: exit code {completed.returncode}\n{completed.stdout}\n{completed.stderr}")
    return completed


def _print(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
