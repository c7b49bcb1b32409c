"""Cases of an environment: start, air and task of each episode, made before the first step.

A reset draws a case; nothing is trimmed or planned in it. Aircraft, air and sensors are those of a scenario with one
aircraft, so that the tables of a scenario file describe them.
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft_files.library import is_aircraft_path
from anser.analysis.airframes import valid_airspeed_range
from anser.analysis.step_flights import default_flight_point
from anser.analysis.trim_points import resolve_airframe
from anser.compiling.options import compiled, compiled_quickly
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.control.inversion_autopilot import InversionAutopilot
from anser.environment.environment import Environment, SteadyWind
from anser.numerics.arrays import Stacked, as_array, cast_to_precision
from anser.parts.perception import Belief, Instant, Truth
from anser.scenario.build import build_flight
from anser.scenario.schema import validate
from anser.shapes import Integer, Scalar
from anser.simulation.vehicle import Vehicle
from anser.spatial.rotations import rotate, rotation_from_quaternion
from anser.steady.trim import LIMIT_TOLERANCE, TrimPoint, TrimTarget, solve_trim
from anser.units import DEG_RAD

Rng = np.random.Generator


class Case(eqx.Module):
    """Start, air and task of one episode.

    Attributes
    ----------
    vehicle
        The aircraft with its sensors, estimator and autopilot, without a mission.
    environment
        Air and Earth.
    start
        State at the start, in the form of a trim point.
    task
        Numbers of the task, such as commands, of the type that the task's `draw` makes.
    decisions
        Number of decisions until the episode is truncated.
    """

    vehicle: Vehicle
    environment: Environment
    start: TrimPoint
    task: Any
    decisions: Integer

    @property
    def autopilot(self) -> InversionAutopilot:
        """The autopilot of the aircraft."""
        return autopilot_of(self.vehicle)


def autopilot_of(vehicle: Vehicle) -> InversionAutopilot:
    """Return the autopilot of an aircraft. Raises ValueError for another controller."""
    if not isinstance(vehicle.controller, InversionAutopilot):
        raise ValueError(
            f"aircraft: arrived the controller {type(vehicle.controller).__name__}; expected the package's autopilot, "
            'with gains.inversion = "model" or "incremental"'
        )
    return vehicle.controller


class Situation(eqx.Module):
    """Truth and estimates after a decision, from which a task computes errors, reward and observation.

    Attributes
    ----------
    case
        Case of the episode.
    instant
        Environment, time and step at the end of the decision.
    truth, belief
        True motion, and the aircraft's own estimate.
    variables, estimates
        Variables of the catalogue by dataset name, true and estimated.
    """

    case: Case
    instant: Instant
    truth: Truth
    belief: Belief
    variables: Mapping[str, Scalar]
    estimates: Mapping[str, Scalar]

    @property
    def time(self) -> Scalar:
        """Time since the start of the episode, s."""
        return self.instant.time


def scenario_tables(aircraft: str | Mapping[str, Any], tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a scenario with one aircraft in level flight.

    Parameters
    ----------
    aircraft
        Name of an airframe, path of an aircraft file, or a table `[[aircraft]]` of a scenario without its mission.
    tables
        Further tables of a scenario: `wind`, `turbulence`, `navigation`, `earth`, `limits` and the like.
    """
    own = dict(aircraft) if isinstance(aircraft, Mapping) else _aircraft_table(aircraft)
    kind = own.get("airframe", own.get("type", "f16"))
    airframe = resolve_airframe(str(kind), own.get("variant", "textbook"))[0]
    speed_m_s, altitude_m = default_flight_point(airframe)
    own = {"name": "aircraft", "goal": "goal", **own}
    place = {"north_m": 0.0, "east_m": 0.0, "course_deg": 0.0}
    own["start"] = {**place, "altitude_m": altitude_m, "speed_m_s": speed_m_s, **own.get("start", {})}
    own.setdefault("rendezvous", {"stand_off_up_m": 300.0})
    fleet = {"speed_m_s": own["start"]["speed_m_s"]}
    goal = {"name": "goal", "kind": "surface", "north_m": 200.0 * fleet["speed_m_s"], "east_m": 0.0}
    head = {"format": 2, "name": "environment", "timing": {"duration_s": 600.0}, "fleet": fleet}
    return {**head, "aircraft": [own], "goal": [goal], **tables}


def _aircraft_table(name: str) -> dict[str, Any]:
    return {"airframe" if is_aircraft_path(name) else "type": name}


def single_aircraft(tables: Mapping[str, Any]) -> tuple[Vehicle, Environment]:
    """Return the aircraft of a scenario with one aircraft, without its mission, and the environment.

    Raises
    ------
    ScenarioError
        A table is not valid; the message names the key, what arrived and what would be right.
    """
    flight = build_flight(validate(dict(tables), "environment"), mission_is_flown=False)
    vehicle, _, _ = flight.aircraft(0)
    return eqx.tree_at(lambda v: v.mission, vehicle, None, is_leaf=lambda x: x is None), flight.environment


@compiled
def _trims(airframe: AbstractAirframe, environment: Environment, targets: TrimTarget) -> TrimPoint:
    return jax.vmap(lambda target: solve_trim(airframe, environment, target))(targets)


_TRIM_BATCH = 64
"""Trims that are computed together: one compiled program for every size of a bank."""


def trim_rows(
    airframe: AbstractAirframe, environment: Environment, targets: Mapping[str, Float[np.ndarray, " row"]]
) -> tuple[TrimPoint, Bool[np.ndarray, " row"]]:
    """Solve the trim of an aircraft in many conditions, one per row.

    Parameters
    ----------
    targets
        Fields of `TrimTarget` by name; those left out are 0.

    Returns
    -------
    Trim points, and whether each is a steady flight within the limits.
    """
    count = len(next(iter(targets.values())))
    names = ("speed", "altitude", "path_angle", "course", "turn_rate", "path_rate", "pitch_rate")
    columns = [np.asarray(targets.get(name, np.zeros(count)), dtype=float) for name in names]
    parts = []
    for first in range(0, count, _TRIM_BATCH):
        rows = np.minimum(np.arange(first, first + _TRIM_BATCH), count - 1)
        target = TrimTarget(*(as_array(column[rows]) for column in columns))
        parts.append(jax.tree.map(np.asarray, _trims(airframe, environment, target)))
    points = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts)
    return points, points.converged & (points.excess <= LIMIT_TOLERANCE)


class FlightRange(eqx.Module):
    """Range of the flight conditions at the starts of episodes.

    Attributes
    ----------
    speed_m_s, altitude_m
        Least and greatest airspeed and altitude.
    path_angle_deg, bank_deg
        Greatest magnitude of the path angle, and of the bank of the steady turn.
    wind_m_s
        Greatest speed of the steady wind, whose direction is uniform.
    """

    speed_m_s: tuple[float, float] = eqx.field(static=True)
    altitude_m: tuple[float, float] = eqx.field(static=True)
    path_angle_deg: float = eqx.field(static=True, default=10.0)
    bank_deg: float = eqx.field(static=True, default=45.0)
    wind_m_s: float = eqx.field(static=True, default=15.0)


def default_range(vehicle: Vehicle) -> FlightRange:
    """Return the range of flight conditions: airspeeds of the autopilot, altitudes of the data up to 8 km."""
    airframe, limits = vehicle.airframe, autopilot_of(vehicle).limits
    low, high = valid_airspeed_range(airframe)
    slowest, fastest = max(low, float(limits.speed_min)), min(high, float(limits.speed_max))
    bottom, top = getattr(getattr(airframe, "validity", None), "altitude", (0.0, np.inf))
    lowest = max(1000.0, float(bottom))
    return FlightRange((1.1 * slowest, 0.9 * fastest), (lowest, max(min(8000.0, float(top)), lowest)))


_STEADY_SHARE_MIN = 0.02
"""Least share of steady flights among the drawn conditions."""


def steady_starts(vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> TrimPoint:
    """Draw steady flights over the trim map: level, climbing, descending and turning, in any direction.

    Raises
    ------
    ValueError
        The aircraft has hardly any steady flight in the range.
    """
    points: list[TrimPoint] = []
    found = drawn = 0
    while drawn == 0 or found > _STEADY_SHARE_MIN * drawn:
        size = max(count - found, _TRIM_BATCH)
        speed = rng.uniform(*flown.speed_m_s, size)
        bank = rng.uniform(-1.0, 1.0, size) * flown.bank_deg * DEG_RAD
        targets = {
            "speed": speed,
            "altitude": rng.uniform(*flown.altitude_m, size),
            "path_angle": rng.uniform(-1.0, 1.0, size) * flown.path_angle_deg * DEG_RAD,
            "course": rng.uniform(-np.pi, np.pi, size),
            "turn_rate": STANDARD_GRAVITY_M_S2 * np.tan(bank) / speed,
        }
        trims, is_steady = trim_rows(vehicle.airframe, environment, targets)
        points.append(jax.tree.map(lambda leaf, flags=is_steady: leaf[flags], trims))
        found += int(is_steady.sum())
        drawn += size
        if found >= count:
            return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *points)
    raise ValueError(
        f"starts: {found} of {drawn} drawn conditions are steady flights; expected a range of airspeed, "
        f"altitude, path angle and bank within the trim map of the aircraft, not {flown}"
    )


def wind_rows(flown: FlightRange, count: int, rng: Rng) -> Float[np.ndarray, "row 3"]:
    """Draw steady horizontal winds (NED, m/s): uniform speed up to the greatest, uniform direction."""
    speed, direction = rng.uniform(0.0, flown.wind_m_s, count), rng.uniform(-np.pi, np.pi, count)
    return np.stack([speed * np.cos(direction), speed * np.sin(direction), np.zeros(count)], axis=-1)


def stack_cases(
    vehicle: Vehicle,
    environment: Environment,
    starts: TrimPoint,
    wind_n: Float[np.ndarray, "row 3"],
    task: Any,
    decisions: int,
    dtype: Any,
) -> Stacked[Case]:
    """Return the cases of one aircraft with a start, a steady wind and a task in each row.

    The wind is added to that of the environment, and to the velocity of the starts.
    """
    count = len(wind_n)
    if isinstance(environment.wind, SteadyWind):
        winds = as_array(wind_n + np.asarray(environment.wind.velocity_n))
        batched_wind, shared_wind = SteadyWind(winds), SteadyWind(None)  # pyright: ignore[reportArgumentType]
    else:
        batched_wind, shared_wind = jax.tree.map(lambda _: None, environment.wind), environment.wind
    nothing = jax.tree.map(lambda _: None, environment)
    environments = Environment(nothing.atmosphere, batched_wind, nothing.earth)
    shared_environment = Environment(environment.atmosphere, shared_wind, environment.earth)
    starts = _starts_in_wind(Stacked(environments, shared_environment), starts)
    empty_start, empty_task = jax.tree.map(lambda _: None, (starts, task))
    lengths = as_array(np.full(count, decisions), np.int32)
    batched = Case(jax.tree.map(lambda _: None, vehicle), environments, starts, task, lengths)
    shared = Case(vehicle, shared_environment, empty_start, empty_task, None)  # pyright: ignore[reportArgumentType]
    cases = Stacked(batched, shared)
    return cast_to_precision(jax.tree.map(lambda leaf: as_array(leaf, None), cases), dtype)


@compiled_quickly
def _starts_in_wind(environments: Stacked[Environment], starts: TrimPoint) -> TrimPoint:
    """Add the wind at the start to the velocity over the ground of steady flights in still air."""

    def in_wind(environment: Environment, start: TrimPoint) -> TrimPoint:
        wind_n = environment.wind.at(start.state.position_n, 0.0)
        wind_b = rotate(rotation_from_quaternion(start.state.quaternion), wind_n)
        return eqx.tree_at(lambda p: p.state.velocity_b, start, start.state.velocity_b + wind_b)

    return jax.vmap(lambda batched, start: in_wind(environments.combine(batched), start))(environments.batched, starts)
