"""The standard mission of the checks is the shipped scenario."""

from pathlib import Path

from anser.scenario import load
from anser.verification.missions import MISSION, mission_scenario

SCENARIOS = Path(__file__).parents[2] / "scenarios"


def test_the_mission_differs_from_the_scenario_only_in_the_requested_keys():
    shipped, mission = load(SCENARIOS / f"{MISSION}.toml").model_dump(), mission_scenario("wgs84", 0.005).model_dump()
    assert (mission["earth"].pop("model"), mission["timing"].pop("step_s")) == ("wgs84", 0.005)
    # longer than the interval of the arrival (60.4 s); `mission` refuses a shorter duration
    assert 71.0 < mission["timing"].pop("duration_s") < shipped["timing"].pop("duration_s")
    del shipped["earth"]["model"], shipped["timing"]["step_s"]
    assert mission == shipped
