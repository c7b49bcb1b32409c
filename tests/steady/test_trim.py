"""Trim of any airframe: steady, coordinated, differentiable (the printed figures stand in `test_trim_published.py`)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from anser.aircraft_files import load_airframe
from anser.environment import standard_environment
from anser.spatial import euler_from_quaternion, rotation_from_quaternion
from anser.steady import TrimTarget, nearest_trims, solve_trim, trim_target
from anser.units import DEG_RAD, RAD_DEG
from support.light_aircraft import light_aircraft
from support.other_surfaces import four_elevator_aircraft
from support.states import condition_of, derivative
from support.trims import flight_angles, fly, glider, target_deg, trim

STILL = standard_environment()
AIRFRAMES = {variant: load_airframe("f16", variant) for variant in ("textbook", "s119", "founding")}
AIRFRAMES["light"] = light_aircraft()
F16 = AIRFRAMES["textbook"]


@jax.jit
def _moving_angles(environment, state, rate):
    return jax.jvp(lambda s: flight_angles(environment, s), (state,), (rate,))[1]


_moving_euler = jax.jit(lambda q, q_dot: jax.jvp(euler_from_quaternion, (q,), (q_dot,)))
_angles_along = jax.jit(jax.vmap(flight_angles, in_axes=(None, 0)))


def _rates(airframe, environment, point):
    """Rates of V, alpha, beta, mu, gamma, chi and of (P, Q, R), power, by the equations of motion."""
    rate = derivative(airframe, environment, 0.0, point.state, point.controls)
    return np.asarray(_moving_angles(environment, point.state, rate)), np.asarray(rate.rates_b), float(rate.power)


def test_surfaces_without_roll_and_yaw_moment_trim_straight_flight():
    point = trim(four_elevator_aircraft(), STILL, target_deg(60.0, 800.0, 0.0, 40.0, 0.0))
    assert point.converged
    np.testing.assert_allclose(point.state.surfaces, point.state.surfaces[0], rtol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", AIRFRAMES)
@pytest.mark.parametrize(("path_deg", "turn_deg_s"), [(0.0, 0.0), (3.0, -4.0), (-2.0, 5.0)])
def test_every_airframe_is_steady_in_its_trim(name, path_deg, turn_deg_s):
    airframe = AIRFRAMES[name]
    point = trim(airframe, STILL, target_deg(60.0 if name == "light" else 170.0, 800.0, path_deg, 40.0, turn_deg_s))
    assert point.converged
    assert float(point.excess) == 0.0
    angles, rotation, power = _rates(airframe, STILL, point)
    # The solver stops below 1e-12 g and rad/s^2; the chain rule adds rounding of 1e-13.
    np.testing.assert_allclose(angles[:5], 0.0, atol=3e-11)
    assert angles[5] == pytest.approx(turn_deg_s * DEG_RAD, abs=1e-12)
    np.testing.assert_allclose(rotation, 0.0, atol=1e-11)
    # The gearing's jump of 0.0012 percent times 5 1/s is the most that the throttle can miss.
    assert abs(power) < 0.006
    V, alpha, beta, mu, gamma, chi = flight_angles(STILL, point.state)
    path = [60.0 if name == "light" else 170.0, path_deg * DEG_RAD, 40 * DEG_RAD]
    np.testing.assert_allclose([V, gamma, chi], path, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose([alpha, beta, mu], [point.alpha, point.beta, point.mu], atol=1e-14)
    side_force = condition_of(airframe, STILL, 0.0, point.state).wrench.force_b[1]
    assert abs(float(side_force)) < 1e-11 * 9.8 * float(airframe.mass_properties.mass)


@pytest.mark.parametrize("turn_deg_s", [0.0, -4.0])
def test_pull_up_is_steady_but_for_its_path_angle(turn_deg_s):
    """Speed, flow angles and bank stand still for an instant; path angle and course turn as asked, in any direction."""
    target = trim_target(170.0, 800.0, 3 * DEG_RAD, 40 * DEG_RAD, turn_deg_s * DEG_RAD, 5 * DEG_RAD)
    point = trim(F16, STILL, target)
    assert point.converged
    assert float(point.excess) == 0.0
    angles, rotation, _ = _rates(F16, STILL, point)
    expected = np.array([0.0, 0.0, 0.0, 0.0, 5.0, turn_deg_s]) * DEG_RAD
    np.testing.assert_allclose(angles, expected, atol=3e-11)
    np.testing.assert_allclose(rotation, 0.0, atol=1e-11)
    # Forces normal to the path: V gamma_dot + g cos gamma, and V cos gamma chi_dot beside it.
    up = 170.0 * 5 * DEG_RAD + 9.80665 * np.cos(3 * DEG_RAD)
    side = 170.0 * np.cos(3 * DEG_RAD) * turn_deg_s * DEG_RAD
    weight = 9.80665 * float(F16.mass_properties.mass)
    lift = -float(condition_of(F16, STILL, 0.0, point.state).wrench.force_b[2]) / weight
    # n_z is along body -z, alpha (4 deg) away from the normal of the path: thrust less drag have a part in that, 2 %.
    assert lift == pytest.approx(np.hypot(up, side) / 9.80665, rel=0.02)


@pytest.mark.parametrize("name", AIRFRAMES)
@pytest.mark.parametrize("pitch_deg_s", [4.0, -2.0])
def test_pull_up_by_pitch_rate_has_no_other_rate_and_no_bank(name, pitch_deg_s):
    """[SL] section 3.6: P = R = 0, Q given; speed, flow angles, bank and heading stand still for an instant."""
    speed = 60.0 if name == "light" else 170.0
    point = trim(
        AIRFRAMES[name], STILL, trim_target(speed, 800.0, -1 * DEG_RAD, 40 * DEG_RAD, 0, 0, pitch_deg_s * DEG_RAD)
    )
    assert point.converged
    assert float(point.excess) == 0.0
    np.testing.assert_array_equal(point.state.rates_b, [0.0, pitch_deg_s * DEG_RAD, 0.0])
    angles, rotation, _ = _rates(AIRFRAMES[name], STILL, point)
    np.testing.assert_allclose(angles[:3], 0.0, atol=3e-11)
    # The path bends by Q; the sideslip of the turning engine, 2e-5 rad, takes the rest to the course.
    assert angles[4] == pytest.approx(pitch_deg_s * DEG_RAD, abs=1e-8)
    np.testing.assert_allclose(rotation, 0.0, atol=1e-11)
    rate = derivative(AIRFRAMES[name], STILL, 0.0, point.state, point.controls)
    (roll, _, _), euler_rates = _moving_euler(point.state.quaternion, rate.quaternion)
    assert abs(float(roll)) < 1e-12
    np.testing.assert_allclose(euler_rates, [0.0, pitch_deg_s * DEG_RAD, 0.0], atol=1e-12)


def test_the_two_pull_ups_agree_without_sideslip():
    """The light aircraft has no spinning parts: turning the velocity about the level line is then a pitch rate."""
    by_path, by_pitch = (
        trim(AIRFRAMES["light"], STILL, trim_target(60.0, 800.0, **{rate: 4 * DEG_RAD}))
        for rate in ("path_rate", "pitch_rate")
    )
    for a, b in zip(jax.tree.leaves(by_path.state), jax.tree.leaves(by_pitch.state), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.long
def test_a_pitch_rate_in_a_turn_is_refused_and_marked_where_it_is_traced():
    for second_rate in ("turn_rate", "path_rate"):
        with pytest.raises(
            ValueError, match=rf"pitch_rate: arrived 0.1 rad/s with .*{second_rate} 0.2.*expected a pitch rate"
        ):
            trim_target(170.0, 800.0, pitch_rate=0.1, **{second_rate: 0.2})
        target = eqx.tree_at(
            lambda t, o=second_rate: getattr(t, o), trim_target(170.0, 800.0, pitch_rate=0.1), jnp.array(0.2)
        )
        point = trim(F16, STILL, target)
        assert not point.converged
        assert float(point.residual) == np.inf
        assert nearest_trims(F16, STILL, target).violations == (
            "a pitch rate (P = R = 0) together with a turn rate or a rate of the path angle defines no flight",
        )


def test_a_target_of_six_fields_has_no_pitch_rate():
    zero = jnp.zeros(3)
    target = TrimTarget(zero + 150.0, zero + 1000.0, zero, zero, zero, zero, zero)
    np.testing.assert_array_equal(target.pitch_rate, zero)


TARGETS = st.tuples(st.floats(80, 250), st.floats(0, 9000), st.floats(-8, 8), st.floats(-180, 180), st.floats(-8, 8))


@settings(deadline=None, max_examples=30)
@given(numbers=TARGETS)
@example(numbers=(200.0, 3000.0, 0.0, 30.0, 6.0))
@example(numbers=(150.0, 1500.0, 5.0, -170.0, -3.0))
def test_trimmed_flight_with_held_controls_stays_steady(numbers):
    speed, _, path_deg, course_deg, turn_deg_s = numbers
    point = trim(F16, STILL, target_deg(*numbers))
    if not bool(point.converged) or float(point.excess) > 0.0:
        # Nothing to fly: about half of these targets ask for more or less than the engine or the wing gives.
        assert float(point.excess) > 0.0 or float(point.residual) > 1e-8
        return
    path = fly(F16, STILL, point.state, point.controls, 0.01, 50)
    V, _, _, _, gamma, chi = np.asarray(_angles_along(STILL, path)).T
    # Level flight is steady but for rounding and the throttle's gap (0.006 percent/s of power, 0.1 N/s). A climb
    # leaves its air: over 5 s, 9 km being the scale height, the forces change by the load factor times climbed / 9 km.
    climbed = 5.0 * speed * abs(np.sin(path_deg * DEG_RAD))
    load = np.hypot(1.0, speed * turn_deg_s * DEG_RAD / 9.8)
    drift = 1e-4 + 2 * load * 9.8 * 5.0 * climbed / 9000.0
    np.testing.assert_allclose(V, speed, atol=drift)
    np.testing.assert_allclose(gamma, path_deg * DEG_RAD, atol=drift / speed)
    course_change = np.unwrap(np.concatenate([[course_deg * DEG_RAD], chi])) - course_deg * DEG_RAD
    expected = turn_deg_s * DEG_RAD * np.linspace(0.0, 5.0, 11)
    np.testing.assert_allclose(np.unwrap(course_change), expected, atol=3 * drift / speed)


def test_straight_flight_is_symmetric():
    point = trim(F16, STILL, target_deg(150.0, 1000.0, 4.0))
    np.testing.assert_allclose([point.beta, point.mu, *point.state.surfaces[1:], *point.state.rates_b], 0.0, atol=1e-13)


def test_turn_is_banked_as_coordination_asks():
    # tan(mu) = V chi_dot / g for forces in the plane of symmetry and thrust along the velocity; alpha of 5 deg and
    # thrust of a fifth of the weight make it 1 deg less.
    right_turn, left_turn = (trim(F16, STILL, target_deg(200.0, 2000.0, 0.0, 0.0, rate)) for rate in (5.0, -5.0))
    expected = np.arctan(200.0 * 5.0 * DEG_RAD / 9.80665) * RAD_DEG
    assert float(right_turn.mu) * RAD_DEG == pytest.approx(expected, abs=1.0)
    # The spinning engine alone tells left from right.
    assert float(left_turn.mu) * RAD_DEG == pytest.approx(-expected, abs=1.0)
    assert float(left_turn.state.surfaces[0]) != float(right_turn.state.surfaces[0])


def test_wind_moves_the_ground_velocity_only():
    wind_n = jnp.array([12.0, -20.0, 1.0])
    still = trim(F16, STILL, target_deg(150.0, 1000.0, 2.0, 60.0, 3.0))
    windy = trim(F16, standard_environment(wind_n=wind_n), target_deg(150.0, 1000.0, 2.0, 60.0, 3.0))
    np.testing.assert_array_equal(windy.state.quaternion, still.state.quaternion)
    np.testing.assert_array_equal(windy.controls.surfaces, still.controls.surfaces)
    R_bn = rotation_from_quaternion(still.state.quaternion)
    np.testing.assert_allclose(windy.state.velocity_b, still.state.velocity_b + R_bn @ wind_n, atol=1e-12)
    angles, *_ = _rates(F16, standard_environment(wind_n=wind_n), windy)
    np.testing.assert_allclose(angles[:5], 0.0, atol=3e-11)


def test_least_angle_of_attack_is_chosen():
    # Lift, drag and thrust balance on both sides of the stall; the front side is meant.
    for speed in (70.0, 100.0, 150.0):
        point = trim(F16, STILL, target_deg(speed))
        assert float(point.alpha) * RAD_DEG < 20.0


def test_limits_are_reported_not_imposed():
    point = trim(F16, STILL, target_deg(200.0, 1000.0, 80.0))
    assert point.converged
    assert float(point.power) > 100.0
    assert float(point.excess) == pytest.approx(float(point.power) / 100 - 1, abs=1e-12)
    assert float(point.controls.throttle) == 1.0


def test_impossible_balance_is_reported():
    # Without thrust the drag of level flight, at least a fifteenth of the weight, stays.
    point = trim(glider(F16), STILL, target_deg(150.0))
    assert not point.converged
    assert float(point.residual) > 0.01
    assert trim(F16, STILL, target_deg(150.0)).converged


@pytest.mark.long
def test_vmap_over_a_mixed_fleet_equals_one_at_a_time_and_compiles_once():
    traced_once = jax.jit(eqx.debug.assert_max_traces(jax.vmap(solve_trim, in_axes=(0, None, 0)), max_traces=1))
    for names, speeds in ((("textbook", "founding"), (90.0, 160.0)), (("founding", "s119"), (230.0, 120.0))):
        fleet = jax.tree.map(lambda *x: jnp.stack(x), *(AIRFRAMES[name] for name in names))
        targets = jax.tree.map(lambda *x: jnp.stack(x), *(target_deg(V, 2000.0, 1.0, 0.0, 2.0) for V in speeds))
        batch = traced_once(fleet, STILL, targets)
        for k, (name, V) in enumerate(zip(names, speeds, strict=True)):
            single = trim(AIRFRAMES[name], STILL, target_deg(V, 2000.0, 1.0, 0.0, 2.0))
            assert batch.converged[k]
            for a, b in zip(jax.tree.leaves(batch), jax.tree.leaves(single), strict=True):
                np.testing.assert_allclose(np.asarray(a[k], float), np.asarray(b, float), atol=1e-9)


def _summary(arguments):
    airframe, environment, target = arguments
    point = solve_trim(airframe, environment, target)
    return jnp.stack([point.alpha, point.mu, point.state.surfaces[0], point.power / 100])


@pytest.fixture(scope="module")
def sensitivity():
    return eqx.filter_jit(lambda arguments, weights: eqx.filter_grad(lambda a: _summary(a) @ weights)(arguments))


def _differenced(selector, arguments, h):
    def at(value):
        airframe, environment, target = eqx.tree_at(selector, arguments, value)
        point = trim(airframe, environment, target)
        return np.array([point.alpha, point.mu, point.state.surfaces[0], point.power / 100])

    value = selector(arguments)
    return (at(value + h) - at(value - h)) / (2 * h)


@pytest.mark.long
def test_gradient_equals_difference_quotient(sensitivity):
    arguments = (F16, STILL, target_deg(163.0, 1700.0, 2.0, 10.0, 3.0))
    selectors = {
        "speed": (lambda a: a[2].speed, 1e-3),
        "altitude": (lambda a: a[2].altitude, 1e-1),
        "turn rate": (lambda a: a[2].turn_rate, 1e-5),
        "mass": (lambda a: a[0].mass_properties.mass, 1e-1),
        "centre of gravity": (lambda a: a[0].x_cg, 1e-5),
        "gravity": (lambda a: a[1].earth.gravity, 1e-4),
    }
    differenced = {name: _differenced(selector, arguments, h) for name, (selector, h) in selectors.items()}
    for k in range(4):
        gradient = sensitivity(arguments, jnp.eye(4)[k])
        for name, (selector, h) in selectors.items():
            # Solver noise of 1e-13 over the step, and the curvature times its square.
            assert float(selector(gradient)) == pytest.approx(differenced[name][k], rel=1e-5, abs=1e-12 / h), name


@pytest.mark.long
def test_gradient_in_a_pull_up_equals_difference_quotient(sensitivity):
    arguments = (F16, STILL, trim_target(163.0, 1700.0, 2 * DEG_RAD, pitch_rate=0.08))
    selectors = {"pitch rate": (lambda a: a[2].pitch_rate, 1e-5), "centre of gravity": (lambda a: a[0].x_cg, 1e-5)}
    for name, (selector, h) in selectors.items():
        differenced = _differenced(selector, arguments, h)
        for k in (0, 2, 3):  # alpha, elevator, power; the wings stay level
            gradient = float(selector(sensitivity(arguments, jnp.eye(4)[k])))
            assert gradient == pytest.approx(differenced[k], rel=1e-5, abs=1e-12 / h), name


@pytest.mark.long
@pytest.mark.parametrize("airframe", [F16, glider(F16)], ids=["symmetric", "no solution"])
def test_gradient_is_finite_in_symmetric_flight_and_without_a_solution(sensitivity, airframe):
    gradient = sensitivity((airframe, STILL, target_deg(150.0)), jnp.ones(4))
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
