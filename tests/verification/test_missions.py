"""The standard mission of the checks is the shipped scenario."""

from importlib import resources
from pathlib import Path

from anser.scenario import load
from anser.verification.missions import MISSION, mission_scenario

SCENARIOS = Path(__file__).parents[2] / "scenarios"


def test_the_copy_is_the_shipped_scenario():
    copy = resources.files("anser.verification").joinpath(f"data/{MISSION}").read_text(encoding="utf-8")
    assert copy == (SCENARIOS / MISSION).read_text(encoding="utf-8")


def test_the_mission_differs_from_the_scenario_only_in_the_requested_keys():
    shipped, mission = load(SCENARIOS / MISSION).model_dump(), mission_scenario("wgs84", 0.005).model_dump()
    assert (mission["earth"].pop("model"), mission["timing"].pop("step_s")) == ("wgs84", 0.005)
    # longer than the interval of the arrival (60.4 s); `mission` refuses a shorter duration
    assert 71.0 < mission["timing"].pop("duration_s") < shipped["timing"].pop("duration_s")
    del shipped["earth"]["model"], shipped["timing"]["step_s"]
    assert mission == shipped
