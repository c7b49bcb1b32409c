"""Direct collocation of one or several flights (Hermite-Simpson)."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float, Int

from trials.data import WindProfile
from trials.elements import Kind, Program
from trials.flight import HINGE_M, MID, NODE, Flight

__all__ = ["Encounter", "Obstacle", "Solution", "solve_flights"]

_SCALE = np.array([1000.0, 1000.0, 1000.0, 50.0, 0.3, 1.0, 3.0, 10.0, 10.0])
"""Unit of each unknown within the solver, in the order of NODE."""
_SMOOTH = 1e-3
"""Weight of the regularisation: forces per gravity, and a middle's deviation from the mean of its nodes."""
_FAR = 1e20
_LOCAL = 2 * len(NODE) + len(MID)
"""Unknowns of an interval: node, middle, next node."""


class Obstacle(NamedTuple):
    """Upright cylinder to stay out of at some times: a keep-out, or the separation from a known path."""

    times: Float[np.ndarray, " time"]
    """s."""
    centre: Float[np.ndarray, "3 time"]
    """NED, m."""
    radius: float
    """m."""
    half_height: float
    """m; infinite where there is no way above or below."""


class Encounter(NamedTuple):
    """Two flights, by their places in the list, that must be apart at some times."""

    one: int
    other: int
    times: Float[np.ndarray, " time"]
    """s."""
    radius: float
    """m."""
    half_height: float
    """m."""


@dataclass(frozen=True)
class Solution:
    """What the solver ended with."""

    unknowns: list[Float[np.ndarray, " unknown"]]
    """Of each flight."""
    feasible: bool
    iterations: int
    violation: float
    """Greatest scaled violation of a constraint."""


def solve_flights(
    flights: Sequence[Flight],
    starts: Sequence[Float[np.ndarray, " unknown"]],
    obstacles: Sequence[Sequence[Obstacle]],
    encounters: Sequence[Encounter],
    iterations: int,
) -> Solution:
    """Look for flights that meet all constraints, together.

    Parameters
    ----------
    flights
        What is asked of each.
    starts
        Unknowns to start from.
    obstacles
        Of each flight.
    encounters
        Between flights.
    iterations
        Of the solver, at most.
    """
    program = Program()
    index = [_add_flight(program, f, x) for f, x in zip(flights, starts, strict=True)]
    paths = [f.path(x) for f, x in zip(flights, starts, strict=True)]
    wind = _wind_parameters(flights[0].case.wind)
    gravity = flights[0].case.gravity
    for k, mine in enumerate(obstacles):
        for one in mine:
            at, share = _intervals(flights[k], one.times)
            between = paths[k].at(one.times) - one.centre
            given = [np.full(share.size, flights[k].width), share, *one.centre]
            _keep_apart(program, False, gravity, index[k][at], given, wind, between, one.radius, one.half_height)
    for one in encounters:
        a, b = one.one, one.other
        (at, share), (there, other) = _intervals(flights[a], one.times), _intervals(flights[b], one.times)
        given = [np.full(share.size, flights[a].width), share, np.full(share.size, flights[b].width), other]
        between = paths[a].at(one.times) - paths[b].at(one.times)
        both = np.concatenate([index[a][at], index[b][there]], axis=1)
        _keep_apart(program, True, gravity, both, given, wind, between, one.radius, one.half_height)
    solved = program.solve(iterations)
    found, first = [], 0
    for flight, x0 in zip(flights, starts, strict=True):
        found.append(solved.x[first : first + x0.size] * _scales(flight))
        first += x0.size
    return Solution(found, solved.feasible, solved.iterations, solved.violation)


def _scales(flight: Flight) -> Float[np.ndarray, " unknown"]:
    return np.concatenate([np.tile(_SCALE, flight.intervals + 1), np.tile(_SCALE[3:], flight.intervals)])


def _intervals(
    flight: Flight, times: Float[np.ndarray, " time"]
) -> tuple[Int[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Interval in which each time lies, and the share of it that has passed."""
    share = np.clip((times - flight.case.starts.time) / flight.width, 0.0, flight.intervals)
    at = np.minimum(share.astype(int), flight.intervals - 1)
    return at, share - at


def _add_flight(
    program: Program, flight: Flight, start: Float[np.ndarray, " unknown"]
) -> Int[np.ndarray, "interval local"]:
    """Add unknowns and constraints of one flight; return the unknowns of each interval."""
    scale, case, who, m = _scales(flight), flight.case, flight.who, flight.margins
    L, count = case.limits, flight.intervals
    low, high = flight.bounds()
    x = program.add_unknowns(start / scale, low / scale, high / scale)
    nodes, mids = flight.split(x)
    index = np.concatenate([nodes[:, :-1], mids, nodes[:, 1:]]).T
    lift = (float(L.load_factor_max[who]) - m.load_factor) * case.gravity
    tan_bank, climb = np.tan(float(L.bank_max[who]) - m.bank), float(L.climb_rate_max[who]) - m.climb_rate
    wind, layers = _wind_parameters(case.wind), case.wind.altitudes.size
    given = np.concatenate([[flight.width, tan_bank, lift**2, climb, case.gravity, 1.0 / count], wind])
    floor, ceiling = (L.altitude_min[who] + m.altitude) / 1000.0, (L.altitude_max[who] - m.altitude) / 1000.0
    slower, faster = m.along - L.deceleration_max[who], L.acceleration_max[who] - m.along
    least = np.array([0.0] * 9 + [floor] + [0.0] * 10 + [slower, 0.0, 0.0, 0.0] * 2)
    most = np.array([0.0] * 9 + [ceiling] + [_FAR] * 10 + [faster, _FAR, _FAR, _FAR] * 2)
    program.add(_interval_kind(layers), index, np.tile(given, (count, 1)), least, most)
    course, angle = float(case.goals.course[who]), float(case.goals.path_angle[who])
    last, wind = nodes[:, -1:].T, wind[None]
    if np.isfinite(course):
        given = np.concatenate([[[np.cos(course), np.sin(course)]], wind], axis=1)
        program.add(_course_kind(layers), last, given, np.array([0.0, 0.01]), np.array([0.0, _FAR]))
    if np.isfinite(angle):
        given = np.concatenate([[[np.cos(angle), np.sin(angle)]], wind], axis=1)
        program.add(_angle_kind(layers), last, given, np.zeros(1), np.zeros(1))
    return index


def _keep_apart(
    program: Program,
    two: bool,
    gravity: float,
    index: Int[np.ndarray, "time local"],
    given: list[Float[np.ndarray, " time"]],
    wind: Float[np.ndarray, " wind"],
    between: Float[np.ndarray, "3 time"],
    radius: float,
    half_height: float,
) -> None:
    """Constraint of being outside a cylinder, beside it or above or below it.

    Either excess may be negative if the other is not: their mean with a weight of 0 to 1, an unknown of its own at each
    time, is positive for some weight exactly where one of them is.
    """
    size = np.tile([radius, min(half_height, 1e6), gravity], (len(index), 1))
    flat = np.isinf(half_height)
    excess = np.stack([np.hypot(between[0], between[1]) / radius, np.abs(between[2]) / size[:, 1]]) - 1.0
    start = np.where((excess[1] > excess[0]) & ~flat, 0.9, 0.0 if flat else 0.1)
    weight = program.add_unknowns(start, np.zeros(start.size), np.full(start.size, 0.0 if flat else 1.0))
    parameters = np.concatenate([np.stack(given, axis=1), size, np.tile(wind, (len(index), 1))], axis=1)
    kind = _apart_kind(wind.size // 4, two)
    program.add(kind, np.concatenate([index, weight[:, None]], axis=1), parameters, np.zeros(1), np.full(1, _FAR))


def _wind_parameters(wind: WindProfile) -> Float[np.ndarray, " wind"]:
    return np.concatenate([wind.altitudes, wind.velocities_n.ravel()])


def _blowing(layers: int, parameters: Any, altitude: Any) -> Any:
    """Wind as a sum of smooth hinges: linear between layers, steady beyond; as `trials.flight.smooth_wind`."""
    levels, winds = parameters[:layers], ca.reshape(parameters[layers:], 3, layers)
    wind = winds[:, 0]
    for k in range(layers - 1):
        low, high = (altitude - levels[k + i] for i in range(2))
        passed = 0.5 * (low + ca.sqrt(low**2 + HINGE_M**2) - high - ca.sqrt(high**2 + HINGE_M**2))
        wind = wind + (winds[:, k + 1] - winds[:, k]) * passed / (levels[k + 1] - levels[k])
    return wind


def _air(V: Any, gamma: Any, chi: Any) -> Any:
    return V * ca.vertcat(ca.cos(gamma) * ca.cos(chi), ca.cos(gamma) * ca.sin(chi), -ca.sin(gamma))


def _acceleration(rows: Any, gravity: Any) -> Any:
    """Newton's second law: force per mass along the air path, to its side and across it, and gravity."""
    gamma, chi, along, side, normal = (rows[k] for k in range(5))
    sg, cg, sc, cc = ca.sin(gamma), ca.cos(gamma), ca.sin(chi), ca.cos(chi)
    return ca.vertcat(
        along * cg * cc - side * sc - normal * sg * cc,
        along * cg * sc + side * cc - normal * sg * sc,
        gravity - along * sg - normal * cg,
    )


class _Interval:
    """Path in an interval: the acceleration is quadratic through both nodes and the middle."""

    def __init__(self, local: Any, width: Any, gravity: Any, layers: int, wind: Any) -> None:
        self.begin, self.end = local[: len(NODE)] * _SCALE, local[-len(NODE) :] * _SCALE
        self.middle = local[len(NODE) : len(NODE) + len(MID)] * _SCALE[3:]
        ends = (self.begin, self.end)
        self.v = [_air(z[3], z[4], z[5]) + _blowing(layers, wind, -z[2]) for z in ends]
        self.a = [_acceleration(rows, gravity) for rows in (self.begin[4:], self.middle[1:], self.end[4:])]
        self.width = width

    def place(self, share: Any) -> Any:
        """Position after a share of the interval, NED, m."""
        s, h, a = share, self.width, self.a
        bent = (s**2 / 2 - s**3 / 2 + s**4 / 6) * a[0] + (2 * s**3 / 3 - s**4 / 3) * a[1] + (s**4 / 6 - s**3 / 6) * a[2]
        return self.begin[:3] + h * s * self.v[0] + h**2 * bent


@functools.cache
def _interval_kind(layers: int) -> Kind:
    """Defects of position, velocity and mid velocity; middle altitude; limits at middle, end and quarters."""

    def formula(z: Any, p: Any) -> tuple[Any, Any]:
        h, tan_bank, lift_square, climb, gravity, share = (p[k] for k in range(6))
        one = _Interval(z, h, gravity, layers, p[6:])
        a, half = one.a, one.place(0.5)
        v_half = one.v[0] + h * (5.0 * a[0] + 8.0 * a[1] - a[2]) / 24.0
        rows = [
            (one.end[:3] - one.place(1.0)) / 1000.0,
            (one.v[1] - one.v[0] - h * (a[0] + 4.0 * a[1] + a[2]) / 6.0) / 50.0,
            (_air(one.middle[0], one.middle[1], one.middle[2]) + _blowing(layers, p[6:], -half[2]) - v_half) / 50.0,
            -half[2] / 1000.0,
        ]
        for at in (one.middle, one.end[3:]):
            V, gamma, side, normal = at[0], at[1], at[4], at[5]
            rows += [
                (tan_bank * normal - side) / 10.0,
                (tan_bank * normal + side) / 10.0,
                (lift_square - side**2 - normal**2) / 100.0,
                (climb - V * ca.sin(gamma)) / 10.0,
                (climb + V * ca.sin(gamma)) / 10.0,
            ]
        # Between them the forces are those interpolated, but for the turning of the axes.
        for q in ((0.375, 0.75, -0.125), (-0.125, 0.75, 0.375)):
            force = q[0] * one.begin[6:] + q[1] * one.middle[3:] + q[2] * one.end[6:]
            rows += [
                force[0],
                (tan_bank * force[2] - force[1]) / 10.0,
                (tan_bank * force[2] + force[1]) / 10.0,
                (lift_square - force[1] ** 2 - force[2] ** 2) / 100.0,
            ]
        bow = (one.middle[3:] - 0.5 * (one.begin[6:] + one.end[6:])) / gravity
        level = ca.vertcat(one.middle[3], one.middle[4], one.middle[5] - gravity) / gravity
        return ca.vertcat(*rows), _SMOOTH * share * (ca.sumsqr(bow) + ca.sumsqr(level))

    return Kind(_LOCAL, 6 + 4 * layers, formula)


@functools.cache
def _apart_kind(layers: int, two: bool) -> Kind:
    """Weighted excess over radius and half height: of a flight and a known place, or of two flights."""

    def formula(z: Any, p: Any) -> tuple[Any, Any]:
        wind, gravity = p[-4 * layers :], p[-4 * layers - 1]
        radius, half_height = p[-4 * layers - 3], p[-4 * layers - 2]
        here = _Interval(z[:_LOCAL], p[0], gravity, layers, wind).place(p[1])
        there = _Interval(z[_LOCAL:-1], p[2], gravity, layers, wind).place(p[3]) if two else p[2:5]
        between, weight = here - there, z[-1]
        beside = (between[0] ** 2 + between[1] ** 2) / radius**2 - 1.0
        over = (between[2] / half_height) ** 2 - 1.0
        return (1.0 - weight) * beside + weight * over, 0.0

    return Kind((2 if two else 1) * _LOCAL + 1, (4 if two else 5) + 3 + 4 * layers, formula)


@functools.cache
def _course_kind(layers: int) -> Kind:
    """Velocity over the ground across a course, and along it."""

    def formula(z: Any, p: Any) -> tuple[Any, Any]:
        v = _ground(z, layers, p[2:])
        return ca.vertcat(v[1] * p[0] - v[0] * p[1], v[0] * p[0] + v[1] * p[1]) / 100.0, 0.0

    return Kind(len(NODE), 2 + 4 * layers, formula)


@functools.cache
def _angle_kind(layers: int) -> Kind:
    """Velocity over the ground across a path angle."""

    def formula(z: Any, p: Any) -> tuple[Any, Any]:
        v = _ground(z, layers, p[2:])
        return (-v[2] * p[0] - ca.sqrt(v[0] ** 2 + v[1] ** 2 + 1e-6) * p[1]) / 100.0, 0.0

    return Kind(len(NODE), 2 + 4 * layers, formula)


def _ground(node: Any, layers: int, wind: Any) -> Any:
    z = node * _SCALE
    return _air(z[3], z[4], z[5]) + _blowing(layers, wind, -z[2])
