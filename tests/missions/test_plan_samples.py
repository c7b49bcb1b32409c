"""Samples of planned paths against closed forms: turns, climbs, closest approach, moving keep-outs."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.missions.plan_samples import sample_extremes, sample_paths, sample_plan, sample_times, sampled_motion
from anser.planning import TimedPath
from anser.planning.published.trajectory import fit_trajectory
from anser.scenario.schema_airspace import KeepOut

GRAVITY, SPEED, END = 9.81, 150.0, 40.0
RADIUS, WIND = 4000.0, 12.0
KNOTS = np.linspace(0.0, END, 41)


def _timed(air, drift=lambda t: np.zeros((t.size, 3, 3)), end=END):
    times = np.linspace(0.0, end, KNOTS.size)
    return TimedPath(jnp.asarray(times), jnp.asarray(air(times)), jnp.asarray(drift(times)))


def _straight(start, velocity):
    def air(t):
        positions = np.asarray(start) + t[:, None] * np.asarray(velocity)
        return np.stack([positions, np.tile(velocity, (t.size, 1)), np.zeros((t.size, 3))], axis=1)

    return air


def _turn(t):
    """Level right turn from north, radius `RADIUS`."""
    rate = SPEED / RADIUS
    c, s, o = np.cos(rate * t), np.sin(rate * t), 0.0 * t
    positions = np.stack([RADIUS * s, RADIUS * (1.0 - c), o - 1000.0], axis=1)
    return np.stack(
        [positions, SPEED * np.stack([c, s, o], axis=1), SPEED * rate * np.stack([-s, c, o], axis=1)], axis=1
    )


def _blown(t):
    steady = np.array([0.0, WIND, 0.0])
    return np.stack([t[:, None] * steady, np.tile(steady, (t.size, 1)), np.zeros((t.size, 3))], axis=1)


def _stacked(*paths):
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *paths)


# A level turn in a cross wind; a climb to the east; a line that is at its end early.
FLEET = _stacked(
    _timed(_turn, _blown),
    _timed(_straight((0.0, 0.0, -500.0), (0.0, 140.0, -20.0))),
    _timed(_straight((9000.0, -3000.0, -800.0), (-100.0, 0.0, 0.0)), end=30.25),
)
ARRIVALS = np.array([END, END, 30.25])


@pytest.fixture(scope="module")
def sampled():
    times, is_regular = sample_times(0.0, ARRIVALS)
    return times, is_regular, sample_paths(FLEET, ARRIVALS, times, GRAVITY)


def test_sample_times_are_regular_times_and_the_arrivals():
    times, is_regular = sample_times(0.0, ARRIVALS)
    np.testing.assert_array_equal(times[is_regular], 0.5 * np.arange(81))
    np.testing.assert_array_equal(times[~is_regular], [30.25])
    times, is_regular = sample_times(0.0, np.array([2.0 + 1e-9, 1.7]))
    np.testing.assert_array_equal(times, [0.0, 0.5, 1.0, 1.5, 1.7, 2.0 + 1e-9])  # no two instants for one
    np.testing.assert_array_equal(is_regular, [True, True, True, True, False, True])


def test_a_level_turn_in_wind_demands_the_bank_of_its_radius(sampled):
    times, _, samples = sampled
    side = SPEED**2 / RADIUS
    # Quintics of a second each stay within 1e-9 of a circle that takes 168 s; rounding of its acceleration is less.
    tolerance = {"rtol": 1e-6, "atol": 1e-6}
    np.testing.assert_allclose(samples["bank"][:, 0], math.atan2(side, GRAVITY), **tolerance)
    np.testing.assert_allclose(samples["load_factor"][:, 0], math.hypot(side, GRAVITY) / GRAVITY, **tolerance)
    np.testing.assert_allclose(samples["airspeed"][:, 0], SPEED, **tolerance)
    np.testing.assert_allclose(np.unwrap(samples["course"][:, 0]), SPEED / RADIUS * times, **tolerance)
    np.testing.assert_allclose(samples["thrust_surplus"][:, 0], 0.0, atol=1e-6)
    course = SPEED / RADIUS * times
    ground_speed = np.hypot(SPEED * np.cos(course), SPEED * np.sin(course) + WIND)
    np.testing.assert_allclose(samples["ground_speed"][:, 0], ground_speed, **tolerance)
    np.testing.assert_allclose(samples["east"][:, 0], RADIUS * (1.0 - np.cos(course)) + WIND * times, **tolerance)


def test_a_steady_climb_has_constant_samples(sampled):
    times, _, samples = sampled
    gamma = math.atan2(20.0, 140.0)
    for key, value in {
        "climb_rate": 20.0,
        "path_angle": gamma,
        "course": math.pi / 2,
        "bank": 0.0,
        "load_factor": math.cos(gamma),
        "thrust_surplus": GRAVITY * math.sin(gamma),
    }.items():
        np.testing.assert_allclose(samples[key][:, 1], value, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(samples["altitude"][:, 1], 500.0 + 20.0 * times, rtol=1e-12)


def test_the_motion_over_the_ground_has_the_vertical_wind(sampled):
    times, _, samples = sampled
    motion = sampled_motion(times, samples | {"climb_rate": samples["climb_rate"] + 3.0})
    np.testing.assert_allclose(motion.velocities_n[:, 1, 2], -20.0, rtol=1e-9)


def test_samples_after_the_arrival_are_nan(sampled):
    times, _, samples = sampled
    for values in samples.values():
        np.testing.assert_array_equal(np.isfinite(values[:, 2]), times <= 30.25)
    index = int(np.searchsorted(times, 30.25))
    assert samples["north"][index, 2] == pytest.approx(9000.0 - 3025.0, abs=1e-8)


def test_extremes_cover_the_whole_path():
    extremes = sample_extremes(FLEET, 0.0, ARRIVALS, GRAVITY)
    np.testing.assert_allclose(extremes.length, [SPEED * END, math.hypot(140, 20) * END, 3025.0], rtol=1e-7)
    np.testing.assert_allclose(extremes.values["altitude_max"], [1000.0, 1300.0, 800.0], rtol=1e-9)
    np.testing.assert_allclose(extremes.values["altitude_min"], [1000.0, 500.0, 800.0], rtol=1e-9)
    np.testing.assert_allclose(extremes.values["climb_rate_max"], [0.0, 20.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(extremes.values["thrust_deficit_max"][2], 0.0, atol=1e-9)


def test_paths_of_the_published_planner_are_sampled_the_same_way():
    lines = [
        fit_trajectory(
            0.0,
            END,
            jnp.array([0.0, east, -1000.0]),
            jnp.array([SPEED, 0.0, 0.0]),
            jnp.array([SPEED * END, east, -1000.0]),
            jnp.array([SPEED, 0.0, 0.0]),
            wind_n=jnp.array([0.0, WIND, 0.0]),
        )
        for east in (0.0, 800.0)
    ]
    times, _ = sample_times(0.0, np.array([END, END]))
    samples = sample_paths(_stacked(*lines), np.array([END, END]), times, GRAVITY)
    np.testing.assert_allclose(samples["airspeed"], SPEED, rtol=1e-12)
    np.testing.assert_allclose(samples["north"], np.stack([SPEED * times] * 2, axis=1), atol=1e-8)
    np.testing.assert_allclose(samples["east"], WIND * times[:, None] + np.array([[0.0, 800.0]]), atol=1e-8)
    np.testing.assert_allclose(samples["load_factor"], 1.0, rtol=1e-9)


def _plan(paths, arrivals, separation_m=None, keep_outs=()):
    arrivals = np.asarray(arrivals)
    times = sample_times(0.0, arrivals)
    goals = np.zeros((times[0].size, arrivals.size, 3))
    return sample_plan(paths, 0.0, arrivals, GRAVITY, goals, times, separation_m, keep_outs)


# Two that cross at right angles, 150 m apart in altitude; the third would meet the first after it has arrived.
CROSSING = _stacked(
    _timed(_straight((0.0, -2013.0, -1000.0), (0.0, 150.0, 0.0))),
    _timed(_straight((-2100.0, 0.0, -1150.0), (150.0, 0.0, 0.0))),
    _timed(_straight((6000.0, 1237.0, -1000.0), (-200.0, 0.0, 0.0)), end=20.1),
)


@pytest.fixture(scope="module")
def crossing():
    moving = {"speed_m_s": 40.0, "course_deg": -90.0}
    cell = KeepOut(name="cell", north_m=-5000.0, east_m=3000.0, radius_m=700.0, top_m=3000.0, **moving)
    low = KeepOut(name="low", north_m=0.0, east_m=0.0, radius_m=500.0, top_m=900.0)
    return _plan(CROSSING, (END, END, 20.1), (500.0, 100.0), (cell, low))


def test_the_closest_approach_may_lie_between_two_samples(crossing):
    # Relative motion: (-2100, 2013) + (150, -150) t; its least size at t = 4113 / 300.
    time_s = 4113.0 / 300.0
    horizontal_m = (2100.0 - 2013.0) / math.sqrt(2.0)
    approach = crossing.closest_by_distance
    assert approach.minimum_pair == (0, 1)
    assert approach.minimum_time_s == pytest.approx(time_s, abs=1e-6)  # the least of a parabola is flat
    assert approach.minimum_m == pytest.approx(math.hypot(horizontal_m, 150.0), abs=1e-6)
    assert (approach.horizontal_m, approach.vertical_m) == pytest.approx((horizontal_m, 150.0), abs=1e-3)
    # at a sample: the distance then
    k = int(np.searchsorted(crossing.time_s, 13.5))
    distance_m = math.hypot(-2100.0 + 150.0 * 13.5, 2013.0 - 150.0 * 13.5, 150.0)
    assert crossing.closest_by_distance.distance_m[k] == pytest.approx(distance_m, abs=1e-9)
    assert tuple(crossing.closest_by_distance.pair[k]) == (0, 1)


def test_separation_is_the_horizontal_or_the_scaled_vertical_distance(crossing):
    approach = crossing.closest_by_separation
    # 150 m of height count as 750 m: the two that cross are apart enough; the first and the third come to
    # (6000 - 200 t, 3250 - 150 t) until 20.1 s, when the third arrives.
    assert approach.minimum_pair == (0, 1)
    assert approach.minimum_m == pytest.approx(750.0, abs=1e-6)
    horizontal_m = math.hypot(6000.0 - 200.0 * 20.1, 3250.0 - 150.0 * 20.1)
    assert horizontal_m > 750.0
    flat = _plan(CROSSING, (END, END, 20.1), (500.0, 0.0))
    assert flat.closest_by_separation.minimum_m == pytest.approx(87.0 / math.sqrt(2.0), abs=1e-6)


def test_another_fleet_and_duration_compile_nothing(crossing, caplog):
    zone = KeepOut(name="zone", north_m=9000.0, east_m=0.0, radius_m=500.0)
    four = jax.tree.map(lambda leaf: np.concatenate([leaf, leaf[:1]]), CROSSING)
    two = jax.tree.map(lambda leaf: np.asarray(leaf)[:2], CROSSING)
    with jax.log_compiles():
        sampled_plans = [
            _plan(four, (END, END, 20.1, END), (500.0, 100.0), (zone,)),
            _plan(two, (25.0, 25.0), None, (zone, zone)),
        ]
    assert "Compiling" not in caplog.text
    assert sampled_plans[0].closest_by_distance.minimum_pair == (0, 3)  # the same path
    assert sampled_plans[1].closest_by_distance.minimum_m == pytest.approx(
        crossing.closest_by_distance.minimum_m, abs=1e-6
    )
    assert [samples.keep_out_margin_m.shape for samples in sampled_plans] == [(4, 1), (2, 2)]


def test_margins_to_moving_keep_outs(crossing):
    # The first flies east at north 0, 5000 m north of the cell's middle; the cell moves west 40 m/s: abeam at t with
    # -2013 + 150 t = 3000 - 40 t.
    assert crossing.keep_out_margin_m[0, 0] == pytest.approx(4300.0, abs=0.1)  # sampled every 31 ms
    assert crossing.keep_out_margin_time_s[0, 0] == pytest.approx(5013.0 / 190.0, abs=0.02)
    # Over the top of the low one by 100 m and 250 m.
    np.testing.assert_allclose(crossing.keep_out_margin_m[:2, 1], [100.0, 250.0], atol=1e-6)


def test_a_single_aircraft_has_no_closest_pair():
    single = _plan(jax.tree.map(lambda leaf: leaf[:1], CROSSING), (END,))
    assert single.closest_by_distance.minimum_pair == (-1, -1)
    assert np.isnan(single.closest_by_distance.distance_m).all()
    assert single.closest_by_separation is None
    assert single.keep_out_margin_m.shape == (1, 0)
