"""Guidance: planned velocity with position feedback, and the hold around a moving goal."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from anser.control import GuidanceSettings
from anser.control.guidance import follow, hold, hold_point
from anser.planning.published.trajectory import fit_trajectory
from support.control_cases import QUICK, vectors

modest = settings(deadline=None, max_examples=30)
SPEED, RADIUS, HEIGHT = 150.0, 4000.0, 300.0


def settings_of(gain=0.3, correction_max=20.0, turn=1.0, climb=10.0):
    return GuidanceSettings(*(jnp.asarray(v, float) for v in (gain, correction_max, RADIUS, turn, climb)))


def cartesian(V, gamma, chi):
    return np.array([V * np.cos(gamma) * np.cos(chi), V * np.cos(gamma) * np.sin(chi), -V * np.sin(gamma)])


# --- following a trajectory


def _plan(wind_n):
    return fit_trajectory(
        5.0,
        40.0,
        jnp.array([0.0, 0.0, -1000.0]),
        jnp.array([150.0, 0.0, 0.0]),
        jnp.array([5000.0, 2000.0, -1500.0]),
        jnp.array([75.0, 130.0, 0.0]),
        lateral_bend=1500.0,
        wind_n=wind_n,
    )


@jax.jit
def followed(time, offset_n, slip_n, wind_n, gain):
    """Command to an aircraft with a position and a velocity error."""
    plan = _plan(wind_n)
    position_n, velocity_n = plan.position_n(time) - offset_n, plan.velocity_n(time) - slip_n
    return follow(plan.at(time), position_n, velocity_n, wind_n, settings_of(gain)), plan.velocity_n(time)


@jax.jit
def followed_later(time, later, offset_n, slip_n, wind_n):
    """Command to the same aircraft a moment later, with the same velocity."""
    plan = _plan(wind_n)
    velocity_n = plan.velocity_n(time) - slip_n
    position_n = plan.position_n(time) - offset_n + later * velocity_n
    return follow(plan.at(time + later), position_n, velocity_n, wind_n, settings_of())


times = st.floats(6.0, 44.0)
winds = vectors((-20.0, 20.0), (-20.0, 20.0), (-3.0, 3.0))
offsets = vectors(*((-200.0, 200.0),) * 3)
slips = vectors(*((-10.0, 10.0),) * 3)


@modest
@given(times, offsets, slips, winds)
def test_the_command_without_gain_is_the_planned_velocity_through_the_air(time, offset_n, slip_n, wind_n):
    command, planned_n = followed(time, offset_n, slip_n, wind_n, 0.0)
    np.testing.assert_allclose(cartesian(command.V, command.gamma, command.chi), planned_n - wind_n, atol=1e-10)


@modest
@given(times, offsets, slips, winds)
def test_correction_points_to_the_plan_and_is_limited(time, offset_n, slip_n, wind_n):
    command, planned_n = followed(time, offset_n, slip_n, wind_n, 0.3)
    added_n = cartesian(command.V, command.gamma, command.chi) - (planned_n - wind_n)
    correction = 0.3 * np.linalg.norm(offset_n)
    assert np.linalg.norm(added_n) <= min(20.0, correction) + 1e-9
    # k d / sqrt(1 + (k d / max)^2), along the error
    np.testing.assert_allclose(added_n, 0.3 * offset_n / np.sqrt(1 + (correction / 20.0) ** 2), atol=1e-9)


@modest
@given(times, offsets, slips, winds)
def test_rates_of_the_command_agree_with_differences(time, offset_n, slip_n, wind_n):
    command = followed_later(time, 0.0, offset_n, slip_n, wind_n)
    earlier, later_command = (followed_later(time, h, offset_n, slip_n, wind_n) for h in (-1e-3, 1e-3))
    for name in ("V", "gamma", "chi"):
        difference = (float(getattr(later_command, name)) - float(getattr(earlier, name))) / 2e-3
        # central differences: h^2 / 6 times third derivatives of order 1, and 1e-13 of rounding over h
        assert getattr(command, f"{name}_dot") == pytest.approx(difference, abs=2e-6), name


# --- the hold


@jax.jit
def held(relative_n, velocity_n, goal_velocity_n, wind_n, arrival_n, turn):
    return hold(relative_n, velocity_n, goal_velocity_n, wind_n, arrival_n, HEIGHT, SPEED, settings_of(turn=turn))


courses = st.floats(-3.1, 3.1)
drifts = vectors((-25.0, 25.0), (-25.0, 25.0), (0.0, 0.0))


@modest
@given(courses, st.floats(-0.5, 0.0), drifts, winds, st.sampled_from([1.0, -1.0]))
def test_the_path_through_the_goal_is_straight(course, gamma, goal_velocity_n, wind_n, turn):
    """At the goal, the relative motion points in the arrival direction, without turning."""
    arrival_n = cartesian(120.0, gamma, course)
    above_n = np.array([0.0, 0.0, -HEIGHT])
    level_n = arrival_n * [1.0, 1.0, 0.0] + goal_velocity_n
    command = held(above_n, level_n, goal_velocity_n, wind_n, arrival_n, turn)
    relative_n = cartesian(command.V, command.gamma, command.chi) + wind_n - goal_velocity_n
    assert np.arctan2(relative_n[1], relative_n[0]) == pytest.approx(course, abs=1e-9)
    assert relative_n[2] == pytest.approx(0.0, abs=1e-9)
    assert command.chi_dot == pytest.approx(0.0, abs=1e-12)
    air = np.hypot(*(relative_n + goal_velocity_n - wind_n)[:2])
    assert air == pytest.approx(SPEED)


@modest
@given(
    vectors((-9000.0, 9000.0), (-9000.0, 9000.0), (-1500.0, 500.0)),
    courses,
    drifts,
    winds,
    st.sampled_from([1.0, -1.0]),
)
@example(
    np.array([69.0, 0.0, 0.0]), 1.045441162201652, np.array([-11.5, -11.75, 0.0]), np.array([-11.5, -11.75, 0.0]), 1.0
)
def test_rates_of_the_hold_agree_with_differences(relative_n, course, goal_velocity_n, wind_n, turn):
    distance = np.hypot(*relative_n[:2])
    # away from the kinks: the smoothstep's end at a tenth of the radius, the radius
    if distance < 420.0 or abs(distance - RADIUS) < 1.0:
        relative_n = relative_n + np.array([1000.0, 0.0, 0.0])
    velocity_n = cartesian(150.0, 0.0, course)
    moving_n = velocity_n - goal_velocity_n
    commands = [
        held(relative_n + h * moving_n, velocity_n, goal_velocity_n, wind_n, velocity_n, turn) for h in (-1e-3, 0, 1e-3)
    ]
    values = np.array([jax.tree.leaves(command)[:3] for command in commands])
    values[:, 2] = np.unwrap(values[:, 2])
    # Where the limit of the course change begins, the rate is that of one side.
    before, after = np.diff(values, axis=0) / 1e-3
    rates = np.array(jax.tree.leaves(commands[1])[3:])
    # second differences of the field over 0.15 m; rounding 1e-13 over h
    assert np.all(rates >= np.minimum(before, after) - 3e-5)
    assert np.all(rates <= np.maximum(before, after) + 3e-5)


def _fly(relative_0_n, goal_velocity_n, wind_n, arrival_n, turn, count, step):
    """Fly the commanded velocity as a point; rows of position relative to the goal, and command."""

    def velocity_of(relative_n, velocity_n):
        command = held(relative_n, velocity_n, goal_velocity_n, wind_n, arrival_n, turn)
        level = command.V * jnp.cos(command.gamma)
        air_n = jnp.stack(
            [level * jnp.cos(command.chi), level * jnp.sin(command.chi), -command.V * jnp.sin(command.gamma)]
        )
        return air_n + wind_n, command

    def one(carry, _):
        relative_n, velocity_n = carry
        halfway_n = relative_n + 0.5 * step * (velocity_of(relative_n, velocity_n)[0] - goal_velocity_n)
        after_n, command = velocity_of(halfway_n, velocity_n)
        return (relative_n + step * (after_n - goal_velocity_n), after_n), (relative_n, command)

    start_n = arrival_n / jnp.sqrt(jnp.sum(arrival_n**2)) * SPEED
    return jax.lax.scan(one, (relative_0_n, start_n), length=count)[1]


ZERO = np.zeros(3)
LEVEL_N = np.array([150.0, 0.0, 0.0])
CASES = {
    "from above the goal, right": ([0, 0, -HEIGHT], ZERO, ZERO, LEVEL_N, 1),
    "from above the goal, left": ([0, 0, -HEIGHT], ZERO, ZERO, LEVEL_N, -1),
    "steeply, to the east": ([0, 0, -HEIGHT], [20, 10, 0], [0, 15, 0], [0, 130, 75], 1),
    "from outside and above": ([9000, -3000, -900], [0, 0, 0], [10, -5, 0], [0, 150, 0], 1),
    "from outside and below": ([-7000, 2000, -100], [15, -20, 0], [0, 0, 0], [-150, 0, 0], -1),
    "fast goal against the wind": ([1000, 500, -300], [30, 30, 0], [-20, -10, 0], [100, 100, 0], -1),
    "rising wind": ([500, -2500, -400], [0, 0, 0], [5, 5, -3], [100, 100, 0], 1),
    "past the goal by 30 m": ([10, 30, -HEIGHT], [0, 25, 0], [0, 0, 0], [150, 0, 0], 1),
}


@pytest.fixture(scope="module")
def held_flights():
    """The cases in one compiled batch: 300 s each."""
    columns = [jnp.asarray(np.array(column, dtype=float)) for column in zip(*CASES.values(), strict=True)]
    flown = jax.jit(jax.vmap(lambda *case: _fly(*case, 6000, 0.05)))(*columns)
    return {name: jax.tree.map(lambda leaf, k=k: np.asarray(leaf[k]), flown) for k, name in enumerate(CASES)}


@pytest.mark.parametrize("name", CASES)
def test_the_hold_ends_on_the_circle_at_its_height_in_its_sense(held_flights, name):
    relative_n, command = held_flights[name]
    turn = CASES[name][4]
    final_part = slice(-1000, None)
    distance = np.hypot(relative_n[final_part, 0], relative_n[final_part, 1])
    # the field's attraction, 1.5 V / R = 0.056 1/s, has faded to exp(-14); midpoint steps of 7.5 m are exact to 1e-5
    np.testing.assert_allclose(distance, RADIUS, rtol=1e-3)
    np.testing.assert_allclose(relative_n[final_part, 2], -HEIGHT, atol=0.5)
    north, east = relative_n[final_part, 0], relative_n[final_part, 1]
    sense = north[:-1] * east[1:] - east[:-1] * north[1:]  # positive: clockwise seen from above
    assert np.all(turn * sense > 0)
    # the given speed is that over the level; a climb comes on top of it
    level = command.V * np.cos(command.gamma)
    np.testing.assert_allclose(level, SPEED, rtol=1e-9)


def test_heights_are_reached_within_the_climb_limit(held_flights):
    relative_n, command = held_flights["from outside and above"]
    climb = command.V * np.sin(command.gamma)
    assert np.abs(climb).max() <= 10.0 + 1e-9
    assert relative_n[0, 2] == -900.0


def test_levelling_off_after_a_steep_arrival_is_gradual(held_flights):
    """The commanded path angle differs by at most (6 m/s^2)(1 s)/V from the present angle: dives end gradually."""
    _, command = held_flights["steeply, to the east"]
    air_n = SPEED * np.array([0.0, 130.0, 75.0]) / np.hypot(130, 75) - np.array([0.0, 15.0, 0.0])
    airspeed = np.linalg.norm(air_n)
    assert command.gamma[0] == pytest.approx(-np.arcsin(air_n[2] / airspeed) + 6.0 / airspeed, abs=1e-9)
    assert np.all(np.diff(command.gamma) <= 6.0 / airspeed + 1e-9)


def test_a_fast_arrival_does_not_descend_more_steeply():
    """The vertical speed of the hold must not be converted to a path angle at the speed of the hold, 150 of 200 m/s."""
    velocity_n = cartesian(200.0, np.radians(-9.0), 0.6)
    command = held(np.array([0.0, 0.0, -HEIGHT]), velocity_n, ZERO, ZERO, velocity_n, 1)
    # before: -9.6 deg
    assert command.gamma == pytest.approx(np.radians(-9.0) + 6.0 / 200.0, abs=1e-9)


@pytest.mark.parametrize("name", ["from above the goal, right", "from above the goal, left"])
def test_the_curvature_inside_the_circle_is_bounded(held_flights, name):
    """As documented in `hold`: below 3 / radius, zero at the start, so that the arrival is straight."""
    relative_n, command = held_flights[name]
    curvature = np.abs(command.chi_dot) / SPEED * RADIUS
    assert curvature.max() < 3.0
    assert curvature.max() > 1.0
    distance = np.hypot(relative_n[:, 0], relative_n[:, 1])
    # straight at first: the deflection grows with the square of the distance
    assert curvature[distance < 0.02 * RADIUS].max() < 0.3


def test_course_of_the_flown_hold_changes_at_the_commanded_rate(held_flights):
    _, command = held_flights["from above the goal, right"]
    chi = np.unwrap(command.chi)
    middle = slice(20, 3000)
    flown = np.gradient(chi, 0.05)[middle]
    # the command is one half step late against its differences and the field's second derivative has kinks
    np.testing.assert_allclose(flown, command.chi_dot[middle], atol=2e-3)


@jax.jit
def _hold_numbers(relative_n, goal_velocity_n, arrival_n):
    velocity_n = jnp.array([100.0, -50.0, 5.0])
    return jnp.stack(jax.tree.leaves(held(relative_n, velocity_n, goal_velocity_n, jnp.zeros(3), arrival_n, 1.0)))


_hold_slopes = jax.jit(jax.jacrev(_hold_numbers, argnums=(0, 1, 2)), compiler_options=QUICK)


@pytest.mark.long
@pytest.mark.parametrize(
    ("relative_n", "goal_velocity_n", "arrival_n"),
    [
        (ZERO, ZERO, LEVEL_N),
        (ZERO, ZERO, ZERO),
        ([0, 0, -300], ZERO, [0, 0, 150]),
        ([RADIUS, 0, -300], ZERO, LEVEL_N),
        ([-0.05 * RADIUS, 0, -300], ZERO, LEVEL_N),
        ([1000, 0, 0], [200, 0, 0], LEVEL_N),
        ([0, 0, -300], [-150, 0, 0], LEVEL_N),
    ],
    ids=["centre", "no arrival direction", "vertical arrival", "on the circle", "behind", "fast goal", "at rest"],
)
def test_values_and_gradients_are_finite(relative_n, goal_velocity_n, arrival_n):
    arguments = [np.array(v, dtype=float) for v in (relative_n, goal_velocity_n, arrival_n)]
    assert np.isfinite(_hold_numbers(*arguments)).all()
    for slope in _hold_slopes(*arguments):
        assert np.isfinite(slope).all()


@pytest.mark.long
def test_the_command_has_finite_gradients_on_the_plan():
    """Zero position and velocity errors, as at the start of every flight."""

    def numbers(time, offset_n, wind_n):
        return jnp.stack(jax.tree.leaves(followed(time, offset_n, jnp.zeros(3), wind_n, 0.3)[0]))

    slopes_of = jax.jit(jax.jacrev(numbers, argnums=(0, 1, 2)), compiler_options=QUICK)
    for slope in slopes_of(20.0, jnp.zeros(3), jnp.zeros(3)):
        assert np.isfinite(slope).all()


_hold_point = jax.jit(lambda relative_n, goal_n: hold_point(relative_n, goal_n, HEIGHT, settings_of()))


@modest
@given(vectors((-9000.0, 9000.0), (-9000.0, 9000.0), (-1500.0, 0.0)), vectors(*((-5000.0, 5000.0),) * 3))
def test_the_hold_point_is_the_nearest_point_of_the_circle(relative_n, goal_n):
    point_n = np.asarray(_hold_point(relative_n, goal_n)) - goal_n
    assume(np.hypot(*relative_n[:2]) >= 1.0)
    assert np.hypot(*point_n[:2]) == pytest.approx(RADIUS)
    assert point_n[2] == pytest.approx(-HEIGHT)
    angles = np.linspace(0, 2 * np.pi, 721)
    circle = np.stack([RADIUS * np.cos(angles), RADIUS * np.sin(angles)])
    nearest = np.hypot(*(circle - relative_n[:2, None])).min()
    assert np.hypot(*(point_n - relative_n)[:2]) <= nearest + 1e-9


@pytest.mark.long
def test_a_batch_equals_single_commands():
    batch = jnp.array([[100.0, 50.0, -300.0], [5000.0, -900.0, -200.0]])
    batched = jax.jit(jax.vmap(_hold_numbers, in_axes=(0, None, None)), compiler_options=QUICK)
    together = batched(batch, jnp.zeros(3), jnp.asarray(LEVEL_N))
    for relative_n, batch_row in zip(batch, together, strict=True):
        np.testing.assert_allclose(batch_row, _hold_numbers(relative_n, jnp.zeros(3), LEVEL_N), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_an_arrival_towards_the_goal_turns_in_the_direction_of_the_hold(turn):
    """700 m before the goal and flying towards it, the field points back: both sides turn as the hold does."""
    velocity_n, compiled, turning = jnp.array([160.0, 0.0, 0.0]), jax.jit(hold), settings_of(turn=turn)
    for aside in (-30.0, 0.0, 30.0):
        relative_n = jnp.array([-700.0, aside, -300.0])
        command = compiled(relative_n, velocity_n, jnp.zeros(3), jnp.zeros(3), velocity_n, 300.0, 160.0, turning)
        np.testing.assert_allclose(command.chi, turn * np.pi / 4, atol=1e-12)
        assert float(command.chi_dot) == 0.0
