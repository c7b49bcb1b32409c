"""Delivered paths equal the designed ones, and their certificates bound the flight quantities between the knots too."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from anser.compiling.options import compiled_quickly
from anser.environment import AbstractWind, LayeredWind
from anser.parts import make_rendezvous
from anser.parts.planners import IdleDeceleration
from anser.planning import PathLimits, Separation, TimedPath
from anser.planning.certified.certified_plan import certify
from anser.planning.certified.path_bounds import excess, path_bounds
from anser.planning.certified.routes import cis
from anser.planning.certified.task import AircraftTask, Airspace, KeepOuts
from anser.planning.limits import CERTIFIED_LIMITS
from support.aircraft_tasks import no_keep_outs
from support.certified_cases import (
    FLOWN,
    GRAVITY,
    INTERVALS,
    LAYERED,
    START_S,
    STEADY,
    Dense,
    delivered,
    number,
    picked,
)

WINDS = {"steady": STEADY, "layered": LAYERED}
COUNT = len(FLOWN["duration"])
fly = compiled_quickly(delivered)
bound = compiled_quickly(jax.vmap(path_bounds, in_axes=(0, None, None)))
bound_one = compiled_quickly(path_bounds)
excess_of = compiled_quickly(jax.vmap(excess, in_axes=(0, None)))


@pytest.fixture(scope="module", params=[pytest.param("steady", marks=pytest.mark.long), "layered"])
def flown(request):
    wind = WINDS[request.param]
    endpoints, table, solved, shape, paths = fly(wind)
    assert np.all(np.asarray(solved.exists))
    bounds = bound(paths, wind, GRAVITY)
    return wind, endpoints, table, shape, paths, bounds, [Dense(picked(paths, k), wind) for k in range(COUNT)]


def designed_and_delivered(table, shape, path, times):
    """Designed and delivered state: position, air velocity, and the derivative of the delivered position."""
    scale = shape.length / table.length

    def state_pair(t):
        length, drift = table.flown_at(t)
        route_position, heading, _ = shape.at(scale * length)
        state = table.profile.at(t)
        (speed, wind), direction = table.rates(t), cis(heading)
        position = jnp.stack(
            [jnp.real(route_position) + drift[0], jnp.imag(route_position) + drift[1], -state.altitude]
        )
        slope = jnp.stack(
            [scale * speed * jnp.real(direction), scale * speed * jnp.imag(direction), -state.climb - wind[2]]
        )
        at = START_S + t
        derivative = jax.jacfwd(path.position_n)(at)
        return position, slope, path.position_n(at), path.air_velocity_n(at), derivative, path.velocity_n(at)

    return jax.vmap(state_pair)(times)


compare = compiled_quickly(jax.vmap(designed_and_delivered))


def test_a_path_ends_at_the_prescribed_point_and_time(flown):
    _, endpoints, table, _, paths, _, dense = flown
    np.testing.assert_array_equal(paths.times[:, 0], START_S)
    np.testing.assert_allclose(paths.times[:, -1], START_S + np.asarray(FLOWN["duration"]), rtol=1e-15)
    for k in range(COUNT):
        drift, goal = np.asarray(table.drifts_n[k, -1]), complex(endpoints.end[k])
        expected = [goal.real + drift[0], goal.imag + drift[1], -FLOWN["altitude_1"][k]]
        # Legs are solved for, not iterated: rounding of 2e4 m only.
        np.testing.assert_allclose(dense[k].path(paths.times[k, -1]), expected, atol=1e-6)
        course = np.arctan2(paths.air_n[k, -1, 1, 1], paths.air_n[k, -1, 1, 0])
        np.testing.assert_allclose(np.exp(1j * course), np.exp(1j * FLOWN["course"][k]), atol=1e-9)
        initial = np.asarray(paths.air_n[k, 0])
        np.testing.assert_allclose(initial[0], [0.0, 0.0, -FLOWN["altitude_0"][k]], atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(initial[1]), FLOWN["speed_0"][k], rtol=2e-6)  # the length's millionth
        np.testing.assert_allclose(np.arctan2(initial[1, 1], initial[1, 0]), FLOWN["heading"][k], atol=1e-12)
        np.testing.assert_array_equal(paths.drift_n[k, 0, 0], 0.0)


def test_knots_are_in_order_with_none_too_close(flown):
    times = np.asarray(flown[4].times, dtype=float)
    spans = times[:, 1:] - times[:, :-1]
    # Equal, or at least the fiftieth of a second that keeps the digits of accelerations.
    assert np.all((spans == 0.0) | (spans > 0.02 - 1e-9))
    assert np.max(spans) <= np.max(FLOWN["duration"]) / INTERVALS + 0.02


@pytest.mark.long
def test_a_delivered_path_is_the_designed_one_between_the_knots_too(flown):
    wind, _, table, shape, paths, _, _ = flown
    times = np.asarray(FLOWN["duration"])[:, None] * np.linspace(0.0, 1.0, 1500)[1:-1]
    position, slope, delivered_position, air, derivative, velocity = (
        np.asarray(x) for x in compare(table, shape, paths, jnp.asarray(times))
    )
    # Where a kink was merged into a knot 0.02 s away, a jump of 6 m/s^3 in a cell of 1 s; where the wind has a corner
    # in a cell, one of up to 0.4 m/s^2 in the drift's slope: 0.4 x 1/27 m.
    np.testing.assert_allclose(delivered_position, position, atol=1e-3 if wind is STEADY else 0.015)
    np.testing.assert_allclose(air, slope, atol=5e-3 if wind is STEADY else 0.015)
    np.testing.assert_allclose(velocity, derivative, atol=1e-9)  # rounding


def test_bounds_contain_the_extremes_and_little_more(flown):
    wind, *_, bounds, dense = flown
    # How much further than a thousandth of a second shows: parts of the value, and what near-zero values may add.
    tolerances = {
        "speed_min": (0.003, 0.0),
        "speed_max": (0.003, 0.0),
        "bank_max": (0.04, 0.0),
        "load_factor_max": (0.04, 0.0),
        "load_factor_min": (0.05, 0.0),
        "climb_rate_max": (0.02, 0.1),
        "altitude_min": (0.0, 0.5),
        "altitude_max": (0.0, 0.5),
        "acceleration_max": (0.05, 0.1),
        "deceleration_max": (0.05, 0.1),
        # Where a layer ends within a cell, both winds count all through it: 0.02 1/s x 40 m/s x 1 s / 4 more.
        "wind_error_max": (0.5, 0.2 if wind is LAYERED else 1e-9),
    }
    for k in range(COUNT):
        for name, exact in dense[k].extremes().items():
            bound = float(getattr(bounds, name)[k])
            margin = exact - bound if name.endswith("_min") else bound - exact
            relative, absolute = tolerances[name]
            message = f"{name} of flight {k}: bound {bound}, seen {exact}"
            assert margin >= -1e-9 * (1.0 + abs(exact)), message  # rounding
            assert margin <= relative * abs(exact) + absolute, message
    assert np.all(np.asarray(bounds.wind_error_max) < (1e-9 if wind is STEADY else 0.3))


# Of an F-16 at 164 m/s: less at lower airspeeds and unloaded.
IDLE = IdleDeceleration(
    *(
        jnp.array(row)
        for row in ([90.0, 110.0, 130.0, 165.0, 205.0], [1.05, 0.85, 0.82, 1.0, 1.55], [1, 0.7, 0.5, 0.2, 0])
    )
)


def drag(speed, load_factor):
    """Reference by NumPy: linear in airspeed, induced drag by the square of the load factor; 1.2 m/s^2 at the start."""
    unloaded = 1.0 - np.clip(load_factor, 0.0, 1.0) ** 2
    level, by_lift = (np.interp(speed, IDLE.speeds, values) for values in (IDLE.level, IDLE.by_lift))
    return level - unloaded * by_lift, 1.2 * by_lift * (np.maximum(load_factor, 1.0) ** 2 - 1.0)


def test_accelerations_are_limited_by_airspeed_and_load_factor(flown):
    *_, bounds, dense = flown
    wide = [number(x) for x in (50.0, 400.0, 1.4, 100.0, -1e3)]
    limits = PathLimits(*wide, acceleration_max=number(50.0), deceleration_max=number(1.2), idle=IDLE)
    equivalent = np.asarray(
        compiled_quickly(jax.vmap(lambda path_bounds_: jnp.stack(path_bounds_.along_at_start(limits))))(bounds)
    )
    plain = [extremes.extremes() for extremes in dense]
    for k in range(COUNT):
        exact = dense[k].extremes(drag)
        for column, key in enumerate(("acceleration_max", "deceleration_max")):
            assert exact[key] <= float(equivalent[k, column]) <= 1.08 * exact[key] + 0.15
    slower, faster = (
        np.array([extremes[key] for extremes in plain]) for key in ("deceleration_max", "acceleration_max")
    )
    assert np.any(np.asarray(equivalent[:, 1]) > 1.05 * slower)
    assert np.any(np.asarray(equivalent[:, 0]) > 1.2 * faster)
    satisfied = (
        np.asarray(excess_of(bounds, limits))[
            :, [extremes.field for extremes in CERTIFIED_LIMITS].index("deceleration_max")
        ]
        <= 0.0
    )
    np.testing.assert_array_equal(satisfied, np.asarray(equivalent[:, 1]) <= 1.2)


def test_acceleration_of_each_cell_is_bounded(flown):
    *_, paths, bounds, dense = flown
    for k in range(COUNT):
        size = np.linalg.norm(dense[k].acceleration, axis=1)
        cell = np.clip(
            np.searchsorted(np.asarray(paths.times[k]), dense[k].time, side="right") - 1, 0, paths.times.shape[1] - 2
        )
        # Rounding of 1e4 m over a cell of 0.02 s: 2e-12 m x 60 / (0.02 s)^2.
        assert np.all(size <= np.asarray(bounds.cell_acceleration[k])[cell] + 1e-6)
    # And not by a figure that fits all.
    assert np.median(bounds.cell_acceleration) < 0.8 * np.max(bounds.cell_acceleration)


# Names of the extremes in the order of CERTIFIED_LIMITS, and which way each is a limit.
_ORDER = (
    ("speed_min", -1),
    ("speed_max", 1),
    ("bank_max", 1),
    ("load_factor_max", 1),
    ("load_factor_min", -1),
    ("climb_rate_max", 1),
    ("altitude_min", -1),
    ("altitude_max", 1),
    ("acceleration_max", 1),
    ("deceleration_max", 1),
)


def limits_beyond(extremes, fraction):
    """Limits that exceed a path's extremes by a fraction of them (or of 1); negative: tighter limits."""
    return PathLimits(
        **{name: number(extremes[name] + sign * fraction * max(abs(extremes[name]), 1.0)) for name, sign in _ORDER}
    )


def test_exactly_the_violated_limits_are_reported(flown):
    *_, bounds, dense = flown
    for k in (0, 3):
        extremes = dense[k].extremes()
        wide = limits_beyond(extremes, 0.08)
        assert np.all(np.asarray(excess_of(bounds, wide))[k] <= 0.0)
        tight = limits_beyond(extremes, -0.002)
        for name, _ in _ORDER:
            limits = eqx.tree_at(lambda x, name=name: getattr(x, name), wide, getattr(tight, name))
            broken = np.asarray(excess_of(bounds, limits))[k] > 0.0
            assert [CERTIFIED_LIMITS[j].field for j in np.flatnonzero(broken)] == [name]


def test_missing_limits_are_satisfied(flown):
    over = excess_of(flown[5], PathLimits(*(number(x) for x in (50.0, 400.0, 1.4, 100.0, -1e3))))
    assert np.all(np.asarray(over) < 0.0)


def knots(*entries):
    """A path through rows of (time, position, velocity), without drift."""
    times = jnp.asarray([entry[0] for entry in entries], dtype=float)
    air = jnp.asarray([[entry[1], entry[2], [0.0, 0.0, 0.0]] for entry in entries], dtype=float)
    return TimedPath(times, air, jnp.zeros_like(air))


CALM = type(STEADY)(jnp.zeros(3))


def test_violations_between_the_knots_are_detected():
    # Every knot is at 150 m/s, level, without an acceleration at 1000 m; what lies between is not.
    level = bound_one(knots((0, [0, 0, -1000], [150, 0, 0]), (10, [1500, 0, -1000], [150, 0, 0])), CALM, GRAVITY)
    np.testing.assert_allclose([level.speed_min, level.speed_max], 150.0, rtol=1e-12)
    np.testing.assert_allclose([level.bank_max, level.climb_rate_max], 0.0, atol=1e-9)
    np.testing.assert_allclose([level.altitude_min, level.altitude_max], 1000.0, rtol=1e-12)
    np.testing.assert_allclose([level.load_factor_min, level.load_factor_max], 1.0, rtol=1e-9)
    # 300 m too few: the slope of 10u^3 - 15u^4 + 6u^5 is 1.875 in the middle, 150 - 1.875 x 30 m/s.
    slow = bound_one(knots((0, [0, 0, -1000], [150, 0, 0]), (10, [1200, 0, -1000], [150, 0, 0])), CALM, GRAVITY)
    assert slow.speed_min <= 150.0 - 1.875 * 30.0
    # 5.7735 is the greatest second derivative: 300 m / (10 s)^2 of it.
    assert slow.deceleration_max >= 5.7735 * 3.0 * (1 - 1e-5)
    fast = bound_one(knots((0, [0, 0, -1000], [150, 0, 0]), (10, [1800, 0, -1000], [150, 0, 0])), CALM, GRAVITY)
    assert fast.speed_max >= 150.0 + 1.875 * 30.0
    # 200 m to the side: 11.5 m/s^2 at a fifth of the way, where it moves aside at 16 m/s.
    aside = bound_one(knots((0, [0, 0, -1000], [150, 0, 0]), (10, [1500, 200, -1000], [150, 0, 0])), CALM, GRAVITY)
    assert aside.bank_max > np.arctan(5.7735 * 2.0 * 0.98 / GRAVITY)
    climb = bound_one(knots((0, [0, 0, -1000], [150, 0, 0]), (10, [1500, 0, -1200], [150, 0, 0])), CALM, GRAVITY)
    assert climb.climb_rate_max >= 1.875 * 20.0
    assert climb.load_factor_max > 1.0 + 5.7735 * 2.0 * 0.9 / GRAVITY
    assert climb.load_factor_min < 1.0 - 5.7735 * 2.0 * 0.9 / GRAVITY
    # Up at the first knot, down at the last: over the top in between, 25 m/s x 10 s x 2 x 5/32.
    over = bound_one(knots((0, [0, 0, -1000], [150, 0, -25]), (10, [1500, 0, -1000], [150, 0, 25])), CALM, GRAVITY)
    assert over.altitude_max >= 1000.0 + 250.0 * 5 / 16
    assert over.altitude_min >= 1000.0 - 1e-9


def test_an_aircraft_that_must_descend_or_decelerate_has_a_negative_bound_of_acceleration():
    """Steady glide at 15 of 150 m/s, with an empty cell: V_dot + g sin(gamma) is a tenth of -g."""
    velocity = [150.0 * np.sqrt(0.99), 0.0, 15.0]
    entries = [(t, [velocity[0] * t, 0.0, 15.0 * t - 2000.0], velocity) for t in (0.0, 10.0, 10.0, 20.0)]
    glide = bound_one(knots(*entries), CALM, GRAVITY)
    wide = PathLimits(*[number(x) for x in (50.0, 400.0, 1.4, 100.0, -1e3)], deceleration_max=number(1.2))
    index = [limit.field for limit in CERTIFIED_LIMITS].index("acceleration_max")
    for idle in (None, IDLE):
        limits = eqx.tree_at(lambda x: x.idle, wide, idle, is_leaf=lambda leaf: leaf is None)
        acceleration, deceleration = glide.along_at_start(limits)
        np.testing.assert_allclose(acceleration, -0.1 * GRAVITY, rtol=1e-6)
        assert deceleration >= 0.1 * GRAVITY
        for limit, keeps in ((-0.09 * GRAVITY, True), (-0.11 * GRAVITY, False)):
            limited = eqx.tree_at(lambda x: x.acceleration_max, limits, number(limit))
            assert (float(excess(glide, limited)[index]) <= 0.0) == keeps
    # In a wind that the drift does not have, the bound is that of the worst case.
    windy = bound_one(knots(*entries), type(STEADY)(jnp.array([5.0, 0.0, 0.0])), GRAVITY)
    worst = -0.1 * GRAVITY * 150.0 / 155.0
    assert worst <= float(windy.acceleration_max) < 0.0


def test_a_drift_inconsistent_with_the_wind_is_detected():
    path = knots((0, [0, 0, -1000], [150, 0, 0]), (10, [1500, 0, -1000], [150, 0, 0]))
    bounds = bound_one(path, type(STEADY)(jnp.array([3.0, 4.0, 0.0])), GRAVITY)
    np.testing.assert_allclose(bounds.wind_error_max, 5.0, rtol=1e-12)
    # The aircraft's own speed may be less and more by as much.
    assert bounds.speed_min <= np.hypot(147.0, 4.0)
    assert bounds.speed_max >= np.hypot(147.0, 4.0)


def test_a_wind_without_bounds_is_refused():
    class Gusts(AbstractWind):
        def at(self, position_n, time):
            return jnp.zeros(3)

    path = knots((0, [0, 0, -1000], [150, 0, 0]), (10, [1500, 0, -1000], [150, 0, 0]))
    with pytest.raises((TypeError, TypeCheckError), match="wind of type Gusts"):
        path_bounds(path, Gusts(), GRAVITY)


@pytest.mark.long
def test_batches_equal_single_paths(flown):
    wind, *_, paths, bounds, _ = flown
    single = bound_one(picked(paths, 1), wind, GRAVITY)
    for value, expected in zip(jax.tree.leaves(single), jax.tree.leaves(picked(bounds, 1)), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-9)  # rounding, of accelerations too


@pytest.mark.long
def test_gradients_are_finite_with_empty_cells(flown):
    wind, *_, paths, _, _ = flown

    def total(path):
        bounds = path_bounds(path, wind, GRAVITY)
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(bounds))

    path = picked(paths, 0)
    assert np.any(np.diff(np.asarray(path.times)) == 0.0)
    # As users compile it: by LLVM's lowest optimisation, which the tests take elsewhere, XLA's code gives NaN here.
    slopes = jax.jit(jax.grad(total), compiler_options={"xla_backend_optimization_level": 3})(path)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))


def _tasks(active):
    zeros = jnp.zeros((COUNT, 3))
    numbers = (50.0, 400.0, 1.4, 100.0, -1e3, 2e4, 9.0, 99.0, 99.0)
    limits = PathLimits(*(jnp.full(COUNT, x) for x in numbers), load_factor_min=jnp.full(COUNT, -9.0))
    return AircraftTask(
        zeros,
        zeros,
        zeros,
        zeros,
        zeros,
        jax.vmap(make_rendezvous)(zeros),
        jnp.ones(COUNT),
        jnp.zeros(COUNT, dtype=int),
        limits,
        jnp.ones(COUNT),
        jnp.asarray(active),
    )


@pytest.mark.long
def test_an_invalid_path_leaves_the_others_unaffected(flown):
    wind, *_, paths, _, _ = flown
    volume = KeepOuts(jnp.zeros((1, 2)), jnp.zeros((1, 2)), number([500.0]), number([-100.0]), number([9000.0]))
    airspace = Airspace(wind, number(GRAVITY), Separation(number(900.0), number(200.0)), volume)
    active = np.ones(COUNT)
    active[3] = 0.0
    with_invalid = jax.tree.map(lambda leaf: leaf.at[3].set(jnp.nan), paths)
    certified = compiled_quickly(lambda p: certify(p, _tasks(active), airspace, INTERVALS))
    certificate, expected = certified(with_invalid), certified(paths)
    valid = np.arange(COUNT) != 3
    np.testing.assert_allclose(certificate.keep_out_clearance[valid], expected.keep_out_clearance[valid], rtol=1e-12)
    np.testing.assert_allclose(
        certificate.clearance_ratio[np.ix_(valid, valid)], expected.clearance_ratio[np.ix_(valid, valid)], rtol=1e-12
    )
    assert np.all(np.isfinite(certificate.keep_out_clearance[valid]))
    assert np.any(certificate.keep_out_clearance[valid] < 0.0)
    assert not bool(certificate.satisfied_individually[3])


def test_a_cell_that_ends_at_the_edge_of_a_layer_belongs_to_one_side():
    wind = LayeredWind(jnp.array([1000.0, 2000.0]), jnp.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]]))
    # Level below the shear up to its very edge, to rounding; then at the edge itself; then well into it.
    for top, error in ((1000.0 + 1e-9, 0.0), (1000.0 + 1e-3, 2e-5), (1100.0, 2.0)):
        path = knots((0, [0, 0, -900], [150, 0, -15]), (10, [1500, 0, -top], [150, 0, 0]))
        error_bound = float(bound_one(path, wind, GRAVITY).wind_error_max)
        assert error_bound >= error * (1.0 - 1e-6)
        assert error_bound <= 2e-7 if error == 0.0 else error_bound <= 2.0 + 1e-6
    along = knots((0, [0, 0, -1000], [150, 0, 0]), (10, [1500, 0, -1000], [150, 0, 0]))
    assert float(bound_one(along, wind, GRAVITY).wind_error_max) < 1e-9
    at_top = knots((0, [0, 0, -2000], [150, 0, 0]), (10, [1500, 0, -2000], [150, 0, 0]))
    assert float(bound_one(at_top, wind, GRAVITY).wind_error_max) == pytest.approx(20.0)


@pytest.mark.long
def test_a_fleets_certificate_is_never_better_than_its_paths(flown):
    wind, *_, paths, _, dense = flown
    separation = Separation(number(900.0), number(200.0))
    airspace = Airspace(wind, number(GRAVITY), separation, no_keep_outs())
    tasks = _tasks(np.ones(COUNT))
    certificate = compiled_quickly(lambda p: certify(p, tasks, airspace, INTERVALS))(paths)
    ratios = np.asarray(certificate.clearance_ratio)
    np.testing.assert_allclose(ratios, ratios.T, rtol=1e-12)
    for i in range(COUNT):
        for j in range(i):
            count = min(dense[i].time.size, dense[j].time.size)  # until the earlier arrives
            offset = dense[i].position[:count] - dense[j].position[:count]
            ratio = np.maximum(np.hypot(offset[:, 0], offset[:, 1]) / 900.0, np.abs(offset[:, 2]) / 200.0)
            assert ratios[i, j] <= np.min(ratio) + 1e-6
            # At 12 m/s^2 in a quarter of a second the paths stray 0.1 m each from straight lines; 0.3 m/s^2... and the
            # last interval may reach past the arrival, by 0.3 s at 300 m/s.
            assert ratios[i, j] >= np.min(ratio) - 0.1


def test_a_limit_of_nan_is_violated_and_an_infinite_one_satisfied(flown):
    bounds = picked(flown[5], 0)
    limits = PathLimits(*[number(x) for x in (-np.inf, np.inf, 1.5, np.inf, -np.inf)])
    assert np.all(np.asarray(excess(bounds, limits))[[0, 1, 4, 5, 6, 7, 8]] == -1.0)
    for name in ("speed_min", "speed_max", "climb_rate_max", "altitude_min", "altitude_max", "acceleration_max"):
        broken = eqx.tree_at(lambda path_limits, name=name: getattr(path_limits, name), limits, number(np.nan))
        assert np.any(~(np.asarray(excess(bounds, broken)) <= 0.0)), name
