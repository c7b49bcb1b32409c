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
"""Scale of each unknown in the solver, in the order of NODE."""
_SMOOTH = 1e-3
"""Weight of the regularisation: force per gravity, and deviation of a middle from the mean of its nodes."""
_FAR = 1e20
_LOCAL = 2 * len(NODE) + len(MID)
"""Unknowns of an interval: node, middle, next node."""


class Obstacle(NamedTuple):
    """Upright cylinder to avoid at some times: a keep-out, or the separation from a fixed path."""

    times: Float[np.ndarray, " time"]
    """Times, s."""
    centre: Float[np.ndarray, "3 time"]
    """NED, m."""
    radius: float
    """m."""
    half_height: float
    """m; infinite where there is no way above or below."""


class Encounter(NamedTuple):
    """Two flights, by their indices in the list, with a separation at some times."""

    first_flight: int
    second_flight: int
    times: Float[np.ndarray, " time"]
    """s."""
    radius: float
    """m."""
    half_height: float
    """m."""


@dataclass(frozen=True)
class Solution:
    """Result of the solver."""

    unknowns: list[Float[np.ndarray, " unknown"]]
    """Unknowns of each flight."""
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
    """Search for flights that satisfy their constraints simultaneously.

    Parameters
    ----------
    flights
        Requirements of each flight.
    starts
        Initial values of the unknowns.
    obstacles
        Obstacles of each flight.
    encounters
        Separations between flights.
    iterations
        Limit on the solver's iterations.
    """
    program = Program()
    index = [_add_flight(program, f, x) for f, x in zip(flights, starts, strict=True)]
    paths = [f.path(x) for f, x in zip(flights, starts, strict=True)]
    wind = _wind_parameters(flights[0].case.wind)
    gravity = flights[0].case.gravity
    for k, flight_obstacles in enumerate(obstacles):
        for condition in flight_obstacles:
            at, share = _intervals(flights[k], condition.times)
            displacement = paths[k].at(condition.times) - condition.centre
            parameters = [np.full(share.size, flights[k].width), share, *condition.centre]
            _keep_apart(
                program,
                False,
                gravity,
                index[k][at],
                parameters,
                wind,
                displacement,
                condition.radius,
                condition.half_height,
            )
    for condition in encounters:
        a, b = condition.first_flight, condition.second_flight
        (at, share), (intervals_b, share_b) = (
            _intervals(flights[a], condition.times),
            _intervals(flights[b], condition.times),
        )
        parameters = [np.full(share.size, flights[a].width), share, np.full(share.size, flights[b].width), share_b]
        displacement = paths[a].at(condition.times) - paths[b].at(condition.times)
        unknown_indices = np.concatenate([index[a][at], index[b][intervals_b]], axis=1)
        _keep_apart(
            program,
            True,
            gravity,
            unknown_indices,
            parameters,
            wind,
            displacement,
            condition.radius,
            condition.half_height,
        )
    solved = program.solve(iterations)
    unknowns, offset = [], 0
    for flight, x0 in zip(flights, starts, strict=True):
        unknowns.append(solved.x[offset : offset + x0.size] * _scales(flight))
        offset += x0.size
    return Solution(unknowns, solved.feasible, solved.iterations, solved.violation)


def _scales(flight: Flight) -> Float[np.ndarray, " unknown"]:
    return np.concatenate([np.tile(_SCALE, flight.intervals + 1), np.tile(_SCALE[3:], flight.intervals)])


def _intervals(
    flight: Flight, times: Float[np.ndarray, " time"]
) -> tuple[Int[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Interval containing each time, and the elapsed fraction of the interval."""
    share = np.clip((times - flight.case.starts.time) / flight.width, 0.0, flight.intervals)
    at = np.minimum(share.astype(int), flight.intervals - 1)
    return at, share - at


def _add_flight(
    program: Program, flight: Flight, start: Float[np.ndarray, " unknown"]
) -> Int[np.ndarray, "interval local"]:
    """Add unknowns and constraints of one flight; return the indices of the unknowns per interval."""
    scale, case, aircraft, m = _scales(flight), flight.case, flight.aircraft, flight.margins
    L, count = case.limits, flight.intervals
    low, high = flight.bounds()
    x = program.add_unknowns(start / scale, low / scale, high / scale)
    nodes, mids = flight.split(x)
    index = np.concatenate([nodes[:, :-1], mids, nodes[:, 1:]]).T
    lift = (float(L.load_factor_max[aircraft]) - m.load_factor) * case.gravity
    tan_bank, climb = np.tan(float(L.bank_max[aircraft]) - m.bank), float(L.climb_rate_max[aircraft]) - m.climb_rate
    wind, layers = _wind_parameters(case.wind), case.wind.altitudes.size
    parameters = np.concatenate([[flight.width, tan_bank, lift**2, climb, case.gravity, 1.0 / count], wind])
    floor, ceiling = (L.altitude_min[aircraft] + m.altitude) / 1000.0, (L.altitude_max[aircraft] - m.altitude) / 1000.0
    slower, faster = m.along - L.deceleration_max[aircraft], L.acceleration_max[aircraft] - m.along
    lower = np.array([0.0] * 9 + [floor] + [0.0] * 10 + [slower, 0.0, 0.0, 0.0] * 2)
    upper = np.array([0.0] * 9 + [ceiling] + [_FAR] * 10 + [faster, _FAR, _FAR, _FAR] * 2)
    program.add(_interval_kind(layers), index, np.tile(parameters, (count, 1)), lower, upper)
    course, angle = float(case.goals.course[aircraft]), float(case.goals.path_angle[aircraft])
    last_node, wind = nodes[:, -1:].T, wind[None]
    if np.isfinite(course):
        parameters = np.concatenate([[[np.cos(course), np.sin(course)]], wind], axis=1)
        program.add(_course_kind(layers), last_node, parameters, np.array([0.0, 0.01]), np.array([0.0, _FAR]))
    if np.isfinite(angle):
        parameters = np.concatenate([[[np.cos(angle), np.sin(angle)]], wind], axis=1)
        program.add(_angle_kind(layers), last_node, parameters, np.zeros(1), np.zeros(1))
    return index


def _keep_apart(
    program: Program,
    two: bool,
    gravity: float,
    index: Int[np.ndarray, "time local"],
    parameter_columns: list[Float[np.ndarray, " time"]],
    wind: Float[np.ndarray, " wind"],
    displacement: Float[np.ndarray, "3 time"],
    radius: float,
    half_height: float,
) -> None:
    """Add the constraint to stay outside a cylinder, laterally or vertically.

    One of the two excesses may be negative: the weighted mean, with an unknown weight from 0 to 1 at each time, is
    positive for some weight if and only if one excess is positive.
    """
    size = np.tile([radius, min(half_height, 1e6), gravity], (len(index), 1))
    lateral_only = np.isinf(half_height)
    excess = np.stack([np.hypot(displacement[0], displacement[1]) / radius, np.abs(displacement[2]) / size[:, 1]]) - 1.0
    start = np.where((excess[1] > excess[0]) & ~lateral_only, 0.9, 0.0 if lateral_only else 0.1)
    weight = program.add_unknowns(start, np.zeros(start.size), np.full(start.size, 0.0 if lateral_only else 1.0))
    parameters = np.concatenate([np.stack(parameter_columns, axis=1), size, np.tile(wind, (len(index), 1))], axis=1)
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


def _acceleration(motion: Any, gravity: Any) -> Any:
    """Newton's second law: force per mass along the air path, to the side and normal to it, plus gravity."""
    gamma, chi, along, side, normal = (motion[k] for k in range(5))
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
        endpoints = (self.begin, self.end)
        self.v = [_air(z[3], z[4], z[5]) + _blowing(layers, wind, -z[2]) for z in endpoints]
        self.a = [_acceleration(motion, gravity) for motion in (self.begin[4:], self.middle[1:], self.end[4:])]
        self.width = width

    def place(self, share: Any) -> Any:
        """Position after a share of the interval, NED, m."""
        s, h, a = share, self.width, self.a
        acceleration_part = (
            (s**2 / 2 - s**3 / 2 + s**4 / 6) * a[0] + (2 * s**3 / 3 - s**4 / 3) * a[1] + (s**4 / 6 - s**3 / 6) * a[2]
        )
        return self.begin[:3] + h * s * self.v[0] + h**2 * acceleration_part


@functools.cache
def _interval_kind(layers: int) -> Kind:
    """Defects of position, velocity and mid velocity; middle altitude; limits at middle, end and quarters."""

    def formula(z: Any, p: Any) -> tuple[Any, Any]:
        h, tan_bank, lift_square, climb, gravity, share = (p[k] for k in range(6))
        interval = _Interval(z, h, gravity, layers, p[6:])
        a, half = interval.a, interval.place(0.5)
        v_half = interval.v[0] + h * (5.0 * a[0] + 8.0 * a[1] - a[2]) / 24.0
        constraints = [
            (interval.end[:3] - interval.place(1.0)) / 1000.0,
            (interval.v[1] - interval.v[0] - h * (a[0] + 4.0 * a[1] + a[2]) / 6.0) / 50.0,
            (
                _air(interval.middle[0], interval.middle[1], interval.middle[2])
                + _blowing(layers, p[6:], -half[2])
                - v_half
            )
            / 50.0,
            -half[2] / 1000.0,
        ]
        for at in (interval.middle, interval.end[3:]):
            V, gamma, side, normal = at[0], at[1], at[4], at[5]
            constraints += [
                (tan_bank * normal - side) / 10.0,
                (tan_bank * normal + side) / 10.0,
                (lift_square - side**2 - normal**2) / 100.0,
                (climb - V * ca.sin(gamma)) / 10.0,
                (climb + V * ca.sin(gamma)) / 10.0,
            ]
        # At the quarters the forces are interpolated, without the rotation of the axes.
        for q in ((0.375, 0.75, -0.125), (-0.125, 0.75, 0.375)):
            force = q[0] * interval.begin[6:] + q[1] * interval.middle[3:] + q[2] * interval.end[6:]
            constraints += [
                force[0],
                (tan_bank * force[2] - force[1]) / 10.0,
                (tan_bank * force[2] + force[1]) / 10.0,
                (lift_square - force[1] ** 2 - force[2] ** 2) / 100.0,
            ]
        bow = (interval.middle[3:] - 0.5 * (interval.begin[6:] + interval.end[6:])) / gravity
        level = ca.vertcat(interval.middle[3], interval.middle[4], interval.middle[5] - gravity) / gravity
        return ca.vertcat(*constraints), _SMOOTH * share * (ca.sumsqr(bow) + ca.sumsqr(level))

    return Kind(_LOCAL, 6 + 4 * layers, formula)


@functools.cache
def _apart_kind(layers: int, two: bool) -> Kind:
    """Weighted excess over radius and half height: of a flight and a fixed point, or of two flights."""

    def formula(z: Any, p: Any) -> tuple[Any, Any]:
        wind, gravity = p[-4 * layers :], p[-4 * layers - 1]
        radius, half_height = p[-4 * layers - 3], p[-4 * layers - 2]
        position = _Interval(z[:_LOCAL], p[0], gravity, layers, wind).place(p[1])
        other_position = _Interval(z[_LOCAL:-1], p[2], gravity, layers, wind).place(p[3]) if two else p[2:5]
        displacement, weight = position - other_position, z[-1]
        lateral_excess = (displacement[0] ** 2 + displacement[1] ** 2) / radius**2 - 1.0
        vertical_excess = (displacement[2] / half_height) ** 2 - 1.0
        return (1.0 - weight) * lateral_excess + weight * vertical_excess, 0.0

    return Kind((2 if two else 1) * _LOCAL + 1, (4 if two else 5) + 3 + 4 * layers, formula)


@functools.cache
def _course_kind(layers: int) -> Kind:
    """Components of the velocity over the ground across and along a course."""

    def formula(z: Any, p: Any) -> tuple[Any, Any]:
        v = _ground(z, layers, p[2:])
        return ca.vertcat(v[1] * p[0] - v[0] * p[1], v[0] * p[0] + v[1] * p[1]) / 100.0, 0.0

    return Kind(len(NODE), 2 + 4 * layers, formula)


@functools.cache
def _angle_kind(layers: int) -> Kind:
    """Component of the velocity over the ground across a path angle."""

    def formula(z: Any, p: Any) -> tuple[Any, Any]:
        v = _ground(z, layers, p[2:])
        return (-v[2] * p[0] - ca.sqrt(v[0] ** 2 + v[1] ** 2 + 1e-6) * p[1]) / 100.0, 0.0

    return Kind(len(NODE), 2 + 4 * layers, formula)


def _ground(node: Any, layers: int, wind: Any) -> Any:
    z = node * _SCALE
    return _air(z[3], z[4], z[5]) + _blowing(layers, wind, -z[2])
