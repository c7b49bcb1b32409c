"""Loading and checking a scenario computes nothing costly: without JAX, without trim, within a fraction of a second."""

import subprocess
import sys
from pathlib import Path

import pytest

UAVS = Path(__file__).resolve().parents[2] / "scenarios" / "three-uavs.toml"
CHECK = """
import sys
from anser.cli import main
sys.argv = ["anser", "check", sys.argv[1]]
try:
    main()
except SystemExit as stop:
    assert not stop.code, stop.code
heavy = {"jax", "jaxlib", "equinox"} & set(sys.modules)
assert not heavy, heavy
"""
LOAD = """
import sys, time
import anser
anser.load  # imports the schema
start = time.process_time()
scenario = anser.load(sys.argv[1])
assert time.process_time() - start <= 0.2
assert "jax" not in sys.modules
"""
CHANGES = {
    "as it is": ("", ""),
    "with limits": ("[timing]", "[limits]\nbank_max_deg = 70.0\n[timing]"),
    "with gains": (
        "[[goal]]",
        "[aircraft.gains.velocity]\nproportional = [1.0, 1.6, 1.0]\n"
        "[aircraft.gains.attitude]\nproportional = 2.0\n\n[[goal]]",
    ),
}


def run_script(script: str, path: Path) -> str:
    finished = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=False)
    assert finished.returncode == 0, finished.stderr
    return finished.stdout + finished.stderr


@pytest.mark.parametrize("change", CHANGES)
def test_a_check_imports_no_jax(change, tmp_path):
    path = tmp_path / "uavs.toml"
    path.write_text(UAVS.read_text(encoding="utf-8").replace(*CHANGES[change], 1), encoding="utf-8")
    output = run_script(CHECK, path)
    assert "good. three-uavs" in output
    assert ("the loop of gamma has a bandwidth of 1.6 1/s" in output) == (change == "with gains")


def test_a_load_takes_a_fraction_of_a_second_without_jax():
    run_script(LOAD, UAVS)
