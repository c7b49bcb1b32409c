"""Aircraft files in scenarios: relative paths, content in the hash, and refusals."""

import types
from pathlib import Path

import pytest

from anser.aircraft import DerivativeAircraft
from anser.aircraft_files import load_airframe, read_airframe, sources
from anser.aircraft_files.sources import aircraft_types
from anser.airframe_data import derivative_index
from anser.config import ScenarioError
from anser.scenario import build_flight, load, loads, validate
from support.aerosonde_file import AEROSONDE, built

FLEET = """
format = 2
name = "one-uav"
timing.duration_s = 120
fleet.speed_m_s = 25.0
limits.climb_rate_max_m_s = 3.0
hold.radius_m = 300
[[goal]]
name = "boat"
kind = "surface"
north_m = 2000
east_m = 300
speed_m_s = 4
course_deg = 60
[[aircraft]]
name = "a"
AIRFRAME
goal = "boat"
start = {north_m = 0, east_m = 0, altitude_m = 200, speed_m_s = 25, course_deg = 0}
"""


def fleet(airframe, **changes):
    text = FLEET.replace("AIRFRAME", airframe)
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "my-uav.toml").write_text(AEROSONDE, encoding="utf-8")
    (tmp_path / "fleet.toml").write_text(fleet('airframe = "my-uav.toml"'), encoding="utf-8")
    return tmp_path


def test_an_aircraft_file_path_is_relative_to_the_scenario(folder, monkeypatch):
    monkeypatch.chdir("/")
    scenario = load(folder / "fleet.toml")
    assert scenario.aircraft[0].airframe == read_airframe(folder / "my-uav.toml")
    kind = build_flight(scenario).groups[0]
    assert isinstance(kind.vehicles.at(0).airframe, DerivativeAircraft)


def test_parts_kept_for_a_moved_goal_are_those_of_the_present_file(folder):
    scenario = load(folder / "fleet.toml")
    flights = [build_flight(case, pad_fleet=True) for case in (scenario, scenario.replace("goal[0].north_m", 1900.0))]
    (folder / "my-uav.toml").write_text(AEROSONDE.replace("mass_kg = 11.0", "mass_kg = 11.5"), encoding="utf-8")
    flights.append(build_flight(load(folder / "fleet.toml"), pad_fleet=True))
    vehicles = [flight.groups[0].vehicles.at(0) for flight in flights]
    assert [float(vehicle.airframe.mass_properties.mass) for vehicle in vehicles] == [11.0, 11.0, 11.5]
    assert [float(vehicle.mission.goal.position_n(0.0)[0]) for vehicle in vehicles] == [2000.0, 1900.0, 2000.0]


def test_the_hash_depends_on_the_content_of_the_aircraft_file(folder):
    original = load(folder / "fleet.toml")
    (folder / "my-uav.toml").write_text(AEROSONDE.replace("mass_kg = 11.0", "mass_kg = 11.5"), encoding="utf-8")
    edited = load(folder / "fleet.toml")
    assert original.hash != edited.hash
    written = original.model_dump(mode="json", exclude_unset=True)  # as in the record of a flight
    assert validate(written).hash == original.hash  # a record flies without the file
    assert original.replace("fleet.speed_m_s", 24.0).aircraft[0].airframe == original.aircraft[0].airframe
    heavier = original.replace("aircraft[0].airframe.mass.mass_kg", 11.5)  # what a study varies
    assert heavier.hash == edited.hash


def test_a_study_that_makes_an_impossible_body_is_refused(folder):
    fleet, path = load(folder / "fleet.toml"), "aircraft[0].airframe.mass"
    with pytest.raises(ScenarioError, match=r"airframe\.mass\.Jzz_kg_m2 .*arrived 2\.5; expected at most Jxx \+ Jyy"):
        fleet.replace(f"{path}.Jzz_kg_m2", 2.5)
    with pytest.raises(ScenarioError, match=r"airframe\.mass\.mass_kg .*expected a number above 0"):
        fleet.replace(f"{path}.mass_kg", -1.0)


def test_problems_of_an_aircraft_file_name_that_file(folder):
    (folder / "my-uav.toml").write_text(AEROSONDE.replace("CL_alpha", "CL_alfa"), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"my-uav\.toml: 1 problem\n  line 24, aerodynamics\.CL_alfa"):
        load(folder / "fleet.toml")
    (folder / "my-uav.toml").unlink()
    (folder / "my-uaf.toml").touch()
    with pytest.raises(
        ScenarioError, match=r"fleet.toml: 1 problem\n  line \d+, aircraft\[0\]\.airframe: .* perhaps .*my-uaf"
    ):
        load(folder / "fleet.toml")


@pytest.mark.parametrize(
    ("airframe", "path", "expected"),
    [
        (
            'airframe = "my-uav.toml"\ntype = "f16"',
            "aircraft[0].airframe",
            "either airframe, the path of a file, or type",
        ),
        ('airframe = "my-uav.txt"', "aircraft[0].airframe", "a name that ends with"),
        ('type = "aerosond"', "aircraft[0].type", 'perhaps "aerosonde"'),
        ('type = "aerosonde"\nvariant = "s119"', "aircraft[0].variant", "F-16 alone"),
        ('type = "aerosonde"\nx_cg_over_c = 0.3', "aircraft[0].x_cg_over_c", "F-16 alone"),
        ('type = "aerosonde"\ndeviation.coefficients.CZ0 = 1.1', "aircraft[0].deviation.coefficients.CZ0", "CL_alpha"),
        ('type = "f16"\ndeviation.coefficients.CL_alpha = 1.1', "aircraft[0].deviation.coefficients.CL_alpha", "CZ0"),
    ],
)
def test_invalid_airframes_are_refused(airframe, path, expected):
    with pytest.raises(ScenarioError) as caught:
        loads(fleet(airframe))
    message = "\n".join(map(str, caught.value.problems))
    assert expected in message or expected in str(caught.value.problems[0].arrived)
    assert path in [problem.path for problem in caught.value.problems]


@pytest.mark.parametrize(("speed", "refused"), [(12.0, True), (13.0, False), (40.0, False), (41.0, True)])
def test_a_start_outside_the_aircraft_s_airspeeds_names_them(speed, refused):
    text = fleet('type = "aerosonde"', start=("speed_m_s = 25, c", f"speed_m_s = {speed}, c"))
    if not refused:
        assert loads(text).aircraft[0].start.speed_m_s == speed
        return
    with pytest.raises(ScenarioError, match="from 13 to 40 m/s, where the data of aerosonde hold"):
        loads(text)


def test_an_f16_still_starts_at_30_m_s_or_faster():
    text = fleet('type = "f16"', start=("speed_m_s = 25, c", "speed_m_s = 29, c"))
    with pytest.raises(ScenarioError, match="from 30 to 340 m/s, where the data of f16 hold"):
        loads(text)


def test_limits_of_an_f16_keep_to_the_angles_of_attack_of_its_variant():
    speed = ("speed_m_s = 25, c", "speed_m_s = 150, c"), ("fleet.speed_m_s = 25.0", "fleet.speed_m_s = 150.0")
    changes = {"start": speed[0], "speed": speed[1], "hold": ("radius_m = 300", "radius_m = 4000")}
    for variant, alpha_min_deg in (("textbook", -5.0), ("tp1538", -5.0), ("global", -4.0)):
        limits = loads(fleet(f'variant = "{variant}"', **changes)).limits
        assert (limits.alpha_min_deg, limits.alpha_max_deg) == (alpha_min_deg, 25.0)
    changes["alpha"] = ("limits.climb", "limits.alpha_max_deg = 45\nlimits.climb")
    assert loads(fleet('variant = "textbook"', **changes)).limits.alpha_max_deg == 45.0
    with pytest.raises(
        ScenarioError, match=r"arrived 45; expected at most 30 deg, where the data of f16 \(global\) hold"
    ):
        loads(fleet('variant = "global"', **changes))


def test_limits_left_out_follow_from_the_aircraft():
    scenario = loads(fleet('type = "aerosonde"'))
    assert (scenario.limits.speed_min_m_s, scenario.limits.speed_max_m_s) == (13.0, 40.0)
    assert (scenario.limits.alpha_min_deg, scenario.limits.alpha_max_deg) == (-5.0, 25.0)
    assert "speed_min_m_s" not in scenario.limits.model_fields_set
    with pytest.raises(ScenarioError, match=r"limits.speed_max_m_s: arrived 60; expected at most 40 m/s"):
        loads(fleet('type = "aerosonde"', limits=("limits.climb", "limits.speed_max_m_s = 60\nlimits.climb")))


def test_a_deviation_flies_another_aircraft_than_its_autopilot_knows():
    aircraft_keys = 'type = "aerosonde"\ndeviation = {mass = 1.1, thrust = 0.9, cg_shift = 0.05, coefficients = {Cm_alpha = 0.8, Cm_elevator = 0.7}}'
    airframe = build_flight(loads(fleet(aircraft_keys))).groups[0].vehicles.at(0).airframe
    assert float(airframe.mass_properties.mass) == pytest.approx(12.1)
    assert float(airframe.engine.thrust_factor) == pytest.approx(0.9)
    indices = [derivative_index(name, airframe.actuators.names) for name in ("Cm_alpha", "Cm_elevator", "Cm_q")]
    assert [float(airframe.derivatives[index]) for index in indices] == pytest.approx(
        [-2.74 * 0.8, -0.99 * 0.7, -38.21]
    )


class _EntryPoint:
    """A fake entry point of an installed package."""

    name, value = "glider", "my_package:glider"

    def __init__(self, airframe=None, version=None):
        self.airframe = airframe
        self.dist = None if version is None else types.SimpleNamespace(name="my-package", version=version)

    def load(self):
        return lambda: self.airframe


@pytest.fixture
def offering(monkeypatch):
    """Replace the entry points of the installed packages."""

    def offer(*points):
        monkeypatch.setattr(sources.importlib.metadata, "entry_points", lambda group: points)
        sources.entry_points.cache_clear()

    yield offer
    monkeypatch.undo()
    sources.entry_points.cache_clear()


_GLIDER_LIMITS = ("limits.climb", "limits.speed_min_m_s = 14\nlimits.speed_max_m_s = 39\nlimits.climb")


def test_an_airframe_by_entry_point(offering):
    mine = built()
    offering(_EntryPoint(mine))
    assert "glider" in aircraft_types()
    assert load_airframe("glider") is mine
    scenario = loads(fleet('type = "glider"', limits=_GLIDER_LIMITS))
    assert scenario.aircraft[0].type == "glider"
    with pytest.raises(ScenarioError, match="anser knows no coefficients to vary"):
        loads(fleet('type = "glider"\ndeviation.mass = 1.1'))


def test_the_hash_depends_on_the_code_of_an_entry_point(offering):
    """Another package version or another object of the package changes the hash of the same text."""
    text, hashes = fleet('type = "glider"', limits=_GLIDER_LIMITS), []
    for version, value in (("1.0", "my_package:glider"), ("1.1", "my_package:glider"), ("1.0", "my_package:kite")):
        point = _EntryPoint(version=version)
        point.value = value
        offering(point)
        hashes.append(loads(text).hash)
        assert loads(text + "\n# a comment\n").hash == hashes[-1]
    assert len(set(hashes)) == 3
    offering(_EntryPoint(version="1.0"))
    assert loads(text).hash == hashes[0]


def test_the_hash_of_the_library_s_own_does_not_depend_on_what_is_installed(offering):
    text = fleet('type = "aerosonde"')
    offering()
    original_hash = loads(text).hash
    offering(_EntryPoint(version="1.0"))
    assert loads(text).hash == original_hash
