"""Why an aircraft cannot fly steadily as asked, and what it can do instead; on the host, for messages to people."""

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from anser.aircraft.air_data import AirData, Validity
from anser.aircraft.air_data import is_outside as outside
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import flight_condition
from anser.compiling.options import compiled
from anser.environment.environment import Environment
from anser.shapes import Flag
from anser.steady.trim import TrimPoint, TrimTarget, solve_trim
from anser.units import RAD_DEG

Flags = Bool[Array, " targets"]

_CANDIDATES = 128
_SPEED_FACTOR = 8.0
_PATH_ANGLE_LIMIT = math.radians(80.0)
_TURN_RATE_LIMIT = math.radians(30.0)
_LIMIT_SLACK = 1e-9
"""Rad and fraction of power by which a limit may be passed: a thousand times the solver's noise."""


@dataclasses.dataclass(frozen=True)
class NearestTrim:
    """The trimmable point nearest to a target along one of its quantities.

    Attributes
    ----------
    quantity
        "speed", "path_angle" or "turn_rate", in a pull-up "pitch_rate": the field of the target that was changed.
    wanted, value
        What the target asks for and the nearest trimmable value, SI (m/s, rad, rad/s).
    distance
        Size of the change without unit: speed change over wanted speed; path angle change in rad (about the change of
        thrust over weight); turn or pitch rate change times wanted speed over gravity (change of load factor).
    target, point
        The changed target and its trim.
    """

    quantity: str
    target_value: float
    value: float
    distance: float
    target: TrimTarget
    point: TrimPoint

    def message(self) -> str:
        """Say it in one clause; numbers are rounded toward the trimmable side."""
        return _CLAUSES[self.quantity](self.target_value, self.value)


@dataclasses.dataclass(frozen=True)
class TrimDiagnosis:
    """What is known about a target: its own trim, what stops it, and the nearest points that can be trimmed.

    Attributes
    ----------
    target, point
        The flight wanted and the solution found for it, inside the limits or not.
    violations
        See `trim_violations`; empty where the target itself is trimmable.
    nearest
        Nearest first; at most one for each quantity; empty where the target itself is trimmable.
    """

    target: TrimTarget
    point: TrimPoint
    violations: tuple[str, ...]
    nearest: tuple[NearestTrim, ...]

    def message(self) -> str:
        """Say it in a few lines."""
        t = self.target
        asked = (
            f"{float(t.speed):.1f} m/s at {float(t.altitude):.0f} m, "
            f"path angle {float(t.path_angle) * RAD_DEG:.1f} deg, turn rate {float(t.turn_rate) * RAD_DEG:.1f} deg/s"
        )
        if float(t.path_rate) != 0.0:
            asked += f", path angle rate {float(t.path_rate) * RAD_DEG:.1f} deg/s"
        if float(t.pitch_rate) != 0.0:
            asked += f", pitch rate {float(t.pitch_rate) * RAD_DEG:.1f} deg/s"
        if not self.violations:
            return f"Steady flight exists: {asked}."
        lines = [f"No steady flight: {asked}.", *(f"- {violation}" for violation in self.violations)]
        if self.nearest:
            lines += ["All else unchanged:", *(f"- {found.message()}" for found in self.nearest)]
        else:
            rate = _rate_changed(t).replace("_", " ")
            lines += [f"No change of speed, path angle or {rate} alone makes it possible."]
        return "\n".join(lines)


def trim_violations(airframe: AbstractAirframe, environment: Environment, point: TrimPoint) -> tuple[str, ...]:
    """Say which limits a trim point breaks, with numbers in deg and percent; empty for a point that can be flown.

    Parameters
    ----------
    airframe, environment
        As given to `solve_trim`.
    point
        Its result, for one aircraft.
    """
    if math.isinf(float(point.residual)):
        return ("a pitch rate (P = R = 0) together with a turn rate or a rate of the path angle defines no flight",)
    if not bool(point.converged):
        return (
            "the forces and moments cannot be balanced: the best attempt leaves "
            f"{float(point.residual):.2g} (g, or rad/s^2 about an axis)",
        )
    actuators = airframe.actuators
    checks = [
        ("angle of attack", point.alpha, *airframe.alpha_range, RAD_DEG, "deg", "known from"),
        ("sideslip", point.beta, *airframe.beta_range, RAD_DEG, "deg", "known from"),
        ("engine power", point.power / 100, 0.0, 1.0, 100.0, "percent", "available"),
    ]
    for k, name in enumerate(actuators.names):
        deflection = point.state.surfaces[k]
        checks.append((name, deflection, actuators.lower[k], actuators.upper[k], RAD_DEG, "deg", "moves from"))
    found = []
    for name, value, lower, upper, factor, unit, verb in checks:
        if not lower - _LIMIT_SLACK <= value <= upper + _LIMIT_SLACK:
            low, high = (round(float(limit) * factor, 6) for limit in (lower, upper))
            found.append(f"{name}: {_beyond(float(value) * factor, low, high)} {unit}; {verb} {low:g} to {high:g}")
    is_outside, data = _elsewhere_outside(airframe, environment, point)
    if bool(is_outside):
        where = _beyond_validity(airframe, data)
        words = f"altitude {float(data.altitude):.0f} m, Mach {float(data.mach):.2f}: outside the aircraft's data"
        found.extend(where or [words])
    return tuple(found)


def _beyond_validity(airframe: AbstractAirframe, data: AirData) -> list[str]:
    """Say which of the ranges that an aircraft states do not hold the flight; none where it states none."""
    validity: Validity | None = getattr(airframe, "validity", None)
    if validity is None:
        return []
    checks = (
        ("airspeed", data.V, validity.airspeed, " m/s"),
        ("altitude", data.altitude, validity.altitude, " m"),
        ("Mach", data.mach, validity.mach, ""),
    )
    return [
        f"{name} {float(value):.4g}{unit}: outside the aircraft's data, which hold from {float(ends[0]):g} to "
        f"{float(ends[1]):g}{unit}"
        for name, value, ends, unit in checks
        if bool(outside(value, ends))
    ]


def nearest_trims(airframe: AbstractAirframe, environment: Environment, target: TrimTarget) -> TrimDiagnosis:
    """Find the trimmable points nearest to a target, changing its speed, path angle or turn rate one at a time.

    In a pull-up by pitch rate, that instead of the turn rate. A grid along each quantity, then a finer one beside the
    nearest trimmable value; all points of a grid are solved in one compiled call. The edges are found to 0.03 percent
    of the speed, 0.01 deg and 0.004 deg/s.

    Parameters
    ----------
    airframe, environment
        As for `solve_trim`.
    target
        Steady flight wanted, of one aircraft.
    """
    rate = _rate_changed(target)
    wanted = {name: float(getattr(target, name)) for name in ("speed", "path_angle", rate)}
    gravity = float(environment.gravity)
    scale = {"speed": 1 / wanted["speed"], "path_angle": 1.0, rate: wanted["speed"] / gravity}
    most = max(_TURN_RATE_LIMIT, 1.5 * abs(wanted[rate]))
    grids = {
        "speed": wanted["speed"] * np.geomspace(1 / _SPEED_FACTOR, _SPEED_FACTOR, _CANDIDATES),
        "path_angle": np.linspace(-_PATH_ANGLE_LIMIT, _PATH_ANGLE_LIMIT, _CANDIDATES),
        rate: np.linspace(-most, most, _CANDIDATES),
    }
    points, usable = _solve(airframe, environment, target, grids)
    own = jax.tree.map(lambda leaf: leaf[-1], points)
    violations = trim_violations(airframe, environment, own)
    if not violations:
        return TrimDiagnosis(target, own, (), ())
    finer = {name: _beside_nearest(grids[name], usable[name], wanted[name]) for name in grids}
    points, usable = _solve(airframe, environment, target, finer)
    nearest = []
    for row, name in enumerate(grids):
        if not usable[name].any():
            continue
        distances = np.where(usable[name], np.abs(finer[name] - wanted[name]), np.inf)
        k = int(np.argmin(distances))
        nearest.append(
            NearestTrim(
                quantity=name,
                target_value=wanted[name],
                value=float(finer[name][k]),
                distance=float(distances[k]) * scale[name],
                target=dataclasses.replace(target, **{name: jnp.asarray(finer[name][k])}),
                point=jax.tree.map(lambda leaf, at=row * _CANDIDATES + k: leaf[at], points),
            )
        )
    nearest.sort(key=lambda found: found.distance)
    return TrimDiagnosis(target, own, violations, tuple(nearest))


def _rate_changed(target: TrimTarget) -> str:
    """Which rate the diagnosis changes: a pull-up has no turn."""
    return "turn_rate" if float(target.pitch_rate) == 0.0 else "pitch_rate"


@compiled
def _elsewhere_outside(airframe: AbstractAirframe, environment: Environment, point: TrimPoint) -> tuple[Flag, AirData]:
    """Whether the data end for another reason than the flow angles; the flow."""
    data = flight_condition(airframe, environment, 0.0, point.state).air_data
    alpha, beta = jnp.clip(data.alpha, *airframe.alpha_range), jnp.clip(data.beta, *airframe.beta_range)
    within = dataclasses.replace(data, alpha=alpha, beta=beta)
    return airframe.outside_tables(within), data


@compiled
def _solve_all(airframe: AbstractAirframe, environment: Environment, targets: TrimTarget) -> tuple[TrimPoint, Flags]:
    def one(target: TrimTarget) -> tuple[TrimPoint, Flag]:
        point = solve_trim(airframe, environment, target)
        data = flight_condition(airframe, environment, 0.0, point.state).air_data
        return point, point.converged & (point.excess <= _LIMIT_SLACK) & ~airframe.outside_tables(data)

    return jax.vmap(one)(targets)


def _solve(
    airframe: AbstractAirframe, environment: Environment, target: TrimTarget, grids: dict[str, np.ndarray]
) -> tuple[TrimPoint, dict[str, np.ndarray]]:
    """Trim the target with each quantity replaced by each value of its grid, one grid after the other; last, itself."""
    count = len(grids) * _CANDIDATES
    fields = {f.name: np.full(count + 1, float(getattr(target, f.name))) for f in dataclasses.fields(target)}
    for row, (name, grid) in enumerate(grids.items()):
        fields[name][row * _CANDIDATES : (row + 1) * _CANDIDATES] = grid
    points, usable = _solve_all(airframe, environment, TrimTarget(**{k: jnp.asarray(v) for k, v in fields.items()}))
    return points, dict(zip(grids, np.split(np.asarray(usable)[:count], len(grids)), strict=True))


def _beside_nearest(grid: np.ndarray, usable: np.ndarray, target_value: float) -> np.ndarray:
    """Values from the nearest usable one to its neighbour toward what is wanted; the grid where none is usable."""
    if not usable.any():
        return grid
    near = float(grid[int(np.argmin(np.where(usable, np.abs(grid - target_value), np.inf)))])
    between = grid[(grid - near) * (target_value - near) > 0]
    toward = float(between[np.argmin(np.abs(between - near))]) if between.size else target_value
    end = toward if abs(toward - near) < abs(target_value - near) else target_value
    return np.linspace(near, end, _CANDIDATES)


def _beyond(value: float, lower: float, upper: float) -> str:
    """Value with one decimal or more, as many as it takes to show that it lies beyond the limit."""
    for decimals in range(1, 9):
        text = f"{value:.{decimals}f}"
        if not lower <= float(text) <= upper:
            return text
    return f"{value!r}"


def _at_least(value: float) -> str:
    return f"{math.ceil(value * 10) / 10:.1f}"


def _at_most(value: float) -> str:
    return f"{math.floor(value * 10) / 10:.1f}"


def _speed_clause(target_value: float, value: float) -> str:
    if value > target_value:
        return f"the slowest trimmable speed is {_at_least(value)} m/s"
    return f"the fastest trimmable speed is {_at_most(value)} m/s"


def _path_angle_clause(target_value: float, value: float) -> str:
    angle = value * RAD_DEG
    if value < target_value:
        if value >= 0:
            return f"the steepest climb is {_at_most(angle)} deg"
        return f"it must descend at {_at_least(-angle)} deg or more"
    if value <= 0:
        return f"the steepest descent is {_at_most(-angle)} deg"
    return f"it must climb at {_at_least(angle)} deg or more"


def _turn_rate_clause(target_value: float, value: float) -> str:
    rate = abs(value) * RAD_DEG
    if abs(value) < abs(target_value):
        return f"the fastest turn is {_at_most(rate)} deg/s"
    return f"it must turn at {_at_least(rate)} deg/s or more"


def _pitch_rate_clause(target_value: float, value: float) -> str:
    rate, up = abs(value) * RAD_DEG, value > 0
    if abs(value) < abs(target_value) and value * target_value >= 0:
        return f"the fastest {'pull-up' if target_value > 0 else 'push-over'} is {_at_most(rate)} deg/s"
    return f"it must {'pull up' if up else 'push over'} at {_at_least(rate)} deg/s or more"


_CLAUSES: dict[str, Callable[[float, float], str]] = {
    "speed": _speed_clause,
    "path_angle": _path_angle_clause,
    "turn_rate": _turn_rate_clause,
    "pitch_rate": _pitch_rate_clause,
}
