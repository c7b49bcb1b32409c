"""The standard mission of the checks is the scenario that is shipped."""

from importlib import resources
from pathlib import Path

from anser.verification.missions import MISSION

SCENARIOS = Path(__file__).parents[2] / "scenarios"


def test_the_copy_is_the_shipped_scenario():
    copy = resources.files("anser.verification").joinpath(f"data/{MISSION}").read_text(encoding="utf-8")
    assert copy == (SCENARIOS / MISSION).read_text(encoding="utf-8")
