"""The standard mission of the checks is the scenario that is shipped."""

from importlib import resources
from pathlib import Path

from anser.scenario import load
from anser.verification.missions import MISSION, mission_scenario

SCENARIOS = Path(__file__).parents[2] / "scenarios"


def test_the_copy_is_the_shipped_scenario():
    copy = resources.files("anser.verification").joinpath(f"data/{MISSION}").read_text(encoding="utf-8")
    assert copy == (SCENARIOS / MISSION).read_text(encoding="utf-8")


def test_the_mission_differs_from_it_in_what_is_asked_for_alone():
    shipped, flown = load(SCENARIOS / MISSION).model_dump(), mission_scenario("wgs84", 0.005).model_dump()
    assert (flown["earth"].pop("model"), flown["timing"].pop("step_s")) == ("wgs84", 0.005)
    # long enough to arrive (60.4 s) and to see that no later pass is nearer; `mission` refuses a shorter one
    assert 71.0 < flown["timing"].pop("duration_s") < shipped["timing"].pop("duration_s")
    del shipped["earth"]["model"], shipped["timing"]["step_s"]
    assert flown == shipped
