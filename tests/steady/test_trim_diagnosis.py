"""Reasons for a refused steady flight, and the nearest possible conditions."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft_files import load_airframe
from anser.environment import standard_environment
from anser.steady import nearest_trims, trim_diagnosis, trim_target, trim_violations
from anser.units import DEG_RAD, RAD_DEG
from support.light_aircraft import light_aircraft
from support.trims import glider, target_deg, trim

pytestmark = pytest.mark.long


STILL = standard_environment()
F16, LIGHT = load_airframe(), light_aircraft()
TOO_SLOW = target_deg(40.0)
TOO_STEEP = target_deg(150.0, 9000.0, 30.0)
TOO_TIGHT = target_deg(150.0, 1000.0, 0.0, 20.0, 25.0)
DIVE = target_deg(150.0, 1000.0, -40.0)
IMPOSSIBLE = target_deg(100.0, 16000.0)
NORMAL = target_deg(150.0)


@pytest.fixture(scope="module")
def diagnoses():
    """Diagnosis of each target for the F-16."""
    targets = {
        "slow": TOO_SLOW,
        "steep": TOO_STEEP,
        "tight": TOO_TIGHT,
        "dive": DIVE,
        "impossible": IMPOSSIBLE,
        "normal": NORMAL,
    }
    return {name: nearest_trims(F16, STILL, target) for name, target in targets.items()}


def _along(diagnosis, quantity):
    return next(trim_near for trim_near in diagnosis.nearest if trim_near.quantity == quantity)


def test_a_point_within_all_limits_has_no_violations(diagnoses):
    assert trim_violations(F16, STILL, trim(F16, STILL, NORMAL)) == ()
    assert diagnoses["normal"].violations == ()
    assert diagnoses["normal"].nearest == ()
    assert diagnoses["normal"].message().startswith("Steady flight exists: 150.0 m/s at 1000 m")


def test_each_limit_is_named_with_numbers(diagnoses):
    assert trim_violations(F16, STILL, trim(F16, STILL, TOO_TIGHT)) == diagnoses["tight"].violations
    assert "known from -10 to 45" in diagnoses["slow"].violations[0]
    assert (
        diagnoses["slow"]
        .violations[0]
        .startswith(f"angle of attack: {float(diagnoses['slow'].point.alpha) * RAD_DEG:.1f} deg")
    )
    assert diagnoses["tight"].violations == (
        f"engine power: {float(diagnoses['tight'].point.power):.1f} percent; available 0 to 100",
    )
    assert float(diagnoses["dive"].point.power) < 0
    assert diagnoses["dive"].violations[0].startswith("engine power: -")
    elevator = trim_violations(F16, STILL, trim(F16, STILL, target_deg(10.0, 0.0)))
    assert any(line.startswith("elevator: ") and "moves from -25 to 25" in line for line in elevator)
    assert any(
        "16000 m" in line and "outside the aircraft's data" in line for line in diagnoses["impossible"].violations
    )
    fast = trim_violations(F16, STILL, trim(F16, STILL, target_deg(400.0, 10000.0)))
    assert fast[-1] == "altitude 10000 m, Mach 1.34: outside the aircraft's data"


def test_a_missing_balance_is_reported():
    # Without thrust only the one glide angle of each speed is steady, which no grid hits.
    diagnosis = nearest_trims(glider(F16), STILL, NORMAL)
    (line,) = diagnosis.violations
    assert line.startswith("the forces and moments cannot be balanced: the best attempt leaves 0.")
    assert diagnosis.nearest == ()


@pytest.mark.parametrize("name", ["slow", "steep", "tight", "dive"])
def test_nearest_points_are_trimmable_and_closer_points_are_not(diagnoses, name):
    assert diagnoses[name].nearest
    for nearest in diagnoses[name].nearest:
        assert trim_violations(F16, STILL, trim(F16, STILL, nearest.target)) == ()
        np.testing.assert_allclose(trim(F16, STILL, nearest.target).alpha, nearest.point.alpha, atol=1e-9)
        # The documented resolution of the edge, toward the target.
        step = {"speed": 5e-4 * nearest.value, "path_angle": 0.02 * DEG_RAD, "turn_rate": 0.01 * DEG_RAD}[
            nearest.quantity
        ]
        closer_value = jnp.asarray(nearest.value + np.sign(nearest.target_value - nearest.value) * step)
        target = type(nearest.target)(**{**vars(nearest.target), nearest.quantity: closer_value})
        assert trim_violations(F16, STILL, trim(F16, STILL, target)) != ()


def test_distances_are_sorted_and_as_documented(diagnoses):
    for diagnosis in diagnoses.values():
        distances = [nearest.distance for nearest in diagnosis.nearest]
        assert distances == sorted(distances)
    speed = _along(diagnoses["slow"], "speed")
    assert speed.distance == pytest.approx((speed.value - 40.0) / 40.0, rel=1e-12)
    path = _along(diagnoses["dive"], "path_angle")
    assert path.distance == pytest.approx(path.value + 40 * DEG_RAD, rel=1e-12)
    turn = _along(diagnoses["tight"], "turn_rate")
    assert turn.distance == pytest.approx((25 * DEG_RAD - turn.value) * 150 / 9.80665, rel=1e-12)


def test_messages_are_rounded_towards_the_possible_side(diagnoses):
    speed = _along(diagnoses["slow"], "speed")
    number = float(speed.message().removeprefix("the slowest trimmable speed is ").removesuffix(" m/s"))
    assert speed.value <= number < speed.value + 0.1
    climb = _along(diagnoses["steep"], "path_angle")
    number = float(climb.message().removeprefix("the steepest climb is ").removesuffix(" deg"))
    assert climb.value * RAD_DEG - 0.1 < number <= climb.value * RAD_DEG
    turn = _along(diagnoses["tight"], "turn_rate")
    number = float(turn.message().removeprefix("the fastest turn is ").removesuffix(" deg/s"))
    assert turn.value * RAD_DEG - 0.1 < number <= turn.value * RAD_DEG
    assert _along(diagnoses["tight"], "path_angle").message().startswith("it must descend at ")
    assert _along(diagnoses["dive"], "path_angle").message().startswith("the steepest descent is ")
    assert _along(diagnoses["dive"], "turn_rate").message().startswith("it must turn at ")
    lines = diagnoses["slow"].message().splitlines()
    assert lines[0] == "No steady flight: 40.0 m/s at 1000 m, path angle 0.0 deg, turn rate 0.0 deg/s."
    assert lines[-1] == f"- {diagnoses['slow'].nearest[-1].message()}"


def test_the_nearest_trim_beside_a_gap_is_not_called_the_slowest(monkeypatch):
    def with_slower_trims(airframe, environment, target, position_n, grids):
        points, usable = solve_grids(airframe, environment, target, position_n, grids)
        return points, usable | {"speed": usable["speed"] | (grids["speed"] < 8.0)}

    solve_grids = trim_diagnosis._solve_grids
    monkeypatch.setattr(trim_diagnosis, "_solve_grids", with_slower_trims)
    speed = _along(nearest_trims(F16, STILL, TOO_SLOW), "speed")
    assert speed.value > 40.0
    assert speed.message() == f"the nearest trimmable speed is {np.ceil(speed.value * 10) / 10:.1f} m/s"
    turn = dataclasses.replace(speed, quantity="turn_rate", target_value=-0.1, value=-0.2)
    assert turn.message() == "the nearest trimmable turn rate is -11.5 deg/s"


def test_the_diagnosis_is_that_of_the_position():
    position_n = jnp.array([4000.0, -3000.0, -1000.0])
    diagnosis = nearest_trims(F16, STILL, TOO_SLOW, position_n)
    for point in (diagnosis.point, *(nearest.point for nearest in diagnosis.nearest)):
        np.testing.assert_allclose(point.state.position_n, position_n)


@pytest.mark.parametrize("speed", [0.0, -5.0, float("nan")])
def test_a_diagnosis_needs_an_airspeed(speed):
    with pytest.raises(ValueError, match=f"target.speed: arrived {speed:g} m/s; expected an airspeed above 0 m/s"):
        nearest_trims(F16, STILL, trim_target(speed, 1000.0))


def test_a_diagnosis_without_nearest_trims_reports_that(diagnoses):
    assert diagnoses["impossible"].nearest == ()
    assert (
        diagnoses["impossible"]
        .message()
        .endswith("No change of speed, path angle or turn rate alone makes it possible.")
    )


def test_the_diagnosis_of_a_glider_claims_no_impossibility(diagnoses):
    message = dataclasses.replace(diagnoses["impossible"], is_glider=True).message()
    assert "No change of" not in message
    assert "exists at a single path angle" in message


def test_a_left_turn_stays_a_left_turn():
    right_turn, left_turn = (
        nearest_trims(F16, STILL, target_deg(150.0, 1000.0, 0.0, 0.0, rate)) for rate in (25.0, -25.0)
    )
    # The spinning engine makes left and right differ a little.
    assert _along(left_turn, "turn_rate").value == pytest.approx(
        -_along(right_turn, "turn_rate").value, abs=0.05 * DEG_RAD
    )
    assert _along(left_turn, "turn_rate").message() == _along(right_turn, "turn_rate").message()


def test_a_pull_up_diagnosis_names_the_nearest_pitch_rate():
    diagnosis = nearest_trims(F16, STILL, trim_target(153.0, 0.0, pitch_rate=0.3))
    assert "path angle 0.0 deg, turn rate 0.0 deg/s, pitch rate 17.2 deg/s" in diagnosis.message()
    assert {nearest.quantity for nearest in diagnosis.nearest} == {"speed", "path_angle", "pitch_rate"}
    nearest = _along(diagnosis, "pitch_rate")
    assert nearest.message() == f"the fastest pull-up is {np.floor(nearest.value * RAD_DEG * 10) / 10:.1f} deg/s"
    assert float(nearest.point.power) == pytest.approx(100.0, abs=0.05)
    assert nearest.distance == pytest.approx((0.3 - nearest.value) * 153.0 / 9.80665, rel=1e-12)
    # In this dive idle thrust is too much: the drag of a pull-up takes it up.
    idle_dive = _along(
        nearest_trims(F16, STILL, trim_target(150.0, 1000.0, -12 * DEG_RAD, pitch_rate=0.01)), "pitch_rate"
    )
    assert idle_dive.message().startswith("it must pull up at ")
    # push-overs faster than 17.3 deg/s have a trim: they do not count beside a pull-up
    pull_up = _along(nearest_trims(F16, STILL, trim_target(200.0, 1000.0, pitch_rate=0.302)), "pitch_rate")
    assert pull_up.message() == "the fastest pull-up is 16.6 deg/s"
    push_over = _along(nearest_trims(F16, STILL, trim_target(150.0, 1000.0, pitch_rate=-0.5)), "pitch_rate")
    assert push_over.message().startswith("the fastest push-over is ")


def test_another_airframe_is_diagnosed_too():
    diagnosis = nearest_trims(LIGHT, STILL, target_deg(90.0, 1000.0))
    assert diagnosis.violations == (f"engine power: {float(diagnosis.point.power):.1f} percent; available 0 to 100",)
    speed = _along(diagnosis, "speed")
    assert speed.message().startswith("the fastest trimmable speed is ")
    assert float(speed.point.power) == pytest.approx(100.0, abs=0.1)
