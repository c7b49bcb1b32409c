"""Building a flight computes with NumPy: JAX would compile a program for each operation, in every process."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

SCENARIOS = Path(__file__).parents[2] / "scenarios"
BUILD = """
import logging
import jax
import anser
from anser.scenario.build import build_flight

names = []
handler = logging.Handler()
handler.emit = lambda record: names.append(record.getMessage())
jax.config.update("jax_log_compiles", True)
logging.getLogger("jax").addHandler(handler)
build_flight(anser.load("{scenario}"))
jax.numpy.arange(7) * 2  # is logged, so that the test can fail
print("\\n".join(names))
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("scenario", "programs"),
    [
        ("uncertain-world", set()),
        ("three-uavs", {"flat", "<lambda>"}),
    ],  # the latter: trims by a program, and its options
)
def test_single_operations_are_not_compiled_while_a_flight_is_built(scenario, programs):
    script = BUILD.format(scenario=(SCENARIOS / f"{scenario}.toml").as_posix())
    printed = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    compiled = set(re.findall(r"Compiling jit\((.+?)\)", printed))
    assert compiled == {"iota", "multiply"} | programs
