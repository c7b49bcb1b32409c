"""Imports: help, check and new run without JAX, a flight without unused libraries; float64 in any order of imports."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCENARIO = str(ROOT / "scenarios" / "three-aircraft.toml")


def _run(program, folder):
    completed = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    return completed.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["check", SCENARIO], ["check", "limited.toml"], ["new", "mine.toml"]],
    ids=lambda x: x[-1][-12:],
)
def test_light_commands_do_not_import_jax(arguments, tmp_path):
    limits = "\n[limits]\nbank_max_deg = 40.0\n"  # beside an aircraft that is no F-16, with a trim map of its own
    (tmp_path / "limited.toml").write_text((ROOT / "scenarios" / "mixed-fleet.toml").read_text() + limits)
    program = f"""
import sys
sys.argv = ["anser", *{arguments!r}]
from anser.cli import main
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print("jax" in sys.modules)
"""
    assert _run(program, tmp_path) == "False"


@pytest.mark.parametrize("first_import", ["import anser, jax", "import jax, anser"])
def test_arrays_are_float64_in_either_order_of_import(first_import, tmp_path):
    assert _run(f"{first_import}\nimport jax.numpy as jnp\nprint(jnp.zeros(3).dtype)", tmp_path) == "float64"


def test_the_verbosity_of_xla_is_left_to_the_user(tmp_path, monkeypatch):
    monkeypatch.delenv("TF_CPP_MIN_LOG_LEVEL", raising=False)
    assert _run('import os, anser\nprint("TF_CPP_MIN_LOG_LEVEL" in os.environ)', tmp_path) == "False"


@pytest.mark.long
def test_a_flight_imports_only_what_it_uses(tmp_path):
    program = f"""
import sys
sys.argv = ["anser", "run", {SCENARIO!r}, "--set", "timing.duration_s=62", "--set", "timing.step_s=0.02", "--out", "flight"]
from anser.cli import main
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print([name for name in ("scipy", "dask", "distributed", "matplotlib", "SALib", "zarr") if sys.modules.get(name)])
"""
    assert _run(program, tmp_path) == "[]"
