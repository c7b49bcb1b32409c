"""The dense check of plans: passes a correct plan, and finds every kind of planted fault."""

import math
from dataclasses import replace

import numpy as np
import pytest

from trials.check import dense_check
from trials.data import (
    ArrivalRule,
    FleetLimits,
    Goals,
    KeepOutCylinders,
    Paths,
    PlanCase,
    Starts,
    WindProfile,
)
from trials.motion import path_cells
from trials.report import LIMITS, Tolerances
from trials.separation import chord_blocks, least_clearances

G = 9.80665
V, RADIUS, LAST = 150.0, 3000.0, 60.0
NAN3 = np.full(3, np.nan)


def _motions(t):
    """Ground position, velocity and acceleration (time, 3, 3) of a level circle, a climb in wind and a pull-up."""
    w, zero = V / RADIUS, np.zeros_like(t)
    circle = np.stack([
        np.stack([RADIUS * np.sin(w * t), RADIUS * (1.0 - np.cos(w * t)), zero - 1000.0], 1),
        np.stack([V * np.cos(w * t), V * np.sin(w * t), zero], 1),
        np.stack([-V * w * np.sin(w * t), V * w * np.cos(w * t), zero], 1),
    ], 1)  # fmt: skip
    climb = np.stack([
        np.stack([160.0 * t + 0.25 * t**2, zero - 20_000.0, -2000.0 - 8.0 * t], 1),
        np.stack([160.0 + 0.5 * t, zero, zero - 8.0], 1),
        np.stack([zero + 0.5, zero, zero], 1),
    ], 1)  # fmt: skip
    weave = np.stack([
        np.stack([-140.0 * t - 9000.0, 4000.0 + 400.0 * np.sin(0.1 * t), zero - 3000.0], 1),
        np.stack([zero - 140.0, 40.0 * np.cos(0.1 * t), zero], 1),
        np.stack([zero, -4.0 * np.sin(0.1 * t), zero], 1),
    ], 1)  # fmt: skip
    return np.stack([circle, climb, weave])


def _case(motions, limits=None):
    end_positions = motions[:, -1, 0]
    goal_velocity = np.array([[5.0, -3.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    stand_off = np.tile([0.0, 0.0, -300.0], (3, 1))
    course = np.arctan2(motions[:, -1, 1, 1], motions[:, -1, 1, 0])
    ones = np.ones(3)
    limits = limits or FleetLimits(
        100 * ones, 220 * ones, 1.0 * ones, 30 * ones, 500 * ones, 5000 * ones, 2 * ones, 3 * ones, 3 * ones
    )
    return PlanCase(
        Starts(0.0, motions[:, 0, 0], motions[:, 0, 1], motions[:, 0, 2]),
        Goals(np.zeros((3, 1)), (end_positions - goal_velocity * LAST - stand_off)[:, None], goal_velocity, stand_off,
              np.where([True, True, False], course, np.nan), np.where([False, True, False], math.atan2(8.0, 190.0), np.nan)),
        limits,
        WindProfile(np.array([500.0, 2000.0, 4000.0]), np.array([[0.0, 0, 0], [6.0, -4.0, 0.0], [12.0, 3.0, 0.0]])),
        KeepOutCylinders(np.array([[9000.0, -9000.0]]), np.array([[0.0, 10.0]]), np.array([800.0]), np.array([0.0]), np.array([9000.0])),
        1000.0, 200.0,
        ArrivalRule("at", LAST * ones, np.full((3, 2), np.nan), math.nan, np.arange(3)),
        V, G,
    )  # fmt: skip


@pytest.fixture(scope="module")
def good():
    """Paths, task, arrival times and report of a plan without fault; a third of the path is booked as drift."""
    t = np.linspace(0.0, LAST, 61)
    motions = _motions(t)
    times = np.tile(t, (3, 1))
    # One empty cell, as padding leaves them.
    times, motions = np.insert(times, 30, times[:, 30], axis=1), np.insert(motions, 30, motions[:, 30], axis=1)
    share = np.array([1.0, 0.7, 0.0])[:, None, None, None]
    paths = Paths(times, share * motions, (1.0 - share) * motions)
    case, arrivals = _case(motions), np.full(3, LAST)
    return paths, case, arrivals, dense_check(paths, case, arrivals)


def _kinds(report):
    return {(breach.kind, breach.who) for breach in report.breaches}


def _ground(paths, change):
    air = paths.air_n.copy()
    change(air)
    return replace(paths, air_n=air)


def test_good_plan_passes(good):
    assert [str(breach) for breach in good[3].breaches] == []


def test_extremes_are_those_of_the_textbook(good):
    # Knots every second: the quintic misses a circle of 20 rad/s/1000 by (w h)^6/720 of its radius, 1e-8 m/s^2 and less.
    extremes = good[3].extremes
    t = np.arange(0.0, LAST + 5e-4, 1e-3)
    # Aircraft 0: wind at 1,000 m is (2, -4/3); a level circle over the ground, so the airspeed swings by the wind.
    wind = np.array([2.0, -4.0 / 3.0])
    north, east = V * np.cos(V / RADIUS * t) - wind[0], V * np.sin(V / RADIUS * t) - wind[1]
    speed = np.hypot(north, east)
    turning = V**2 / RADIUS
    side = turning * (V - wind[0] * np.cos(V / RADIUS * t) - wind[1] * np.sin(V / RADIUS * t)) / speed
    assert extremes["speed_min"][0] == pytest.approx(speed.min(), abs=1e-6)
    assert extremes["speed_max"][0] == pytest.approx(speed.max(), abs=1e-6)
    assert extremes["bank_max"][0] == pytest.approx(math.atan(side.max() / G), abs=1e-7)
    assert extremes["load_factor_max"][0] == pytest.approx(math.hypot(side.max(), G) / G, abs=1e-7)
    # Aircraft 1 climbs at 8 m/s through 2,000 to 2,480 m, headed north, faster by 0.5 m/s each second.
    height = 2000.0 + 8.0 * t
    head = 160.0 + 0.5 * t - (6.0 + 3.0e-3 * (height - 2000.0))
    cross = 4.0 - 3.5e-3 * (height - 2000.0)
    speed = np.sqrt(head**2 + cross**2 + 64.0)
    assert extremes["speed_max"][1] == pytest.approx(speed.max(), abs=1e-6)
    assert extremes["climb_rate_max"][1] == pytest.approx(8.0, abs=1e-9)
    assert extremes["altitude_max"][1] == pytest.approx(2480.0, abs=1e-9)
    assert extremes["acceleration_max"][1] == pytest.approx(((0.5 * head + G * 8.0) / speed).max(), abs=1e-7)
    # Aircraft 1 is straight over the ground: sideways force only where the air comes from the side.
    assert extremes["deceleration_max"][1] < 0.0


@pytest.mark.parametrize("limit", LIMITS)
def test_each_violated_limit_is_reported_by_name_and_only_there(good, limit):
    paths, case, arrivals, report = good
    sign = 1.0 if limit in ("speed_min", "altitude_min") else -1.0
    at = report.extremes[limit].copy()
    satisfied_case = replace(case, limits=replace(case.limits, **{limit: at}))
    assert dense_check(paths, satisfied_case, arrivals, 0.01).passes
    excess = 5.0 * Tolerances().of_limit(limit)
    broken = at.copy()
    broken[1] += sign * excess
    report_broken = dense_check(paths, replace(case, limits=replace(case.limits, **{limit: broken})), arrivals)
    assert _kinds(report_broken) == {(limit, (1,))}
    # The same extreme at the same samples: nothing but rounding between.
    assert report_broken.breaches[0].amount == pytest.approx(excess, rel=1e-6)


def test_a_spike_between_two_milliseconds_is_found(good):
    paths, case, arrivals, _ = good
    # Three knots within 0.4 ms: the middle one's acceleration is 30 m/s^2, and no millisecond lies between.
    times, knots = paths.times[:, :], paths.air_n + paths.drift_n
    inside = 10.0 + 1e-3 * np.array([0.3, 0.5, 0.7])
    extra = _motions(inside)
    extra[0, 1, 2, 2] += 30.0
    times = np.insert(times, [11] * 3, inside, axis=1)
    knots = np.insert(knots, [11] * 3, extra, axis=1)
    report = dense_check(Paths(times, knots, np.zeros_like(knots)), case, arrivals)
    assert ("load_factor_max", (0,)) in _kinds(report)
    without = dense_check(
        Paths(times, np.insert(paths.air_n + paths.drift_n, [11] * 3, _motions(inside), axis=1), 0.0 * knots),
        case,
        arrivals,
    )
    assert without.passes


@pytest.mark.parametrize(("order", "kind"), list(enumerate(["position", "velocity", "acceleration"])))
def test_a_jump_in_an_empty_cell_is_found(good, order, kind):
    paths, case, arrivals, _ = good

    def jump(air):
        air[2, 31:, 0] += np.array([0.0, 0.01, 0.0]) * (order == 0)
        air[2, 31, order, 1] += 0.01 * (order > 0)

    assert (f"jump_{kind}", (2,)) in _kinds(dense_check(_ground(paths, jump), case, arrivals))


@pytest.mark.parametrize("field", ["position_n", "velocity_n", "acceleration_n"])
def test_a_wrong_start_is_found(good, field):
    paths, case, arrivals, _ = good
    moved = getattr(case.starts, field).copy()
    moved[1, 2] += 0.01
    report = dense_check(paths, replace(case, starts=replace(case.starts, **{field: moved})), arrivals)
    assert _kinds(report) == {(f"start_{field[:-2]}", (1,))}


def test_a_late_start_is_found(good):
    paths, case, arrivals, _ = good
    report = dense_check(replace(paths, times=paths.times + 0.01), case, arrivals + 0.01)
    assert {("start_time", (0,)), ("start_time", (1,)), ("start_time", (2,))} <= _kinds(report)


def test_arrival_faults_are_found(good):
    paths, case, arrivals, _ = good
    goals = case.goals
    moved = goals.positions_n.copy()
    moved[2, 0, 0] += 0.01
    assert _kinds(dense_check(paths, replace(case, goals=replace(goals, positions_n=moved)), arrivals)) == {
        ("arrival_position", (2,))
    }
    course = goals.course + np.array([0.001, math.pi, 0.0])
    assert _kinds(dense_check(paths, replace(case, goals=replace(goals, course=course)), arrivals)) == {
        ("arrival_course", (0,)),
        ("arrival_course", (1,)),
    }
    whole_turn = replace(case, goals=replace(goals, course=goals.course + 2.0 * math.pi))
    assert dense_check(paths, whole_turn, arrivals, 0.1).passes
    angle = replace(case, goals=replace(goals, path_angle=goals.path_angle + 0.001))
    assert _kinds(dense_check(paths, angle, arrivals)) == {("arrival_path_angle", (1,))}
    # Claimed 10 ms later: not the path's end, not where the goal is then, and not the time asked for.
    late = dense_check(paths, case, arrivals + np.array([0.0, 0.0, 0.01]))
    assert _kinds(late) == {(kind, (2,)) for kind in ("arrival_time", "arrival_position", "arrival_rule")}


def _rule(name, times=NAN3, windows=None, spacing=math.nan, order=(0, 1, 2)):
    return ArrivalRule(
        name,
        np.array(times, dtype=float),
        np.full((3, 2), np.nan) if windows is None else np.array(windows),
        spacing,
        np.array(order),
    )


@pytest.mark.parametrize(
    ("rule", "late"),
    [
        (_rule("together"), set()),
        (_rule("earliest"), set()),
        (_rule("at", [60.0, 60.0, 60.0]), set()),
        (_rule("at", [60.0, 60.0, 60.002]), {2}),
        (_rule("times", [60.0, 59.0, 60.0]), {1}),
        (_rule("windows", windows=[[50.0, 70.0], [60.0, 60.0], [0.0, 59.99]]), {2}),
        (_rule("windows", windows=[[60.01, 70.0], [60.0, 60.0], [0.0, 70.0]]), {0}),
        (_rule("sequence", spacing=10.0, order=(2, 0, 1)), {0, 1}),
        (_rule("sequence", spacing=0.0), set()),
    ],
)  # fmt: skip
def test_arrival_rules(good, rule, late):
    paths, case, arrivals, _ = good
    assert _kinds(dense_check(paths, replace(case, rule=rule), arrivals, 0.1)) == {("arrival_rule", (k,)) for k in late}


def test_sequence_in_its_order_passes(good):
    paths, case, _, _ = good
    # Cut one second and two off two paths: knots lie on whole seconds.
    times, air, drift = paths.times.copy(), paths.air_n.copy(), paths.drift_n.copy()
    for aircraft, cut in ((0, 2), (2, 1)):
        for part in (times, air, drift):
            part[aircraft, -cut:] = part[aircraft, -cut - 1]
    arrivals = times[:, -1]
    end_positions = (air + drift)[:, -1, 0]
    goals = replace(
        case.goals,
        positions_n=(end_positions - case.goals.velocity_after_n * arrivals[:, None] - case.goals.stand_off_n)[:, None],
        course=NAN3,
    )
    task = replace(case, goals=goals, rule=_rule("sequence", spacing=1.0, order=(0, 2, 1)))
    assert dense_check(Paths(times, air, drift), task, arrivals, 0.1).passes
    wrong = replace(task, rule=_rule("sequence", spacing=1.0, order=(2, 0, 1)))
    assert {kind for kind, _ in _kinds(dense_check(Paths(times, air, drift), wrong, arrivals, 0.1))} == {"arrival_rule"}


def test_separation_is_that_of_two_straight_lines(good):
    # Crossing at right angles, 90 m below: one is 1,200 m late at the crossing, so 1,200 m / sqrt 2 apart at the nearest.
    t = np.linspace(0.0, 40.0, 9)
    knots = np.zeros((2, 9, 3, 3))
    knots[0, :, 0] = np.stack([100.0 * t - 2000.0, 0.0 * t, 0.0 * t - 1000.0], 1)
    knots[1, :, 0] = np.stack([0.0 * t, 100.0 * t - 3200.0, 0.0 * t - 1090.0], 1)
    knots[0, :, 1, 0] = knots[1, :, 1, 1] = 100.0
    cells = [path_cells(t, k) for k in knots]
    grid = np.arange(0.0, 40.0, 1e-3)
    blocks = [chord_blocks(c.at(grid)[:3]) for c in cells]
    closest = least_clearances(cells, blocks, np.array([40.0, 40.0]), (1000.0, 400.0), 0.0, 1e-3)
    assert closest.time[0] == pytest.approx(26.0, abs=1e-3)
    # Flat at the nearest point: within half a millisecond the distance changes by 1e-6 m.
    assert closest.horizontal[0] == pytest.approx(1200.0 / math.sqrt(2.0), abs=1e-5)
    assert closest.clearance[0] == pytest.approx(1200.0 / math.sqrt(2.0) - 1000.0, abs=1e-5)
    # Once one has arrived the pair is no longer looked at.
    early = least_clearances(cells, blocks, np.array([20.0, 40.0]), (1000.0, 400.0), 0.0, 1e-3)
    assert early.time[0] == pytest.approx(20.0)
    assert early.horizontal[0] == pytest.approx(1200.0)


@pytest.mark.parametrize("seed", range(6))
def test_pruned_separation_equals_the_minimum_over_the_samples(seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 6.0, 12))
    t = (t - t[0]) * rng.uniform(0.7, 1.0)
    knots = np.zeros((4, 12, 3, 3))
    knots[:, :, 1] = rng.uniform(-200.0, 200.0, (4, 1, 3)) + rng.normal(0.0, 40.0, (4, 12, 3))
    knots[:, 1:, 0] = np.cumsum(0.5 * (knots[:, 1:, 1] + knots[:, :-1, 1]) * np.diff(t)[:, None], axis=1)
    knots[:, :, 0] += rng.normal(0.0, 300.0, (4, 1, 3))
    knots[:, :, 2] = rng.normal(0.0, 8.0, (4, 12, 3))
    cells = [path_cells(t, k) for k in knots]
    grid = np.arange(int(t[-1] / 1e-3) + 1) * 1e-3
    positions = [c.at(grid)[:3] for c in cells]
    arrivals = t[-1] * np.array([1.0, 0.9, 0.37, 1.0])
    sizes = (rng.uniform(0.0, 600.0), rng.uniform(0.0, 300.0))
    closest = least_clearances(cells, [chord_blocks(p) for p in positions], arrivals, sizes, 0.0, 1e-3)
    for pair, (i, j) in enumerate(zip(closest.first, closest.second, strict=True)):
        end = min(arrivals[i], arrivals[j])
        rel = (positions[i] - positions[j])[:, grid <= end]
        whole = np.maximum(np.hypot(rel[0], rel[1]) - sizes[0], np.abs(rel[2]) - sizes[1])
        # The end itself is one more sample: at most the least of all the others, less what 1 ms of 1 km/s changes.
        assert whole.min() - 1.0 <= closest.clearance[pair] <= whole.min() + 1e-6
        if closest.time[pair] < end:
            assert closest.clearance[pair] == pytest.approx(whole.min(), abs=1e-6 + 1e-9)


def test_lost_separation_is_found(good):
    paths, case, arrivals, report = good
    nearest = int(np.argmin(report.pairs.horizontal))
    wide = float(report.pairs.horizontal[nearest])
    pair = (int(report.pairs.first[nearest]), int(report.pairs.second[nearest]))
    tall = replace(case, separation_vertical=4000.0)
    assert dense_check(paths, replace(tall, separation_horizontal=wide), arrivals).passes
    lost = dense_check(paths, replace(tall, separation_horizontal=wide + 0.01), arrivals)
    assert _kinds(lost) == {("separation", pair)}
    assert lost.breaches[0].amount == pytest.approx(0.01, abs=1e-5)
    # One above the other is enough.
    assert dense_check(
        paths, replace(case, separation_horizontal=wide + 0.01, separation_vertical=200.0), arrivals
    ).passes


def test_entered_keep_outs_at_rest_and_in_motion_are_found(good):
    paths, case, arrivals, report = good
    keep_outs = case.keep_outs
    touched = replace(keep_outs, radius=keep_outs.radius + report.keep_out_clearance[:, 0].min() + 0.01)
    report_touched = dense_check(paths, replace(case, keep_outs=touched), arrivals)
    assert {kind for kind, _ in _kinds(report_touched)} == {"keep_out"}
    assert len(report_touched.breaches) == 1
    # Flies with aircraft 1 from 500 m behind at 10 m/s more: it is reached after 50 s less the radius.
    chaser = KeepOutCylinders(
        np.array([[-500.0, -20_000.0]]),
        np.array([[185.0, 0.0]]),
        np.array([100.0]),
        np.array([0.0]),
        np.array([9000.0]),
    )
    assert ("keep_out", (1, 0)) in _kinds(dense_check(paths, replace(case, keep_outs=chaser), arrivals))
    low = replace(chaser, top=np.array([1999.9]))
    assert dense_check(paths, replace(case, keep_outs=low), arrivals).passes


def test_a_plan_with_nan_does_not_pass(good):
    paths, case, arrivals, _ = good

    def hole(air):
        air[1, 7, 1, 0] = np.nan

    assert _kinds(dense_check(_ground(paths, hole), case, arrivals)) == {("unusable", (1,))}
    assert _kinds(dense_check(paths, case, arrivals * np.array([1.0, 1.0, np.nan]))) == {("unusable", (2,))}
    back = paths.times.copy()
    back[0, 5] -= 2.0
    assert _kinds(dense_check(replace(paths, times=back), case, arrivals)) == {("unusable", (0,))}


def test_rounding_in_a_short_cell_is_no_acceleration(good):
    # Positions of 2e4 m are rounded to 4e-12 m: over 10 us that would read as 2 m/s^2.
    paths, case, arrivals, _ = good
    close = 20.0 + np.array([1e-5, 1e-3 + 1e-7])
    knots = np.insert(paths.air_n + paths.drift_n, [21] * 2, _motions(close), axis=1)
    times = np.insert(paths.times, [21] * 2, close, axis=1)
    assert dense_check(Paths(times, knots, 0.0 * knots), case, arrivals).passes


def test_wind_error_is_the_difference_of_drift_and_wind(good):
    # Aircraft 0 books nothing as drift: the error is the wind at 1,000 m.
    assert good[3].wind_error[0] == pytest.approx(math.hypot(2.0, 4.0 / 3.0), abs=1e-9)


def test_a_plan_for_another_fleet_is_refused(good):
    paths, case, arrivals, _ = good
    with pytest.raises(ValueError, match="plan: arrived 3 paths and 2 arrival times; expected 3 of each"):
        dense_check(paths, case, arrivals[:2])
