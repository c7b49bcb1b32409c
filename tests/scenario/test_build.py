"""From scenario to arrays: units, signs, stacking."""

import tomllib
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

from anser.scenario import build_flight, load, loads
from anser.scenario.build import _kept_flights
from anser.scenario.build_aircraft import build_path_limits
from anser.scenario.files import starter_scenario
from anser.scenario.schema import UnplannedScenario, validate
from support.fleet_flight import parts_of

SCENARIOS = Path(__file__).parents[2] / "scenarios"


@pytest.fixture(scope="module")
def storm():
    scenario = load(SCENARIOS / "storm-sampling.toml")
    return scenario, build_flight(scenario)


def test_units_and_signs_are_converted(storm):
    scenario, flight = storm
    parts, group = parts_of(flight), flight.groups[0]
    aircraft = scenario.aircraft[0]
    np.testing.assert_allclose(
        group.start_positions_n[0], [aircraft.start.north_m, aircraft.start.east_m, -aircraft.start.altitude_m]
    )
    np.testing.assert_allclose(group.starts.course[0], np.deg2rad(aircraft.start.course_deg))
    # Stand-off up is negative down; the wind of 12 m/s from 240 deg blows toward 60 deg.
    np.testing.assert_allclose(parts.mission.rendezvous.stand_off_n[0], [0.0, -700.0, -600.0])
    toward = np.deg2rad(60.0)
    wind_n = flight.environment.wind.at(group.start_positions_n[0], 0.0)
    np.testing.assert_allclose(wind_n, 12 * np.array([np.cos(toward), np.sin(toward), 0.0]), atol=1e-12)
    # The storm's points drift with the wind.
    np.testing.assert_allclose(parts.mission.goal.velocity_after_n[2], wind_n, atol=1e-12)


def test_gravity_is_that_of_the_latitude(storm):
    _, flight = storm
    # Somigliana at 48 deg (theory section 1).
    s2 = np.sin(np.deg2rad(48.0)) ** 2
    expected = 9.7803267714 * (1 + 0.00193185138639 * s2) / np.sqrt(1 - 0.0818191908426**2 * s2)
    np.testing.assert_allclose(flight.environment.gravity, expected, rtol=1e-9)


def test_keys_of_the_adaptation_have_no_effect_on_another_inversion(storm):
    scenario, _ = storm
    scenario = scenario.replace("aircraft[0].deviation", {"drag": 1.1})  # with an onboard model of its own
    changed = scenario.replace("aircraft[0].adaptation.probing_deg", 1.0)
    unknown = scenario.replace("aircraft[0].adaptation.aerodynamics_known", False)
    expected = build_flight(scenario)
    assert eqx.tree_equal(build_flight(changed), expected)
    assert eqx.tree_equal(build_flight(unknown), expected)


def test_every_leaf_of_a_flight_is_an_array_of_fixed_type(storm):
    _, flight = storm
    for leaf in jax.tree.leaves(flight):
        assert isinstance(leaf, jax.Array)
        assert not leaf.weak_type


@pytest.mark.parametrize(
    "name", ["storm-sampling", pytest.param("mixed-fleet", marks=pytest.mark.long), "turning-ships", "uncertain-world"]
)
def test_a_moved_goal_gives_the_flight_of_a_new_build(name):
    scenario = load(SCENARIOS / f"{name}.toml")
    build_flight(scenario, pad_fleet=True)
    north_m, east_m, altitude_m = scenario.goal[0].position_m(0.0)
    place = {"north_m": north_m + 150.0, "east_m": east_m + 90.0, "altitude_m": altitude_m}
    moved = scenario.replace("goal[0]", {"name": scenario.goal[0].name, "kind": scenario.goal[0].kind, **place})
    from_kept_parts = build_flight(moved, pad_fleet=True)
    _kept_flights.clear()
    assert eqx.tree_equal(from_kept_parts, build_flight(moved, pad_fleet=True))
    assert not eqx.tree_equal(from_kept_parts, build_flight(scenario, pad_fleet=True))


def test_settings_of_single_aircraft_reach_the_flight(storm):
    text = (SCENARIOS / "three-aircraft.toml").read_text()
    text = text.replace(
        'name = "aircraft-2"', 'name = "aircraft-2"\nbend = "right"\nvariant = "s119"\nx_cg_over_c = 0.31'
    )
    text += '\n[[aircraft]]\nname = "fourth"\ngoal = "tour"\ngains.velocity.proportional = [0.9, 1.1, 1.2]\n'
    text += "start = { north_m = 9000.0, east_m = 0.0, altitude_m = 1250.0, speed_m_s = 150.0, course_deg = 180.0 }\n"
    text += '[[goal]]\nname = "tour"\nkind = "surface"\nwaypoints = [{ time_s = 0.0, north_m = 0.0, east_m = 500.0, '
    text += "altitude_m = 0.0 }, { time_s = 100.0, north_m = 0.0, east_m = 900.0, altitude_m = 0.0 }]\n"
    flight = build_flight(loads(text))
    assert list(np.asarray(flight.planner.sides)) == [0, 1, 0, 0]
    np.testing.assert_allclose(parts_of(flight).airframe.x_cg, [0.30, 0.31, 0.30, 0.30])
    # s119 weighs 637.1595 slug.
    np.testing.assert_allclose(parts_of(flight).airframe.mass_properties.mass[1], 637.1595 * 14.593902937, rtol=1e-8)
    np.testing.assert_allclose(parts_of(flight).controller.gains.velocity.proportional[3], [0.9, 1.1, 1.2])
    tour = jax.tree.map(lambda leaf: leaf[3], parts_of(flight).mission.goal)
    np.testing.assert_allclose(tour.position_n(50.0), [0.0, 700.0, 0.0])
    still = jax.tree.map(lambda leaf: leaf[1], parts_of(flight).mission.goal)
    np.testing.assert_allclose(still.position_n(50.0), [0.0, 0.0, 0.0])


def test_path_limits_follow_from_the_scenario(storm):
    scenario, _ = storm
    limits = build_path_limits(scenario)
    np.testing.assert_allclose(limits.bank_max, np.deg2rad(scenario.limits.bank_max_deg))


def test_the_roll_rate_reaches_planner_and_autopilot():
    """The plan keeps a reserve of the limit; without a limit, plans use the default roll rate."""
    text = starter_scenario()
    gentle = build_flight(loads(text))
    np.testing.assert_allclose(gentle.planner.limits.bank_rate_max, 0.9 * np.deg2rad(5.0))
    np.testing.assert_allclose(parts_of(gentle).controller.limits.bank_rate_max, np.deg2rad(5.0))
    unlimited = build_flight(loads(text.replace("roll_rate_max_deg_s", "# roll_rate_max_deg_s")))
    assert unlimited.planner.limits.bank_rate_max is None
    assert parts_of(unlimited).controller.limits.bank_rate_max is None
    np.testing.assert_allclose(unlimited.planner.roll_rates_max, np.deg2rad(20.0))


@pytest.mark.parametrize("seed", [0, 7, 2**31 + 5])
def test_the_key_is_that_of_jax_with_the_flight_folded_in(storm, seed):
    flight = build_flight(storm[0].replace("seed", seed), flight=3)
    expected = jax.random.key_data(jax.random.fold_in(jax.random.key(seed), 3))
    assert flight.randomness.key.dtype == expected.dtype
    np.testing.assert_array_equal(flight.randomness.key, expected)


def test_a_mission_that_was_not_checked_is_not_flown():
    """Nothing is required of the stand-off in such a scenario, which serves learning environments."""
    values = tomllib.loads((SCENARIOS / "single-aircraft.toml").read_text(encoding="utf-8"))
    unplanned = validate(values, "environment", UnplannedScenario)
    with pytest.raises(ValueError, match="whose mission was not checked"):
        build_flight(unplanned)
    assert build_flight(unplanned, mission_is_flown=False).count == len(unplanned.aircraft)
