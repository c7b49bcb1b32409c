"""Robustness study: flights of F-16s whose mass, aerodynamics and sensors differ from the autopilot's onboard model."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.dispersions import F16Dispersion
from anser.aircraft.f16 import F16_COEFFICIENTS
from anser.analysis.envelope import COMMANDS, accepted_errors
from anser.analysis.surveys import (
    FlightRows,
    Survey,
    SurveyResult,
    flight_attributes,
    flight_coordinates,
    sample_count,
    select_rows,
    trim_stop,
)
from anser.analysis.trim_points import AnyInversion, ConditionError, gains_for, map_points
from anser.control.limits import FlightLimits, default_limits
from anser.missions.batches import Progress
from anser.results.variable_labels import flag_attributes, scatter_rows, unit_attributes
from anser.scenario.schema_aircraft import Gains
from anser.sensing.ideal_sensors import DelayedSensors
from anser.steady.trim import TrimMapPoint, trim_target
from anser.units import DEG_RAD

DELAY_MAX_S = 0.2
"""Longest sensor delay of a study, s."""

_BOTH_WAYS = tuple(sign * part for part in (0.1, 0.2, 0.3, 0.4, 0.6, 0.9) for sign in (-1.0, 1.0))
"""Changes, as fractions, of a single factor that can be increased or decreased."""


@dataclasses.dataclass(frozen=True)
class Factor:
    """Property of the aircraft or its sensors that a study disperses; the value is `nominal` + `scale` * change.

    At a spread of 20 % the change is uniform in -0.2 to 0.2, or in 0 to 0.2 if `one_way`.
    """

    # name, description and unit of the property
    name: str
    meaning: str
    unit: str = "1"
    nominal: float = 1.0  # value without a change
    scale: float = 1.0  # increase of the value by a change of 1
    one_way: bool = False  # True if only positive changes are meaningful
    alone: tuple[float, ...] = _BOTH_WAYS  # changes in the flights that change this factor alone


FACTORS = (
    *(Factor(name, f"factor on {name}") for name in F16_COEFFICIENTS),
    Factor("thrust", "factor on thrust"),
    Factor("mass", "factor on mass"),
    *(Factor(f"second_moment_{axis}", f"factor on the second moment of mass along body {axis}") for axis in "xyz"),
    Factor("actuator_bandwidth", "factor on the bandwidth of all actuators"),
    # 100 %: a fifth of the chord; at 20 % the centre of gravity moves by 4 % of the chord forward or aft
    Factor("cg_shift", "shift of the centre of gravity aft, part of the mean chord", nominal=0.0, scale=0.2),
    # 100 %: a tenth of a second; at 20 % up to 20 ms, two periods of the autopilot
    Factor(
        "sensor_delay",
        "delay of all that is sensed",
        "s",
        nominal=0.0,
        scale=0.1,
        one_way=True,
        alone=(0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 1.0, 2.0),
    ),
)
"""Dispersed properties, each dispersed independently."""

_INDEX = {factor.name: k for k, factor in enumerate(FACTORS)}

SPREADS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Spreads (greatest changes, as fractions) in the part "spread" of a study."""

PARTS = ("dispersed", "spread", "alone")
"""Parts of a study: all factors dispersed at one spread; all dispersed at several spreads; a single factor changed."""


@dataclasses.dataclass(frozen=True)
class FlightPoint:
    """Steady level flight from which flights of a study start: true airspeed (m/s) and geometric altitude (m)."""

    speed_m_s: float
    altitude_m: float


CONDITIONS = (
    FlightPoint(150.0, 1000.0),
    FlightPoint(120.0, 1000.0),
    FlightPoint(220.0, 3000.0),
    FlightPoint(200.0, 6000.0),
    FlightPoint(230.0, 9000.0),
)
"""Default flight points of a study, spread over the airspeeds that the autopilot flies.

Each leaves a tenth of thrust and deflections. Equivalent airspeeds: 114 m/s (alpha 10 deg) to 190 m/s (alpha 3 deg)."""


@dataclasses.dataclass(frozen=True)
class Cases:
    """Flights of a robustness study; every array has one row per flight."""

    part: np.ndarray  # part of the study to which the flight belongs: index into `PARTS`
    condition: np.ndarray  # index of the flight point
    spread: np.ndarray  # greatest change as a fraction; in the part "alone", the single change
    alone: np.ndarray  # index of the single changed factor; -1 if all are changed
    changes: np.ndarray  # change of each of `FACTORS`, shape (n, factors)

    @property
    def values(self) -> np.ndarray:
        """Values of all `FACTORS` in each flight, in the factors' units, shape (n, factors)."""
        nominal, scale = (np.array([getattr(f, name) for f in FACTORS]) for name in ("nominal", "scale"))
        return nominal + scale * self.changes

    def __add__(self, addend: "Cases") -> "Cases":
        fields = [f.name for f in dataclasses.fields(self)]
        return Cases(*(np.concatenate([getattr(self, name), getattr(addend, name)]) for name in fields))


def dispersed_cases(
    flights: int, spread: float, seed: int, conditions: int = len(CONDITIONS), *, part: int = 0
) -> Cases:
    """Return `flights` cases with all `FACTORS` changed at random, uniformly and independently, by up to `spread`.

    The flights are distributed evenly over the flight points, whose number is `conditions`. `part` is an index into
    `PARTS`; seed and part determine the random numbers.
    """
    draws = np.random.default_rng((seed, part)).uniform(-1.0, 1.0, (flights, len(FACTORS)))
    draws = np.where([factor.one_way for factor in FACTORS], np.abs(draws), draws)
    condition, alone = np.arange(flights) % conditions, np.full(flights, -1)
    return Cases(np.full(flights, part), condition, np.full(flights, spread), alone, spread * draws)


def spread_cases(flights: int, seed: int, conditions: int = len(CONDITIONS), spreads: tuple = SPREADS) -> Cases:
    """Return `flights` dispersed cases for each of `spreads`; all spreads have the same random numbers, scaled."""
    first, *others = (dispersed_cases(flights, spread, seed, conditions, part=1) for spread in spreads)
    return sum(others, first)


def single_factor_cases(conditions: int = len(CONDITIONS), factors: tuple[str, ...] | None = None) -> Cases:
    """Return cases in which a single factor has each of the changes `Factor.alone`, at each flight point.

    `conditions` is the number of flight points; `factors` are names, None: all of `FACTORS`.
    """
    factor_names = [f.name for f in FACTORS] if factors is None else factors
    combinations = [
        (_INDEX[name], change, condition)
        for name in factor_names
        for change in FACTORS[_INDEX[name]].alone
        for condition in range(conditions)
    ]
    factor, change, condition = (np.array(column) for column in zip(*combinations, strict=True))
    changes = np.zeros((len(combinations), len(FACTORS)))
    changes[np.arange(len(combinations)), factor] = change
    return Cases(np.full(len(combinations), 2), condition, change, factor, changes)


def dispersion_of(values: np.ndarray) -> tuple[F16Dispersion, jnp.ndarray]:
    """Return the airframe dispersions and the sensor delays (s) of values of `FACTORS`, shape (n, factors)."""
    by_name = dict(zip(_INDEX, jnp.asarray(values, dtype=float).T, strict=True))
    dispersion = F16Dispersion(
        coefficients=jnp.stack([by_name[name] for name in F16_COEFFICIENTS], axis=1),
        second_moments=jnp.stack([by_name[f"second_moment_{axis}"] for axis in "xyz"], axis=1),
        **{name: by_name[name] for name in ("thrust", "mass", "actuator_bandwidth", "cg_shift")},
    )
    return dispersion, by_name["sensor_delay"]


_INVERSIONS: tuple[AnyInversion, ...] = ("model", "incremental", "adaptive")
_COMMAND = next(command for command in COMMANDS if command.name == "all")
_FLIGHTS_OF_SWEEP = 200


@dataclasses.dataclass(frozen=True)
class RobustnessStudy(SurveyResult):
    """Result of `robustness_study`: dispersions over (flight), metrics and outcomes over (inversion, flight).

    If the dispersed aircraft has no steady flight, metrics are NaN and the outcome is 0 ("not_flown").
    """


def robustness_study(
    variant: str = "textbook",
    *,
    flights: int = 1000,
    spread: float = 0.2,
    seed: int = 0,
    sweep: bool = False,
    conditions: Sequence[FlightPoint] = CONDITIONS,
    duration_s: float = 40.0,
    step_s: float = 0.01,
    cases: Cases | None = None,
    progress: Progress | None = None,
) -> RobustnessStudy:
    """Fly dispersed F-16s with the autopilot of the nominal F-16, in the standard atmosphere and still air.

    From level trim, each dispersed aircraft flies simultaneous steps of +10 m/s, +3 deg path angle and +20 deg course.
    The autopilot has the published gains, default limits and no information on the dispersion. The same aircraft are
    flown with model-based, incremental and adaptive inversion.

    Raises ConditionError if the nominal aircraft has no steady flight at a condition or the command exceeds the
    autopilot's speed limits, and ValueError if the variant is unknown or a number is out of range.

    Parameters
    ----------
    flights, spread, seed
        Number of flights with each inversion, greatest change as a fraction (0 to 0.9), and seed of the random numbers.
    sweep
        True: also 200 flights at each of several spreads, and flights with a single factor changed.
    conditions
        Steady flights from which the commands start.
    duration_s, step_s
        Duration of a flight; sampling period of the autopilot.
    cases
        Cases to fly; None: cases from `flights`, `spread` and `sweep`.
    variant
        Variant of the F-16.
    progress
        Called with a description of the current work and the completed part, 0 to 1; None: no reports.
    """
    if flights < 1 or not 0.0 <= spread <= 0.9:
        raise ValueError(f"arrived flights {flights}, spread {spread:g}; expected 1 or more, 0 to 0.9")
    count = sample_count(duration_s, step_s)
    survey = Survey("f16", variant, progress)
    if cases is None:
        cases = dispersed_cases(flights, spread, seed, len(conditions))
        if sweep:
            cases += spread_cases(_FLIGHTS_OF_SWEEP, seed, len(conditions)) + single_factor_cases(len(conditions))
    limits = default_limits(survey.airframe.alpha_range)
    points = jax.vmap(trim_target)(
        jnp.asarray([point.speed_m_s for point in conditions]), jnp.asarray([point.altitude_m for point in conditions])
    )

    def trim_cases(selected_cases: Cases, end: float) -> TrimMapPoint:
        rows = select_rows(points, selected_cases.condition), dispersion_of(selected_cases.values)[0]
        description = f"trimming {len(selected_cases.condition)} aircraft"
        return survey.evaluate(description, map_points, (survey.airframe, survey.environment), rows, span=(0.0, end))

    undispersed = dispersed_cases(len(conditions), 0.0, seed, len(conditions))
    _check_flyable(trim_cases(undispersed, 0.0), limits, conditions)
    trims = trim_cases(cases, 0.1)
    rows = (trims.trim, select_rows(points, cases.condition), *dispersion_of(cases.values))
    trim, target, dispersion, delay = select_rows(rows, np.asarray(trims.trimmable))
    size = np.array(_COMMAND.size)
    tolerance = accepted_errors(size)
    sizes, tolerances = (jnp.broadcast_to(channels, (len(delay), 3)) for channels in (size, tolerance))
    sensors = DelayedSensors(delay, DELAY_MAX_S, step_s)
    share = 0.9 / len(_INVERSIONS)
    variables = [
        survey.fly(
            f"flying {len(delay)} flights, {inversion} inversion",
            FlightRows(trim, target, sizes, tolerances, None, dispersion, sensors, inversion == "adaptive"),
            gains_for(inversion),
            limits,
            step_s,
            count,
            span=(0.1 + share * k, 0.1 + share * (k + 1)),
        )
        for k, inversion in enumerate(_INVERSIONS)
    ]
    attributes = {
        "command": _COMMAND.meaning,
        "seed": seed,
        "spread_percent": 100 * spread,
        "sensor_bandwidth_rad_s": Gains().sensor_bandwidth_rad_s,
        "tolerance_airspeed_m_s": float(tolerance[0]),
        "tolerance_path_angle_deg": float(tolerance[1] / DEG_RAD),
        "tolerance_course_deg": float(tolerance[2] / DEG_RAD),
        **flight_attributes(count, step_s, limits),
    }
    names = [f"{point.speed_m_s:g} m/s, {point.altitude_m:g} m" for point in conditions]
    coordinates: dict[str, Any] = {
        "inversion": ("inversion", np.array(_INVERSIONS), unit_attributes("", "What the autopilot inverts")),
        **_factor_coordinates(),
        "condition_meaning": ("place", np.array(names)),
        **flight_coordinates(survey.airframe.actuators.names),
    }
    data = _case_variables(cases, names)
    data["trim_stop"] = ("flight", *trim_stop(trims, "What stops the steady flight"))
    for name, (_, labels, dimensions) in variables[0].items():
        values = np.stack([scatter_rows(columns[name][0], np.asarray(trims.trimmable)) for columns in variables])
        data[name] = (("inversion", "flight", *dimensions), values, labels)
    return survey.result(RobustnessStudy, data, coordinates, attributes)


def _case_variables(cases: Cases, conditions: Sequence[str]) -> dict[str, Any]:
    labels = flag_attributes("Steady flight that is left", conditions)
    spread = unit_attributes("percent", "Greatest change, or the only one")
    alone = unit_attributes("1", "Index of the only factor that is changed; -1: all are")
    values = unit_attributes("1", "Value of what is dispersed (factor_unit)")
    return {
        "part": ("flight", cases.part.astype(np.int32), flag_attributes("Part of the study", PARTS)),
        "condition": ("flight", cases.condition.astype(np.int32), labels),
        "spread_percent": ("flight", 100.0 * cases.spread, spread),
        "alone": ("flight", cases.alone.astype(np.int32), alone),
        "factor_value": (("flight", "factor"), cases.values, values),
    }


def _factor_coordinates() -> dict[str, Any]:
    labels = {
        "name": unit_attributes("", "What is dispersed"),
        "meaning": {},
        "unit": {},
        "nominal": unit_attributes("1", "Value without a change (factor_unit)"),
        "scale": unit_attributes("1", "What a change of 100 % adds (factor_unit)"),
    }
    return {
        "factor" if field == "name" else f"factor_{field}": (
            "factor",
            np.array([getattr(factor, field) for factor in FACTORS]),
            attributes,
        )
        for field, attributes in labels.items()
    }


def _check_flyable(nominal: TrimMapPoint, limits: FlightLimits, conditions: Sequence[FlightPoint]) -> None:
    low, high = float(limits.speed_min), float(limits.speed_max)
    for point, steady in zip(conditions, np.asarray(nominal.trimmable), strict=True):
        if not steady:
            raise ConditionError(
                f"The nominal aircraft has no steady level flight at {point.speed_m_s:g} m/s and {point.altitude_m:g} m"
                " (anser trim says why)."
            )
        if not low <= point.speed_m_s + _COMMAND.speed_m_s <= high or point.speed_m_s < low:
            raise ConditionError(
                f"The autopilot flies {low:g} to {high:g} m/s; {point.speed_m_s:g} m/s and the commanded "
                f"{_COMMAND.speed_m_s:+g} m/s are not within."
            )
