"""Cases of an environment: start, air and task of each episode, made before the first step.

The argument `key` of `reset` selects one of the cases. Tables as in a scenario file give aircraft, air and sensors.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.aircraft.airframe import AbstractAirframe, AircraftState
from anser.aircraft_files.library import is_aircraft_path
from anser.analysis.airframes import valid_airspeed_range
from anser.analysis.step_flights import default_flight_point
from anser.analysis.trim_points import resolve_airframe
from anser.compiling.options import compiled, compiled_quickly
from anser.config.errors import Problem, ScenarioError
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.control.inversion_autopilot import InversionAutopilot
from anser.environment.air import AIRSPEED_FORMS
from anser.environment.environment import Environment, SteadyWind
from anser.numerics.arrays import Stacked, as_array, cast_to_precision, pad_to_multiple, take_rows
from anser.parts.perception import Belief, Instant, Truth
from anser.scenario.build import build_flight
from anser.scenario.schema import Scenario, UnplannedScenario, validate
from anser.scenario.unused_keys import unused_key_problems
from anser.shapes import Integer, Scalar
from anser.simulation.vehicle import Vehicle
from anser.spatial.rotations import rotate, rotation_from_quaternion
from anser.steady.trim import LIMIT_TOLERANCE, TrimPoint, TrimTarget, solve_trim
from anser.units import DEG_RAD

Rng = np.random.Generator


class Case(eqx.Module):
    """Aircraft, air, start and task of one episode."""

    vehicle: Vehicle  #: The aircraft with its sensors, estimator and autopilot; `mission` is None.
    environment: Environment  #: Air and Earth.
    start: TrimPoint  #: State and controls at the start: a steady flight, except in tasks such as `UpsetRecovery`.
    task: Any  #: Data of the task in this episode, such as the commands that `AbstractTask.draw` has drawn.
    decisions: Integer  #: Number of decisions of a full episode, after which the episode is truncated.

    @property
    def autopilot(self) -> InversionAutopilot:
        """The autopilot of the aircraft."""
        return autopilot_of(self.vehicle)


def autopilot_of(vehicle: Vehicle) -> InversionAutopilot:
    """Return the autopilot of an aircraft. Raises ValueError if the controller is not an `InversionAutopilot`."""
    if not isinstance(vehicle.controller, InversionAutopilot):
        raise ValueError(
            f"aircraft: arrived the controller {type(vehicle.controller).__name__}; expected the package's autopilot, "
            'with gains.inversion = "model" or "incremental"'
        )
    return vehicle.controller


class Situation(eqx.Module):
    """Truth and estimates at the start of an episode or after a decision: the input of a task's functions."""

    case: Case  #: Case of the episode.
    instant: Instant  #: Environment, time and integration step at the start of the episode or after the decision.
    truth: Truth  #: True motion of the aircraft, with air data and forces.
    belief: Belief  #: The aircraft's own estimate of its motion.
    #: True values of variables by dataset name, such as "alpha_deg", in the units that the names state.
    variables: Mapping[str, Scalar]
    estimates: Mapping[str, Scalar]  #: The aircraft's estimates of the same variables, in the same units.

    @property
    def time(self) -> Scalar:
        """Time since the start of the episode, s."""
        return self.instant.time


def single_aircraft(
    aircraft: str | Mapping[str, Any], tables: Mapping[str, Any], step_s: float = 0.01
) -> tuple[Vehicle, Environment]:
    """Build an aircraft without a mission, and its environment, from the tables of a scenario.

    For the arguments see `anser.environments.make`. Raises ScenarioError if a table is not valid, or has no effect on
    an aircraft without a mission.
    """
    _refuse(name for name in tables if name in Scenario.model_fields and name not in _TABLES)
    if isinstance(aircraft, str):
        aircraft = {"airframe" if is_aircraft_path(aircraft) else "type": aircraft}
    _refuse(f"aircraft.{key}" for key in aircraft if key in _MISSION_KEYS)
    kind, variant = aircraft.get("airframe", aircraft.get("type", "f16")), aircraft.get("variant", "textbook")
    speed_m_s, altitude_m = default_flight_point(resolve_airframe(str(kind), variant)[0])
    start = {"north_m": 0.0, "east_m": 0.0, "course_deg": 0.0, "altitude_m": altitude_m, **aircraft.get("start", {})}
    airspeed = {form: start[form] for form in AIRSPEED_FORMS if form in start} or {"speed_m_s": speed_m_s}
    start |= airspeed
    own = {"name": "aircraft", "goal": "goal", "rendezvous": {"stand_off_up_m": 300.0}, **aircraft, "start": start}
    scenario = {
        "format": 2,
        "name": "environment",
        "timing": {
            "duration_s": math.ceil(600.0 / step_s) * step_s,
            "step_s": step_s,
            "record_period_s": step_s,
            "replan_period_s": 0.0,
        },
        "fleet": airspeed,
        "aircraft": [own],
        "goal": [{"name": "goal", "kind": "surface", "north_m": 10000.0, "east_m": 0.0}],
        **tables,
    }
    validated = validate(scenario, "environment", UnplannedScenario)
    _refuse(f"event[{k}]" for k, event in enumerate(validated.event) if event.kind not in _EVENTS)
    _refuse(f"parts.{key}" for key in ("guidance", "planner") if getattr(validated.parts, key, None) is not None)
    if problems := unused_key_problems(validated):
        raise ScenarioError("environment", problems)
    flight = build_flight(validated, mission_is_flown=False)
    vehicle, _, _ = flight.aircraft(0)
    return eqx.tree_at(lambda v: v.mission, vehicle, None, is_leaf=lambda x: x is None), flight.environment


def aircraft_identity(aircraft: Mapping[str, Any]) -> dict[str, str | int | float]:
    """Return the description, by `resolve_airframe`, of the aircraft of a table `[[aircraft]]`."""
    kind, variant = aircraft.get("airframe") or aircraft.get("type") or "f16", aircraft.get("variant") or "textbook"
    return resolve_airframe(str(kind), variant, aircraft.get("x_cg_over_c"))[1]


_TABLES = "atmosphere", "earth", "event", "excitation", "gust", "limits", "navigation", "parts", "turbulence", "wind"
_EVENTS = "aircraft-changes", "thrust-lost"
_MISSION_KEYS = "goal", "bend", "arrive_s", "arrive_from_s", "arrive_to_s", "rendezvous"


def _refuse(paths: Iterable[str]) -> None:
    """Raise ScenarioError if there are any `paths`, which are keys and tables without effect in an environment."""
    expected = (
        f"none: an aircraft without a mission has the tables {', '.join(_TABLES)} (events of the kinds "
        f"{', '.join(_EVENTS)}; no guidance or planner among the parts), a table aircraft without "
        f"{', '.join(_MISSION_KEYS)}, and the step of the argument step_s"
    )
    if problems := [Problem(path, "a value without effect in an environment", expected) for path in paths]:
        raise ScenarioError("environment", problems)


@compiled
def _trims(airframe: AbstractAirframe, environment: Environment, targets: TrimTarget) -> TrimPoint:
    return jax.vmap(lambda target: solve_trim(airframe, environment, target))(targets)


_TRIM_BATCH = 64
"""Number of trims that are solved together: one compiled program serves any number of cases."""


def trim_rows(
    airframe: AbstractAirframe, environment: Environment, targets: Mapping[str, Float[np.ndarray, " row"]]
) -> tuple[TrimPoint, Bool[np.ndarray, " row"]]:
    """Trim an aircraft in many flight conditions, one per index of the arrays in `targets`.

    The keys of `targets` are fields of `TrimTarget`; a missing field is 0. Returns the trim points with a leading axis,
    and flags: whether each trim converged within the aircraft's limits.
    """
    count = len(next(iter(targets.values())))
    names = [field.name for field in dataclasses.fields(TrimTarget)]
    columns = [np.asarray(targets.get(name, np.zeros(count)), dtype=float) for name in names]
    padded = pad_to_multiple(TrimTarget(*columns), _TRIM_BATCH)  # pyright: ignore[reportArgumentType]
    batches = [slice(first, first + _TRIM_BATCH) for first in range(0, count, _TRIM_BATCH)]
    parts = [jax.tree.map(np.asarray, _trims(airframe, environment, take_rows(padded, rows))) for rows in batches]
    points = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts)
    return points, points.converged & (points.excess <= LIMIT_TOLERANCE)


class FlightRange(eqx.Module):
    """Range of airspeed, altitude, path angle, bank and wind from which the starts of episodes are drawn."""

    speed_m_s: tuple[float, float] = eqx.field(static=True)  #: Least and greatest true airspeed.
    altitude_m: tuple[float, float] = eqx.field(static=True)  #: Least and greatest altitude above sea level.
    path_angle_deg: float = eqx.field(static=True, default=10.0)  #: Greatest path angle up or down.
    bank_deg: float = eqx.field(static=True, default=45.0)  #: Greatest bank of the steady turn to either side.
    wind_m_s: float = eqx.field(static=True, default=15.0)  #: Greatest speed of the steady wind from any direction.

    def __check_init__(self) -> None:
        for key, (least, greatest) in (("speed_m_s", self.speed_m_s), ("altitude_m", self.altitude_m)):
            if not -math.inf < least <= greatest < math.inf:
                raise ValueError(
                    f"flown.{key}: arrived {least:g} to {greatest:g}; expected a least and a greatest value, finite"
                )
        for key in ("path_angle_deg", "bank_deg", "wind_m_s"):
            if not 0.0 <= getattr(self, key) < math.inf:
                raise ValueError(f"flown.{key}: arrived {getattr(self, key):g}; expected a finite number from 0")


def default_range(vehicle: Vehicle) -> FlightRange:
    """Return the range of starts for an aircraft, with the defaults of `FlightRange` for angles and wind.

    - Airspeed: 1.1 times the least to 0.9 times the greatest airspeed that the aircraft's data and the autopilot's
      limits allow. If that range is narrow, the airspeed covers at least the middle quarter of the allowed airspeeds.
    - Altitude: 1 km to 8 km, as far as the aircraft's data extend; all their altitudes if they lie outside.

    Raises ValueError if the controller is not an `InversionAutopilot`, or if no airspeed is allowed.
    """
    airframe, limits = vehicle.airframe, autopilot_of(vehicle).limits
    low, high = valid_airspeed_range(airframe)
    slowest, fastest = max(low, float(limits.speed_min)), min(high, float(limits.speed_max))
    if not slowest < fastest:
        raise ValueError(
            f"aircraft: arrived limits of the airspeed of {float(limits.speed_min):g} to {float(limits.speed_max):g} "
            f"m/s; expected a range within the aircraft's data, {low:g} to {high:g} m/s"
        )
    bottom, top = getattr(getattr(airframe, "validity", None), "altitude", (0.0, np.inf))
    bottom, top = float(bottom), float(top)
    is_usual = bottom < 8000.0 and top > 1000.0
    altitudes = (max(1000.0, bottom), min(8000.0, top)) if is_usual else (bottom, top)
    margin = 0.375 * (fastest - slowest)
    speeds = min(1.1 * slowest, slowest + margin), max(0.9 * fastest, fastest - margin)
    return FlightRange(speeds, altitudes)


def steady_starts(vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> TrimPoint:
    """Draw `count` random steady flights in the range `flown`; return their trim points with a leading axis.

    The flights climb, descend and turn, on any course. Raises ValueError if at most 2 % of the drawn conditions are
    steady flights within the aircraft's limits.
    """
    points: list[TrimPoint] = []
    found = drawn = 0
    while drawn == 0 or found > 0.02 * drawn:  # the least share of steady flights among the drawn conditions
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


def stack_cases(
    vehicle: Vehicle, environment: Environment, flown: FlightRange, drawn: Any, decisions: int, rng: Rng, dtype: Any
) -> Stacked[Case]:
    """Return the cases of one aircraft, stacked along a leading axis.

    If the wind of `environment` is a `SteadyWind`, each case has this wind plus a random horizontal wind, with a
    speed up to `flown.wind_m_s` (uniform) and any direction. A wind of another class is the same in all cases.

    `drawn` must be the result of `AbstractTask.draw` in still air; this function adds the wind to the velocity of each
    start. `decisions` is the number of decisions of a full episode, `dtype` the floating-point precision.
    """
    count = len(drawn[0].mu)
    speed, direction = rng.uniform(0.0, flown.wind_m_s, count), rng.uniform(-np.pi, np.pi, count)
    wind_n = np.stack([speed * np.cos(direction), speed * np.sin(direction), np.zeros(count)], axis=-1)
    wind = environment.wind
    is_steady = isinstance(wind, SteadyWind)
    if is_steady:
        wind = SteadyWind(as_array(wind_n + np.asarray(wind.velocity_n)))
    environment = Environment(environment.atmosphere, wind, environment.earth)
    case = Case(vehicle, environment, drawn[0], drawn[1], as_array(np.full(count, decisions), np.int32))

    def rows(case: Case) -> Any:
        return case.start, case.task, case.decisions, *([case.environment.wind] if is_steady else [])

    nowhere, everywhere = (partial(jax.tree.map, lambda _, flag=flag: flag) for flag in (False, True))
    cases = Stacked(*eqx.partition(case, eqx.tree_at(rows, nowhere(case), replace_fn=everywhere)))
    environments = Stacked(cases.batched.environment, cases.shared.environment)
    velocities_b = _velocities_in_wind(environments, drawn[0].state)
    cases = eqx.tree_at(lambda c: c.batched.start.state.velocity_b, cases, velocities_b)
    return cast_to_precision(jax.tree.map(lambda leaf: as_array(leaf, None), cases), dtype)


@compiled_quickly
def _velocities_in_wind(environments: Stacked[Environment], states: AircraftState) -> Float[Array, "row 3"]:
    """Return the velocities over the ground (body axes, m/s): wind plus the velocities of starts in still air."""

    def in_wind(environment: Environment, state: AircraftState) -> Array:
        wind_n = environment.wind.at(state.position_n, 0.0)
        return state.velocity_b + rotate(rotation_from_quaternion(state.quaternion), wind_n)

    return environments.map(in_wind, states)
