"""Scenario.replace validates like a file; the ways around the validation are closed."""

import copy
from pathlib import Path

import numpy as np
import pytest

from anser.config import ScenarioError
from anser.config.key_paths import repeated_paths, value_at
from anser.scenario import load, loads
from anser.scenario.files import starter_scenario

FOLDER = Path(__file__).parents[2] / "scenarios"
SHIPPED = sorted(FOLDER.glob("*.toml"))
THREE = load(FOLDER / "three-aircraft.toml")
TWENTY = load(FOLDER / "twenty-aircraft.toml")


def refused(*changes, scenario=THREE):
    with pytest.raises(ScenarioError) as caught:
        scenario.replace(*changes)
    return str(caught.value)


def test_a_number_is_replaced_by_its_path():
    original_hash = THREE.hash
    changed = THREE.replace("wind.speed_m_s", 8.0)  # the table [wind] is not written out in the file
    assert changed.wind.speed_m_s == 8.0
    assert (THREE.wind.speed_m_s, THREE.hash) == (0.0, original_hash)
    text = (FOLDER / "three-aircraft.toml").read_text()
    assert changed.hash == loads(f"{text}\n[wind]\nspeed_m_s = 8.0\n").hash


def test_items_are_selected_by_number_or_name():
    by_number = THREE.replace("aircraft[1].start.speed_m_s", 149.0, "goal[0].course_deg", 10.0)
    by_name = THREE.replace('aircraft["aircraft-2"].start.speed_m_s', 149.0, "goal[boat-north].course_deg", 10.0)
    assert by_number.aircraft[1].start.speed_m_s == 149.0
    assert by_number == by_name
    numbers = THREE.replace("goal[0].name", "7", "aircraft[0].goal", "7").replace('goal["7"].speed_m_s', 3.0)
    assert numbers.goal[0].speed_m_s == 3.0


def test_keys_of_optional_tables_that_a_file_leaves_out_have_their_defaults():
    assert value_at(THREE, "atmosphere.temperature_offset_k") == 0.0
    assert value_at(THREE, "network.loss") == 0.0
    assert value_at(THREE, "atmosphere") is None
    assert value_at(THREE, "atmosphere.sounding.level") is None  # required in a sounding
    assert value_at(THREE, "aircraft[0]") == THREE.aircraft[0].model_dump(mode="json")
    assert value_at(THREE, "aircraft") == THREE.model_dump(mode="json")["aircraft"]
    paths = ["network.loss", "network.loss"]
    assert repeated_paths(THREE, paths) == tuple(paths)
    for path, message in (
        ("atmosphere.temperature_c", 'unknown key "temperature_c"; expected one of the keys temperature_offset_k'),
        ("goal[0].waypoints.time_s", 'the key "time_s" of nothing'),
        ("goal[0].waypoints[0].time_s", "an item, [0], of what is no list"),
    ):
        with pytest.raises(ScenarioError) as caught:
            value_at(THREE, path)
        assert message in str(caught.value)


def test_several_replacements_are_validated_together():
    """Rule and time belong together: neither is valid alone."""
    timed = TWENTY.replace("arrival", {"rule": "at", "time_s": 250.0})
    assert timed == TWENTY.replace("arrival", {}, "arrival.rule", "at", "arrival.time_s", 250.0)
    assert "arrival.time_s: arrived nothing; expected a number (s)" in refused(
        "arrival", {"rule": "at"}, scenario=TWENTY
    )


def test_whole_tables_lists_and_numbers_of_arrays():
    fewer = THREE.replace("aircraft", THREE.aircraft[:2])
    assert fewer.aircraft == THREE.aircraft[:2]
    seeds = THREE.replace("seed", np.int64(3), "fleet.speed_m_s", np.float64(151.5))
    assert (seeds.seed, seeds.fleet.speed_m_s) == (3, 151.5)
    layers = [{"altitude_m": 0.0, "speed_m_s": 3.0}, {"altitude_m": 2000, "speed_m_s": 12.0}]
    sheared = THREE.replace("wind", {"layers": layers})
    assert sheared.replace("wind.layers[1].speed_m_s", 9.0).wind.layers[1].speed_m_s == 9.0
    assert sheared.replace("wind.layers", None) == THREE


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_replacement_by_the_same_value_changes_nothing(path):
    scenario = load(path)
    replaced = scenario.replace("name", scenario.name)
    assert replaced == scenario
    assert replaced.hash == scenario.hash
    assert replaced.fleet.model_fields_set == scenario.fleet.model_fields_set
    starter = loads(starter_scenario())
    assert starter.replace("format", 2).hash == starter.hash


def test_replaced_values_are_validated():
    """A fleet speed of -5 once flew into the ground; a stand-off below the minimum is refused as in a file."""
    said = refused("fleet.speed_m_s", -5.0)
    assert "three-aircraft with fleet.speed_m_s replaced: 1 problem" in said
    assert "fleet.speed_m_s: arrived -5.0; expected a number from 1 to 340 m/s" in said
    low = refused("aircraft[aircraft-1].rendezvous.stand_off_up_m", 50.0)
    assert 'aircraft[0].rendezvous.stand_off_up_m (aircraft "aircraft-1"): arrived 50; expected at least 150 m' in low
    assert "expected a wind slower than fleet.speed_m_s" in refused("wind.speed_m_s", 92.0, "fleet.speed_m_s", 91.0)
    assert "arrived nan" in refused("fleet.speed_m_s", float("nan"))
    assert "format: arrived 3" in refused("format", 3)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("fleet.sped_m_s", 'fleet.sped_m_s: arrived the unknown key "sped_m_s"; expected perhaps "speed_m_s"'),
        ("wnd.speed_m_s", 'wnd: arrived the unknown key "wnd"; expected perhaps "wind"'),
        ("start.speed_m_s", "expected perhaps the table [aircraft.start]"),
        ("fleet.speed_m_s.x", 'fleet.speed_m_s: arrived the key "x" of 150'),
        ("fleet[0].speed_m_s", "fleet: arrived an item, [0], of what is no list; expected a path without it"),
        ("aircraft[3].bend", "arrived the item [3] of a list of 3; expected aircraft[0] to aircraft[2], or by name"),
        ("aircraft[aircraft-4].bend", 'the name "aircraft-4", which no item has; expected perhaps "aircraft-'),
        ("aircraft.bend", 'aircraft: arrived the key "bend" of a list; expected aircraft[0] to'),
        ("keep_out[0].radius_m", "keep_out: arrived an item, [0], of a list that is not written out"),
        ("wind..speed_m_s", 'arrived "wind..speed_m_s" as a path; expected keys with dots'),
        ("", 'arrived "" as a path'),
        (3, "arrived 3 as a path"),
    ],
)
def test_an_unknown_path_is_refused_with_a_suggestion(path, said):
    assert said in refused(path, 1.0)


def test_a_path_without_a_value_is_a_type_error():
    with pytest.raises(TypeError, match=r"the path 'seed' has no value"):
        THREE.replace("fleet.speed_m_s", 160.0, "seed")


def test_methods_without_validation_are_closed():
    tables = (THREE, THREE.fleet, THREE.aircraft[0].start, THREE.wind)
    for table in tables:
        name = type(table).__name__
        with pytest.raises(TypeError, match=rf"{name}\.model_copy\(update=\.\.\.\).*scenario\.replace\("):
            table.model_copy(update={"speed_m_s": -5.0})
        with pytest.raises(TypeError, match=rf"{name}\.copy\(\).*scenario\.replace\("):
            table.copy(update={"speed_m_s": -5.0})
        with pytest.raises(TypeError, match=rf"{name}\.model_construct\(\).*scenario\.replace\("):
            type(table).model_construct(speed_m_s=-5.0)
        for duplicate in (table.model_copy(), table.model_copy(deep=True), copy.copy(table), copy.deepcopy(table)):
            assert duplicate == table
