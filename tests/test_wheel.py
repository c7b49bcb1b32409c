"""The built wheel: complete, and able to plan and fly when installed unpinned on the newest local Python."""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from anser.config.shipped_files import SHIPPED
from anser.version import BUILD_INFO

ROOT = Path(__file__).parents[1]
_ASK = "import sys, venv, ensurepip; print(*sys.version_info[:2])"

_PIP = ("-m", "pip", "--quiet", "--disable-pip-version-check")


def _version_of(python):
    """(major, minor) of an interpreter with venv; None otherwise, such as for a shim without a version."""
    completed = subprocess.run([python, "-c", _ASK], capture_output=True, text=True, check=False)
    return tuple(map(int, completed.stdout.split())) if completed.returncode == 0 else None


def _newest_python():
    folders = [Path(folder) for folder in os.environ.get("PATH", "").split(os.pathsep) if folder]
    folders += Path.home().glob(".pyenv/versions/*/bin")
    interpreters = {
        path
        for folder in folders
        if folder.is_dir()
        for path in folder.iterdir()
        if re.fullmatch(r"python3\.\d+", path.name)
    }
    versions = {version: str(path) for path in sorted(interpreters) if (version := _version_of(path))}
    return max({sys.version_info[:2]: sys.executable, **versions}.items())


def _run(*arguments, **options):
    completed = subprocess.run(arguments, capture_output=True, text=True, check=False, **options)
    assert completed.returncode == 0, (
        f"{arguments} ended with {completed.returncode}:\n{completed.stdout[-4000:]}\n{completed.stderr[-4000:]}"
    )
    return completed.stdout


@pytest.fixture(scope="module", name="wheel")
def built(tmp_path_factory):
    """The wheel, and environment variables for its commands, without paths and flags of this environment."""
    folder = tmp_path_factory.mktemp("wheel")
    environment = {
        key: value
        for key, value in os.environ.items()
        if key not in {"XLA_FLAGS", "PYTHONPATH", "VIRTUAL_ENV", "PIP_CONSTRAINT", "ANSER_TEST_CACHE"}
    }
    environment["ANSER_COMPILATION_CACHE"] = str(folder / "compiled")
    environment["XLA_FLAGS"] = "--xla_backend_optimization_level=0"  # as all tests; every version knows it
    # Only what belongs to the package: a build beside other tests must not read their leavings.
    sources = folder / "sources"
    sources.mkdir()
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, sources)
    for name in ("src", "scenarios", "studies"):
        shutil.copytree(ROOT / name, sources / name, ignore=shutil.ignore_patterns("__pycache__"))
    _run(sys.executable, *_PIP, "wheel", "--no-deps", "--wheel-dir", folder, sources, env=environment)
    (wheel,) = folder.glob("anser-*.whl")
    return wheel, environment


@pytest.fixture(scope="module", name="anser")
def installed(wheel):
    """Command of a fresh environment."""
    wheel, environment = wheel
    folder = wheel.parent
    _, python = _newest_python()
    _run(python, "-m", "venv", folder / "env", env=environment)
    _run(folder / "env" / "bin" / "python", *_PIP, "install", wheel, env=environment)

    def call(*arguments):
        return _run(folder / "env" / "bin" / "anser", *arguments, env=environment, cwd=folder)

    call.folder = folder
    return call


def test_the_wheel_contains_every_file_of_the_package(wheel):
    packed = {name for name in zipfile.ZipFile(wheel[0]).namelist() if name.startswith(("anser/", "anser_command"))}
    contents = {
        str(path.relative_to(ROOT / "src"))
        for path in (ROOT / "src" / "anser").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    shipped = {
        f"anser/{SHIPPED}/{path.relative_to(ROOT)}"
        for name in ("scenarios", "studies")
        for path in (ROOT / name).rglob("*")
        if path.is_file()
    }
    assert packed == contents | shipped | {f"anser/{BUILD_INFO}", "anser_command.py"}


def test_the_wheel_is_small(wheel):
    assert wheel[0].stat().st_size <= 5e6


@pytest.mark.long
def test_the_wheel_flies_the_published_case(anser):
    anser("demo", "--out", "demo", "--quiet")
    summary = json.loads((anser.folder / "demo" / "summary.json").read_text())
    assert [aircraft["status"] for aircraft in summary["aircraft"]] == ["arrived"] * 3


@pytest.mark.long
def test_the_wheel_plans_and_flies_the_starter_scenario(anser):
    anser("new", "mine.toml")
    planned = json.loads(anser("plan", "mine.toml", "--json"))
    text = (anser.folder / "mine.toml").read_text()
    assert len(planned["aircraft"]) == text.count("\n[[aircraft]]") > 0
    anser("run", "mine.toml", "--out", "flown", "--quiet")
    summary = json.loads((anser.folder / "flown" / "summary.json").read_text())
    assert [aircraft["status"] for aircraft in summary["aircraft"]] == ["arrived"] * len(planned["aircraft"])
    assert summary["fleet"]["arrival_spread_s"] < 0.05
    assert 'planner = "certified"' in text


@pytest.mark.long
def test_the_published_planner_of_the_wheel_plans(anser):
    anser("new", "published.toml", "--from", "three-aircraft")
    text = (anser.folder / "published.toml").read_text()
    assert 'planner = "published"' in text
    published = json.loads(anser("plan", "published.toml", "--json"))
    assert len(published["aircraft"]) == text.count("\n[[aircraft]]") > 0
