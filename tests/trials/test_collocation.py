"""Direct collocation: equations against the dense check, derivatives against differences, and flown solutions."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from trials.cases import random_case
from trials.check import dense_check
from trials.collocation import Encounter, Obstacle, solve_flights
from trials.data import Paths
from trials.elements import Kind, Program
from trials.flight import HINGE_M, Flight, air_velocity, smooth_wind
from trials.motion import path_cells, path_demands
from trials.report import LIMITS
from trials.sampled_flights import sample_flight

SEED = 0  # six aircraft, wind in four layers, courses and path angles at arrival, a common time


def _flight(aircraft=0, arrival=201.3):
    return Flight.of(random_case(SEED), aircraft, arrival)


def _solve(flight, obstacles=(), start=None):
    if start is not None:
        return solve_flights([flight], [start], [list(obstacles)], [], 200)
    random = np.random.default_rng(1)
    tries = (solve_flights([flight], [sample_flight(flight, random, [])], [[]], [], 200) for _ in range(5))
    return next(solution for solution in tries if solution.feasible)


def test_forces_of_the_unknowns_agree_with_the_dense_check():
    flight = _flight()
    rng = np.random.default_rng(3)
    x = sample_flight(flight, rng, []) * rng.uniform(0.99, 1.01, flight.unknowns)
    nodes, mids = flight.split(x)
    path = flight.path(x)
    case = flight.case
    wind = smooth_wind(case.wind, -nodes[2])
    demands = path_demands(path.velocity, path.acceleration, wind, case.gravity)
    np.testing.assert_allclose(demands.speed, nodes[3], rtol=1e-12)
    np.testing.assert_allclose(demands.climb_rate, nodes[3] * np.sin(nodes[4]), atol=1e-10)
    for demand, unknown in zip((demands.along, demands.side, demands.normal), nodes[6:], strict=True):
        np.testing.assert_allclose(demand, unknown, atol=1e-10)
    assert mids.shape == (6, flight.intervals)


def test_smooth_wind_differs_from_the_wind_only_near_the_layers():
    wind = next(case.wind for case in map(random_case, range(100)) if case.wind.altitudes.size == 4)
    altitude = np.linspace(0.0, 8000.0, 4001)
    difference = np.linalg.norm(smooth_wind(wind, altitude) - wind.at(altitude), axis=0)
    slopes = np.linalg.norm(np.diff(wind.velocities_n, axis=0), axis=1) / np.diff(wind.altitudes)
    assert difference.max() < 2.0 * HINGE_M * slopes.max()
    away_from_layers = np.min(np.abs(altitude - wind.altitudes[:, None]), axis=0) > 100.0
    assert difference[away_from_layers].max() < 0.1 * HINGE_M * slopes.max()


def test_a_solution_is_one_smooth_path_for_the_dense_check():
    flight = _flight()
    solved = _solve(flight)
    path = flight.path(solved.unknowns[0])
    times, knots = path.knots()
    # The quintic through both ends of each interval is the quartic that was solved: places in between and middles agree.
    within = np.linspace(times[0], times[-1], 997)
    np.testing.assert_allclose(path_cells(times, knots).at(within)[:3], path.at(within), atol=1e-4)
    middles = 0.5 * (times[1:] + times[:-1])
    _, mids = flight.split(solved.unknowns[0])
    motion = path_cells(times, knots).at(middles)
    np.testing.assert_allclose(
        motion[3:6], air_velocity(*mids[:3]) + smooth_wind(flight.case.wind, -motion[2]), atol=1e-4
    )  # 1e-8 of 50 m/s, and what quintics amplify
    np.testing.assert_allclose(motion[6:9], path.middle, atol=1e-4)


@pytest.mark.parametrize("aircraft", range(6))
def test_a_solution_keeps_all_limits_of_its_aircraft(aircraft):
    flight = _flight(aircraft)
    solved = _solve(flight)
    alone = _single_case(flight.case, aircraft)
    for _ in range(4):
        times, knots = flight.path(solved.unknowns[0]).knots()
        report = dense_check(Paths(times[None], knots[None], 0.0 * knots[None]), alone, times[-1:])
        if not any(breach.kind in LIMITS for breach in report.breaches):
            break
        path = flight.path(solved.unknowns[0])
        flight = flight.tightened({limit: float(values[0]) for limit, values in report.excess.items()})
        solved = _solve(flight, start=flight.unknowns_of(path))
    assert {breach.kind for breach in report.breaches} <= {"keep_out", "arrival_rule"}


def test_intervals_are_halved_for_a_large_excess_without_a_change_of_the_path():
    flight = _flight()
    x = _solve(flight).unknowns[0]
    little, much = (dict.fromkeys(LIMITS, 0.0) | {"bank_max": by} for by in (0.005, 0.2))
    assert flight.tightened(little).margins.bank == pytest.approx(flight.margins.bank + 1.3 * 0.005)
    finer = flight.tightened(much)
    assert finer.intervals == 2 * flight.intervals
    times = np.linspace(0.0, flight.arrival, 500)
    path, resampled = flight.path(x), finer.path(finer.unknowns_of(flight.path(x)))
    for order in range(3):
        np.testing.assert_allclose(resampled.at(times, order), path.at(times, order), atol=1e-5)
    np.testing.assert_allclose(flight.unknowns_of(path), x, atol=1e-5)


def _single_case(case, aircraft):
    """The case with a single aircraft."""

    def select(group):
        fields = {k: v for k, v in vars(group).items() if isinstance(v, np.ndarray)}
        return replace(group, **{k: v[aircraft : aircraft + 1] for k, v in fields.items()})

    rule = replace(select(case.rule), order=np.zeros(1, dtype=int))
    return replace(case, starts=select(case.starts), goals=select(case.goals), limits=select(case.limits), rule=rule)


def test_limits_hold_at_nodes_and_middles():
    flight = _flight(3)
    solved = _solve(flight)
    L, aircraft = flight.case.limits, flight.aircraft
    nodes, mids = flight.split(solved.unknowns[0])
    for V, gamma, side, normal in ((nodes[3], nodes[4], nodes[7], nodes[8]), (mids[0], mids[1], mids[4], mids[5])):
        assert np.all((L.speed_min[aircraft] < V) & (L.speed_max[aircraft] > V))
        assert np.all(np.abs(np.arctan2(side, normal)) < L.bank_max[aircraft])
        assert np.all(np.hypot(side, normal) < L.load_factor_max[aircraft] * flight.case.gravity)
        assert np.all(np.abs(V * np.sin(gamma)) < L.climb_rate_max[aircraft])


@pytest.mark.parametrize("half", [np.inf, 150.0])
def test_a_cylinder_in_the_way_is_flown_around_or_over(half):
    flight = _flight(arrival=260.0)  # time enough for a way around
    unobstructed = _solve(flight)
    path = flight.path(unobstructed.unknowns[0])
    times = np.arange(100.0, 160.0, 0.5)
    # Not with its axis on the path: left and right would be alike.
    centre = np.repeat(path.at(np.array([130.0])) + np.array([[200.0], [100.0], [20.0]]), times.size, axis=1)
    solved = _solve(flight, [Obstacle(times, centre, 800.0, half)], unobstructed.unknowns[0])
    assert solved.feasible
    offset = flight.path(solved.unknowns[0]).at(times) - centre
    outside = np.hypot(offset[0], offset[1]) / 800.0
    if np.isfinite(half):
        outside = np.maximum(outside, np.abs(offset[2]) / half)
    assert outside.min() >= 1.0 - 1e-6
    initial_ratio = np.hypot(*(path.at(times) - centre)[:2]) / 800.0
    assert initial_ratio.min() < 1.0  # it was in the way


@pytest.mark.long
def test_two_flights_are_separated():
    flight = _flight()
    solution = _solve(flight)
    times = np.arange(60.0, 150.0, 0.5)
    # The second one starts at the same place, but is looked at from 60 s on only.
    x = solution.unknowns[0]
    solved = solve_flights([flight, flight], [x, x * 1.0001], [[], []], [Encounter(0, 1, times, 300.0, 150.0)], 200)
    assert solved.feasible
    a, b = (flight.path(unknowns).at(times) for unknowns in solved.unknowns)
    ratio = np.maximum(np.hypot(*(a - b)[:2]) / 300.0, np.abs((a - b)[2]) / 150.0)
    assert ratio.min() >= 1.0 - 1e-6


def test_an_impossible_flight_is_not_feasible():
    flight = _flight(arrival=20.0)  # more than ten kilometres to go
    assert not _solve(flight, start=sample_flight(flight, np.random.default_rng(1), [])).feasible


def test_sampled_flights_differ_between_the_prescribed_start_and_the_rendezvous():
    flight = _flight()
    rng = np.random.default_rng(0)
    samples = [sample_flight(flight, rng, []) for _ in range(4)]
    low, high = flight.bounds()
    fixed = low == high
    for x in samples:
        np.testing.assert_allclose(x[fixed][:6], low[fixed][:6], atol=0.05)
        end = flight.split(x)[0][:3, -1]
        assert np.linalg.norm(end - flight.case.goals.meeting_n(0, np.array([201.3]))[0]) < 1e-6
    assert np.linalg.norm(samples[0] - samples[1]) > 100.0


def test_derivatives_of_a_program_are_those_of_its_formulas():
    """Elements with shared unknowns, in both orders: the solver's minimum is that of the whole program."""
    kind = Kind(2, 1, lambda z, p: (ca.vertcat(z[0] * z[1] - p[0]), (z[0] - 3.0 * z[1]) ** 2))
    program = Program()
    program.add_unknowns(np.array([1.0, 2.0, 1.5]), np.full(3, 0.1), np.full(3, 50.0))
    index, parameters = np.array([[0, 1], [2, 1], [2, 0]]), np.array([[2.0], [3.0], [6.0]])
    program.add(kind, index, parameters, np.zeros(1), np.zeros(1))
    solved = program.solve(100)
    # x0 x1 = 2, x2 x1 = 3, x2 x0 = 6: x0 = 2, x1 = 1, x2 = 3.
    assert solved.feasible
    np.testing.assert_allclose(solved.x, [2.0, 1.0, 3.0], rtol=1e-6)
    assert solved.iterations < 15  # Newton's; a wrong derivative takes many or fails


def test_the_assembled_jacobian_and_hessian_of_a_program_are_correct():
    kind = Kind(2, 1, lambda z, p: (ca.vertcat(ca.sin(z[0]) * z[1] ** 2 * p[0]), ca.exp(z[0]) * z[1]))
    program = Program()
    program.add_unknowns(np.ones(3), np.zeros(3), np.ones(3))
    index, parameters = np.array([[0, 1], [2, 1], [2, 0]]), np.array([[2.0], [3.0], [6.0]])
    program.add(kind, index, parameters, np.zeros(1), np.zeros(1))
    x = ca.MX.sym("x", 3)
    derived = program.derivatives(x)
    formulas = [
        (ca.sin(x[i]) * x[j] ** 2 * p, ca.exp(x[i]) * x[j]) for (i, j), (p,) in zip(index, parameters, strict=True)
    ]
    g, f = ca.vertcat(*(formula[0] for formula in formulas)), sum(formula[1] for formula in formulas)
    cost_weight, multipliers = 0.7, ca.DM([0.3, -1.1, 2.0])
    hessian = ca.triu(ca.hessian(cost_weight * f + ca.dot(multipliers, g), x)[0])
    point = np.array([0.4, 1.3, -0.6])
    expected = ca.Function("expected", [x], [f, ca.gradient(f, x), g, ca.jacobian(g, x), hessian])(point)
    assembled = [
        *derived["grad_f"](point, []),
        *derived["jac_g"](point, []),
        derived["hess_lag"](point, [], cost_weight, multipliers),
    ]
    for value, reference in zip(assembled, expected, strict=True):
        np.testing.assert_allclose(np.asarray(ca.densify(value)), np.asarray(ca.densify(reference)), atol=1e-12)
