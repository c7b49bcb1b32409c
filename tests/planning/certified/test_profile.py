"""Profiles of altitude and airspeed over time, in wind."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning import PathLimits
from anser.planning.certified.profile import (
    _SPEED_RATES,
    last_to_mean_speed,
    make_profile,
    mean_to_last_speed,
    profile_excess,
    speed_ramp,
    tabulate,
    within_profile_limits,
)
from support.certified_cases import GRAVITY, LAYERED, STEADY, blowing, number

CASES = 24
INTERVALS = 128
FADE_S = 3.0  # of the acceleration that a path begins with
_RNG = np.random.default_rng(4)
DURATION = _RNG.uniform(20.0, 300.0, CASES)
ALTITUDES = _RNG.uniform(300.0, 3000.0, (2, CASES))
CLIMBS = _RNG.uniform(-8.0, 8.0, (2, CASES))
CLIMB_DOT = _RNG.uniform(-1.0, 1.0, CASES)
DETOUR = _RNG.choice([0.0, 300.0, -300.0], CASES)
SPEED = _RNG.uniform(120.0, 180.0, CASES)
SPEED_DOT = _RNG.uniform(-1.0, 1.0, CASES)
MEAN = _RNG.uniform(120.0, 180.0, CASES)
# Every other one changes its speed once more, at the end.
CHANGE = np.where(np.arange(CASES) % 2 == 0, 0.0, _RNG.uniform(-30.0, 30.0, CASES))
INPUTS = tuple(map(jnp.asarray, (DURATION, ALTITUDES.T, CLIMBS.T, CLIMB_DOT, DETOUR, SPEED, SPEED_DOT, MEAN, CHANGE)))


def make(duration, altitudes, climbs, climb_dot, detour, speed, speed_dot, mean, change):
    middle = mean_to_last_speed(mean, speed, duration)
    speeds = (speed, middle, middle + change)
    return make_profile(
        duration, (altitudes[0], altitudes[1]), (climbs[0], climbs[1]), climb_dot, detour, speeds, speed_dot
    )


def motion(profile, t):
    state = profile.at(t)
    return jnp.stack([state.altitude, state.climb, state.climb_dot, state.speed, state.speed_dot])


def motions(profile, times):
    return jax.vmap(lambda t: jax.jvp(lambda u: motion(profile, u), (t,), (jnp.ones_like(t),)))(times)


def tabulated(profile, wind):
    return tabulate(profile, wind, INTERVALS)


def readings(table, times):
    def one(t):
        length, drift = table.flown_at(t)
        speed, wind = table.rates(t)
        return length, drift, speed, wind, table.time_at(length)

    return jax.vmap(one)(times)


@functools.cache
def profiles():
    return compiled_quickly(jax.vmap(make))(*INPUTS)


kinks_of = compiled_quickly(jax.vmap(lambda profile: profile.kinks))
along = compiled_quickly(jax.vmap(motions))
tables_of = compiled_quickly(jax.vmap(tabulated, in_axes=(0, None)))
read = compiled_quickly(jax.vmap(readings))


def test_profiles_start_and_end_as_prescribed():
    end_times = jnp.stack([jnp.zeros(CASES), profiles().duration], axis=1)
    initial, final = np.moveaxis(np.asarray(along(profiles(), end_times)[0]), 1, 0)
    expected = np.stack([ALTITUDES[0], CLIMBS[0], CLIMB_DOT, SPEED, SPEED_DOT], axis=1)
    np.testing.assert_allclose(initial, expected, rtol=1e-12, atol=1e-12)  # rounding
    np.testing.assert_allclose(final[:, 0], ALTITUDES[1], atol=1e-9)  # rounding of 1e3 m
    np.testing.assert_allclose(final[:, 1], CLIMBS[1], atol=1e-11)
    np.testing.assert_allclose(final[:, 3], profiles().speed_2, rtol=1e-13)
    np.testing.assert_allclose(profiles().speed_2 - profiles().speed_1, CHANGE, atol=1e-12)
    # It arrives without an acceleration.
    np.testing.assert_allclose(final[:, [2, 4]], 0.0, atol=1e-11)


def test_mean_airspeed_is_the_prescribed_one_plus_known_corrections():
    t = np.linspace(0.0, 1.0, 40001)
    speed = np.asarray(along(profiles(), DURATION[:, None] * t)[0])[..., 3]
    mean = np.sum(0.5 * (speed[:, 1:] + speed[:, :-1]), axis=1) / (t.size - 1)
    np.testing.assert_allclose(
        jax.jit(jax.vmap(lambda p: p.speed_mean))(profiles()), mean, rtol=1e-8
    )  # the trapezoid's
    # The integral of t (1 - t/F)^3 over the F seconds in which it fades is F^2/20.
    expected = MEAN + SPEED_DOT * FADE_S**2 / 20 / DURATION
    once = CHANGE == 0.0
    np.testing.assert_allclose(mean[once], expected[once], rtol=1e-8)  # the trapezoid's, with steps of 7 ms
    # Half of the time of the second change is flown at the mean of both speeds.
    later = 0.5 * np.asarray(profiles().speed_ramp_2) * CHANGE / DURATION
    np.testing.assert_allclose(mean, expected + later, rtol=1e-8)
    # Not beyond the steady speed asked, but for making up the change: the mean lies between both ends.
    final_speeds = np.asarray(profiles().speed_1)
    assert np.all((MEAN - SPEED) * (final_speeds - MEAN) >= 0.0)


def test_rates_are_continuous_derivatives():
    grid = DURATION[:, None] * np.linspace(0.0, 1.0, 500)[1:-1]
    value, slope = (np.asarray(x) for x in along(profiles(), jnp.asarray(grid)))
    np.testing.assert_allclose(slope[..., 0], value[..., 1], atol=1e-10)  # rounding
    np.testing.assert_allclose(slope[..., 1], value[..., 2], atol=1e-10)
    np.testing.assert_allclose(slope[..., 3], value[..., 4], atol=1e-10)
    # At the kinks themselves accelerations are continuous: a step of 1e-14 s, slopes of 1 m/s^3.
    kinks = np.asarray(kinks_of(profiles()))
    right_limit, left_limit = (
        np.asarray(along(profiles(), jnp.asarray(t))[0]) for t in (kinks, np.nextafter(kinks, 0.0))
    )
    np.testing.assert_allclose(right_limit, left_limit, rtol=1e-12, atol=1e-11)


def test_third_derivatives_jump_at_kinks_only():
    # Differences of the slopes of the accelerations over a millisecond: small within, except where a kink lies.
    step = 1e-3
    times = np.arange(2 * step, 20.0, step)
    slope = np.asarray(along(profiles(), jnp.asarray(np.tile(times, (CASES, 1))))[1])[..., [2, 4]]
    jumps = np.max(np.abs(np.diff(slope, axis=1)), axis=2) > 0.05  # fourth derivatives are below 10 m/s^4 in 1 ms
    all_kinks = np.asarray(kinks_of(profiles()))
    for k, kinks in enumerate(all_kinks):
        jump_times = times[1:][jumps[k]]
        assert all(np.min(np.abs(kinks - t)) <= 2 * step for t in jump_times)


@pytest.mark.parametrize("wind", [STEADY, LAYERED], ids=["steady", "layered"])
def test_lengths_and_drifts_are_integrals(wind):
    table = tables_of(profiles(), wind)
    t = np.linspace(0.0, 1.0, 40001)
    value = np.asarray(along(profiles(), DURATION[:, None] * t)[0])
    for k in range(CASES):
        altitude, climb, _, speed, _ = value[k].T
        air = blowing(wind, altitude)
        level = np.sqrt(speed**2 - (climb + air[:, 2]) ** 2)
        step = DURATION[k] / (t.size - 1)
        length = step * np.sum(0.5 * (level[1:] + level[:-1]))
        drift = step * np.sum(0.5 * (air[1:] + air[:-1]), axis=0)
        # Four nodes per tick of up to 2.3 s; where a layer's boundary is crossed the wind's slope jumps by up to
        # 0.02 1/s x 40 m/s: 0.8 m/s^2 x (2.3 s)^2 / 100 for a kink amid four nodes, twice or thrice.
        room = 0.05 if wind is LAYERED else 1e-4
        np.testing.assert_allclose(table.length[k], length, atol=room)
        np.testing.assert_allclose(table.drift_n[k], drift, atol=room)
        if wind is STEADY:
            np.testing.assert_allclose(drift, DURATION[k] * np.asarray(wind.velocity_n), rtol=1e-10)


@pytest.fixture(scope="module")
def layered():
    return tables_of(profiles(), LAYERED)


def test_readings_between_ticks_agree_with_the_ticks_and_time_is_the_inverse(layered):
    intervals = DURATION[:, None] * np.linspace(0.0, 1.0, INTERVALS + 1)
    lengths, drifts, _, _, times = (np.asarray(x) for x in read(layered, jnp.asarray(intervals)))
    np.testing.assert_allclose(lengths, layered.lengths, atol=1e-8)  # rounding of 1e5 m
    np.testing.assert_allclose(drifts, layered.drifts_n, atol=1e-8)
    np.testing.assert_allclose(times, intervals, atol=1e-8)
    between = DURATION[:, None] * np.sort(np.random.default_rng(1).uniform(0.0, 1.0, INTERVALS + 1))
    lengths, drifts, speeds, winds, times = (np.asarray(x) for x in read(layered, jnp.asarray(between)))
    # Two Newton steps from a straight line in a tick of 2 s, in which the speed changes by a hundredth.
    np.testing.assert_allclose(times, between, atol=1e-5)
    assert np.all(np.diff(lengths, axis=1) > 0.0)
    # Rates are those of the profile in the wind.
    value = np.asarray(along(profiles(), jnp.asarray(between))[0])
    for k in range(CASES):
        air = blowing(LAYERED, value[k, :, 0])
        np.testing.assert_allclose(winds[k], air, atol=1e-12)
        np.testing.assert_allclose(speeds[k] ** 2 + (value[k, :, 1] + air[:, 2]) ** 2, value[k, :, 3] ** 2, rtol=1e-12)


def test_final_and_mean_airspeed_are_inverse_functions():
    final_speed, speed, duration = (jnp.asarray(x) for x in (MEAN, SPEED, DURATION + 200.0))

    @compiled_quickly
    @jax.vmap
    def there_and_back(final_speed, speed, duration):
        recovered = mean_to_last_speed(last_to_mean_speed(final_speed, speed, duration), speed, duration)
        return recovered, speed_ramp(speed, recovered, duration)

    recovered, ramp = (np.asarray(x) for x in there_and_back(final_speed, speed, duration))
    np.testing.assert_allclose(recovered, final_speed, rtol=1e-12)  # rounding
    # A smoothstep's peak is 1.5 times its mean: never harder than meant where there is time for it.
    assert np.all(1.5 * np.abs(recovered - speed) / ramp <= _SPEED_RATES[0] * (1 + 1e-12))


def limits_of(value):
    return PathLimits(**{field: number(limit) for field, limit in (value | {"bank_max": 1.5}).items()})


def test_excess_is_measured_against_each_limit(layered):
    intervals = DURATION[:, None] * np.linspace(0.0, 1.0, INTERVALS + 1)
    value = np.asarray(along(profiles(), jnp.asarray(intervals))[0])
    wide = {
        "speed_min": 50.0,
        "speed_max": 400.0,
        "climb_rate_max": 300.0,
        "altitude_min": -5e3,
        "altitude_max": 2e4,
        "acceleration_max": 50.0,
        "deceleration_max": 50.0,
    }
    excesses = compiled_quickly(jax.vmap(profile_excess, in_axes=(0, None, None)))(layered, limits_of(wide), GRAVITY)
    for k in range(CASES):
        altitude, climb, _, speed, speed_dot = value[k].T
        climb = climb + blowing(LAYERED, altitude)[:, 2]
        along_path = speed_dot + GRAVITY * climb / speed
        expected = [
            50.0 - np.min(speed),
            np.max(speed) - 400.0,
            np.max(np.abs(climb)) - 300.0,
            -5e3 - np.min(altitude),
            np.max(altitude) - 2e4,
            np.max(np.abs(along_path)) - 50.0,
        ]
        np.testing.assert_allclose(excesses[k], expected, atol=1e-9)  # rounding of 1e4 m
    assert within_profile_limits(excesses[0])
    # One limit broken is enough.
    for k in range(6):
        assert not within_profile_limits(excesses[0].at[k].set(1e-6))
    assert within_profile_limits(excesses[0].at[2].set(0.0))


@pytest.mark.long
def test_gradients_are_finite_for_level_flight_at_steady_speed():
    def outcome(altitude, speed, duration):
        final_speed = mean_to_last_speed(speed, 150.0, duration)
        profile = make_profile(
            duration, (altitude, 1000.0), (0.0, 0.0), 0.0, 0.0, (150.0, final_speed, final_speed), 0.0
        )
        table = tabulate(profile, LAYERED, 30)  # intervals of 2 s: the shortest change of speed is one of them
        return table.length + jnp.sum(table.drift_n)

    slopes = compiled_quickly(jax.grad(outcome, argnums=(0, 1, 2)))(number(1000.0), number(150.0), number(60.0))
    assert np.all(np.isfinite(slopes))
    # Flown at 150 m/s, a second more is 150 m more and the drift at 1000 m, none in all.
    np.testing.assert_allclose(slopes[2], 150.0, rtol=1e-9)
    # A mean speed of 1 m/s more is 60 m more.
    np.testing.assert_allclose(slopes[1], 60.0, rtol=1e-9)
