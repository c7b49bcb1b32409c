"""Trim of an aircraft, and functions that all analyses share: airframe, airspeed, checks of arguments, gains."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe, refuse_impossible_body
from anser.aircraft.dispersions import F16Dispersion, dispersed_f16
from anser.aircraft.f16 import AbstractF16
from anser.aircraft.motion import air_data_and_forces
from anser.aircraft_files.library import load_airframe
from anser.aircraft_files.sources import VARIANTS
from anser.compiling.options import compiled, compiled_quickly, enable_compilation_cache
from anser.constants import STEP_MAX_S, STEP_MIN_S
from anser.control.gains import AutopilotGains, Bandwidths, automatic_gains, derived_bandwidths, published_gains
from anser.environment.air import AIRSPEED_FORMS, true_airspeed
from anser.environment.atmosphere import AbstractAtmosphere, Air, StandardAtmosphere
from anser.environment.environment import Environment, standard_environment
from anser.numerics.arrays import as_array
from anser.scenario.schema_aircraft import Gains
from anser.shapes import Scalar
from anser.spatial.rotations import euler_from_quaternion
from anser.spatial.wind_axes import air_direction_b
from anser.steady.trim import TrimMapPoint, TrimPoint, TrimTarget, solve_trim, trim_map_point, trim_target
from anser.steady.trim_diagnosis import nearest_trims, trim_violations
from anser.units import DEG_RAD, RAD_DEG
from anser.variables import surface_label

Inversion = Literal["model", "incremental"]
AnyInversion = Literal[Inversion, "adaptive"]

compiled_trim = compiled_quickly(solve_trim, "trim")


class ConditionError(ValueError):
    """Error: a steady flight does not exist, is not held by the autopilot, or is within 1 deg of the vertical."""


def resolve_airframe(
    aircraft: str | AbstractAirframe, variant: str = "textbook", x_cg_over_c: float | None = None
) -> tuple[AbstractAirframe, dict[str, str | int | float]]:
    """Return the airframe of a name, file or object, and a description of the airframe for the attributes of datasets.

    The description has `aircraft` (name, path or "custom"), `variant` of the library's F-16, and a given `x_cg_over_c`.

    Raises ValueError if `aircraft` or the variant is unknown, if a variant or centre of gravity is given for an
    airframe other than the library's F-16, or if mass properties, wing area or lengths are impossible. Raises
    ScenarioError if the aircraft file is not valid.

    Parameters
    ----------
    aircraft
        Name of an airframe of the library or of an entry point, path of an aircraft file, or an airframe.
    variant, x_cg_over_c
        Variant of the library's F-16, and its centre of gravity as a fraction of the mean chord (None: the variant's).
    """
    if isinstance(aircraft, str):
        description: dict[str, Any] = {"aircraft": aircraft}
        if aircraft in VARIANTS:
            description["variant"] = variant
        if x_cg_over_c is not None:
            description["x_cg_over_c"] = float(x_cg_over_c)
        return load_airframe(aircraft, variant, x_cg_over_c), description
    if not isinstance(aircraft, AbstractAirframe):
        raise ValueError(
            f"aircraft: arrived {type(aircraft).__name__}; expected the name of an airframe, the path of an aircraft "
            "file, or an object of a subclass of anser.aircraft.AbstractAirframe"
        )
    if variant != "textbook":
        raise ValueError(f"variant: arrived {variant!r} with an airframe of your own; expected none")
    if x_cg_over_c is not None:
        raise ValueError(
            f"x_cg_over_c: arrived {x_cg_over_c} with an airframe of your own; expected None, "
            "and the airframe built with the centre of gravity that it is to have"
        )
    refuse_impossible_body(aircraft, type(aircraft).__name__)
    return aircraft, {"aircraft": "custom"}


def airframe_label(attributes: Mapping[str, Any]) -> str:
    """Return "name (variant)", or the name alone, from the description of an airframe by `resolve_airframe`."""
    return f"{attributes['aircraft']} ({attributes['variant']})" if "variant" in attributes else attributes["aircraft"]


def require_seconds(name: str, value: Any) -> None:
    """Raise ValueError, with the argument's name in the message, unless `value` is a positive, finite number (s)."""
    if not isinstance(value, int | float | np.number) or not 0.0 < value < np.inf:
        raise ValueError(f"{name}: arrived {value!r}; expected a positive number of seconds")


def require_step(step_s: Any) -> None:
    """Raise ValueError unless `step_s`, the step of integration and autopilot, is within the range of a scenario."""
    if not isinstance(step_s, int | float | np.number) or not STEP_MIN_S <= step_s <= STEP_MAX_S:
        raise ValueError(
            f"step_s: arrived {step_s!r}; expected a number from {STEP_MIN_S:g} to {STEP_MAX_S:g} s, as in a scenario "
            "(a coarser output of a flight: record_period_s)"
        )


def require_inversion(inversion: str) -> None:
    """Raise ValueError unless `inversion` is "model" or "incremental"."""
    if inversion not in ("model", "incremental"):
        raise ValueError(f'inversion: arrived {inversion!r}; expected "model" or "incremental"')


def gains_for(inversion: AnyInversion, gains: AutopilotGains | None = None) -> AutopilotGains:
    """Return `gains` (None: published gains of the F-16) with the sensor bandwidth (rad/s) that an inversion requires.

    The bandwidth is 0 for "model"; for another inversion it is the default of a scenario.
    """
    bandwidth = 0.0 if inversion == "model" else Gains().sensor_bandwidth_rad_s
    base_gains = published_gains() if gains is None else gains
    return eqx.tree_at(lambda g: g.sensor_bandwidth, base_gains, jnp.asarray(bandwidth, dtype=float))


def survey_gains(
    airframe: AbstractAirframe,
    environment: Environment,
    trims: TrimPoint,
    step_s: float,
    inversion: Inversion,
    gains: AutopilotGains | None = None,
) -> tuple[AutopilotGains, AutopilotGains | None]:
    """Return autopilot gains for a batch of trim points: gains common to all, and gains of each trim point or None.

    If `gains` is given or the airframe is an F-16 (published gains), only the common gains apply. For another aircraft,
    the gains derived at each trim point replace the common gains. `step_s` is the sampling period, s.
    """
    common = gains_for(inversion, gains)
    if gains is not None or isinstance(airframe, AbstractF16):
        return common, None
    bandwidths = _bandwidths(airframe, environment, trims, jnp.asarray(step_s, dtype=float))
    rows = jax.vmap(automatic_gains)(bandwidths)
    sensor_bandwidth = jnp.broadcast_to(common.sensor_bandwidth, len(trims.alpha))
    return common, eqx.tree_at(lambda g: g.sensor_bandwidth, rows, sensor_bandwidth)


@compiled
def _bandwidths(airframe: AbstractAirframe, environment: Environment, trims: TrimPoint, step: Scalar) -> Bandwidths:
    def bandwidths(trim: TrimPoint) -> Bandwidths:
        condition = air_data_and_forces(airframe, environment, 0.0, trim.state)
        return derived_bandwidths(airframe, condition, trim.state.surfaces, trim.power, step)

    return jax.vmap(bandwidths)(trims)


def steady_trim(airframe: AbstractAirframe, environment: Environment, target: TrimTarget) -> TrimPoint:
    """Return the trim point of a steady flight; raises ConditionError, with the nearest trim points, if none exists."""
    trim = compiled_trim(airframe, environment, target)
    if trim_violations(airframe, environment, trim):
        raise ConditionError(nearest_trims(airframe, environment, target).message())
    return trim


def dispersed_airframe(airframe: AbstractAirframe, dispersion: F16Dispersion | None) -> AbstractAirframe:
    """Return the F-16 with the deviations of `dispersion`, or the unchanged airframe if `dispersion` is None.

    Raises TypeError if a dispersion is given for an airframe other than an F-16.
    """
    if dispersion is None:
        return airframe
    if not isinstance(airframe, AbstractF16):
        raise TypeError(f"expected an F16, not a {type(airframe).__name__}")
    return dispersed_f16(airframe, dispersion)


@compiled
def map_points(
    fixed: tuple[AbstractAirframe, Environment], rows: tuple[TrimTarget, F16Dispersion | None]
) -> TrimMapPoint:
    """Return the trim points of many steady flights, with margins to limits, in one compiled batch.

    `rows` has the trim target and the deviations of the F-16 for each flight (None: no deviations).
    """
    airframe, environment = fixed

    def map_point(target: TrimTarget, dispersion: F16Dispersion | None) -> TrimMapPoint:
        return trim_map_point(dispersed_airframe(airframe, dispersion), environment, target)

    return jax.vmap(map_point)(*rows)


_HEAVY_KG = 1000.0
"""Mass above which thrust is printed in kN instead of N, kg."""
_ROUNDING = 1e-12
"""Absolute value below which a quantity is printed as zero, such as the bank of straight flight."""


@dataclass(frozen=True, repr=False)
class TrimResult:
    """Result of a trim, which prints as a list of quantities (name, value, unit) or as the diagnosis.

    `diagnosis` names the violated limit and the nearest trim points, and is None if the steady flight exists.
    `condition` has true airspeed, altitude, path angle, turn and pitch rate, with units in the names.
    """

    point: TrimPoint
    quantities: tuple[tuple[str, float, str], ...]
    diagnosis: str | None
    condition: Mapping[str, float] = field(default_factory=dict)
    # mass and hash of the aircraft, and the air: a flight accepts only a trim of the same aircraft and air
    mass_kg: float = math.nan
    airframe_hash: str = ""
    atmosphere: AbstractAtmosphere = field(default_factory=StandardAtmosphere)

    def __repr__(self) -> str:
        if self.diagnosis is not None:
            return f"no steady flight: {self.diagnosis}"
        widest = max(len(name) for name, _, _ in self.quantities)
        lines = (f"  {name:<{widest}}  {value:12.6f} {unit}".rstrip() for name, value, unit in self.quantities)
        return "\n".join(["steady flight", *lines])

    def _repr_html_(self) -> str:
        from anser.results.documents import notebook_table

        if self.diagnosis is not None:
            return notebook_table("no steady flight", [], [self.diagnosis])
        cells = [{"quantity": name, "value": f"{value:.6f}", "unit": unit} for name, value, unit in self.quantities]
        return notebook_table("steady flight", cells)


def trim(
    aircraft: str | AbstractAirframe,
    speed_m_s: float | None = None,
    altitude_m: float | None = None,
    path_angle_deg: float = 0.0,
    turn_rate_deg_s: float = 0.0,
    *,
    speed_cas_m_s: float | None = None,
    speed_eas_m_s: float | None = None,
    mach: float | None = None,
    pitch_rate_deg_s: float = 0.0,
    variant: str = "textbook",
    x_cg_over_c: float | None = None,
    environment: Environment | None = None,
) -> TrimResult:
    """Compute a steady flight of an aircraft: angles, deflections, throttle and power, or a diagnosis if none exists.

    Raises ValueError if the altitude is missing, if not exactly one airspeed is given, if a number is not valid, or if
    a pitch rate is combined with a turn. Errors of the aircraft: see `resolve_airframe`.

    Parameters
    ----------
    aircraft, variant, x_cg_over_c
        Name of an airframe, path of an aircraft file, or an airframe; variant and centre of gravity (fraction of the
        mean chord) of the F-16.
    speed_m_s, altitude_m
        True airspeed and geometric altitude; the altitude is required.
    speed_cas_m_s, speed_eas_m_s, mach
        Calibrated or equivalent airspeed, or Mach number, instead of the true airspeed.
    path_angle_deg, turn_rate_deg_s
        Climb angle through the air, and rate of the course, right positive.
    pitch_rate_deg_s
        Body pitch rate of a pull-up with wings level and no roll and yaw rate ([SL] section 3.6); not in a turn.
    environment
        Air, wind and Earth; None: standard atmosphere and gravity, no wind.
    """
    enable_compilation_cache()
    environment = standard_environment() if environment is None else environment
    speed_m_s, altitude_m = flight_point(environment, altitude_m, speed_m_s, speed_cas_m_s, speed_eas_m_s, mach)
    _require_numbers(path_angle_deg=path_angle_deg, turn_rate_deg_s=turn_rate_deg_s, pitch_rate_deg_s=pitch_rate_deg_s)
    airframe, _ = resolve_airframe(aircraft, variant, x_cg_over_c)
    turn_rate, pitch_rate = turn_rate_deg_s * DEG_RAD, pitch_rate_deg_s * DEG_RAD
    target = trim_target(speed_m_s, altitude_m, path_angle_deg * DEG_RAD, turn_rate=turn_rate, pitch_rate=pitch_rate)
    point = compiled_trim(airframe, environment, target)
    diagnosis = None
    if trim_violations(airframe, environment, point):
        nearest = nearest_trims(airframe, environment, target)
        # at a limit, rounding can remove the violation in the second trim: the flight then exists
        diagnosis = nearest.message() if nearest.violations else None
    condition = {
        "speed_m_s": speed_m_s,
        "altitude_m": altitude_m,
        "path_angle_deg": path_angle_deg,
        "turn_rate_deg_s": turn_rate_deg_s,
        "pitch_rate_deg_s": pitch_rate_deg_s,
    }
    mass_kg = float(airframe.mass_properties.mass)
    return TrimResult(
        point,
        _quantities(airframe, environment.atmosphere, point, altitude_m, speed_m_s),
        diagnosis,
        condition,
        mass_kg,
        airframe_hash(airframe),
        environment.atmosphere,
    )


def airframe_hash(airframe: AbstractAirframe) -> str:
    """Return the SHA-256 (hexadecimal) of an airframe's class name and numbers."""
    digest = hashlib.sha256(type(airframe).__qualname__.encode())
    for leaf in jax.tree.leaves(eqx.filter(airframe, eqx.is_array_like)):
        digest.update(np.asarray(leaf).tobytes())
    return digest.hexdigest()


@compiled_quickly
def _air_at(atmosphere: AbstractAtmosphere, altitude: Scalar) -> Air:
    return atmosphere.at(altitude)


def flight_point(
    environment: Environment,
    altitude_m: float | None,
    speed_m_s: float | None = None,
    speed_cas_m_s: float | None = None,
    speed_eas_m_s: float | None = None,
    mach: float | None = None,
) -> tuple[float, float]:
    """Return true airspeed (m/s) and altitude (m), from a true, calibrated or equivalent airspeed or a Mach number.

    Raises ValueError if no altitude or not exactly one airspeed is given, if a given value is not a finite number, or
    if the airspeed is not positive.
    """
    values = dict(zip(AIRSPEED_FORMS, (speed_m_s, speed_cas_m_s, speed_eas_m_s, mach), strict=True))
    airspeeds = {form: value for form, value in values.items() if value is not None}
    if len(airspeeds) != 1:
        arrived = " and ".join(airspeeds) or "nothing"
        raise ValueError(f"airspeed: arrived {arrived}; expected one of {', '.join(AIRSPEED_FORMS)}")
    if altitude_m is None:
        raise ValueError("altitude_m: arrived nothing; expected the geometric altitude, m")
    ((form, value),) = airspeeds.items()
    for name, number in ((form, value), ("altitude_m", altitude_m)):
        if not isinstance(number, int | float | np.integer | np.floating) or not math.isfinite(number):
            raise ValueError(f"{name}: arrived {number!r}; expected a finite number")
    if value <= 0.0:
        raise ValueError(f"{form}: arrived {value:g}; expected a positive airspeed")
    if form == "speed_m_s":
        return value, altitude_m
    air = jax.tree.map(float, _air_at(environment.atmosphere, as_array(altitude_m)))
    return float(true_airspeed(form, float(value), air)), altitude_m


def _require_numbers(**condition: float) -> None:
    """Raise ValueError unless all values are finite and `path_angle_deg` is between -90 and 90 deg."""
    for name, value in condition.items():
        if not isinstance(value, int | float | np.integer | np.floating) or not math.isfinite(value):
            raise ValueError(f"{name}: arrived {value!r}; expected a finite number")
    if abs(condition["path_angle_deg"]) >= 90.0:
        raise ValueError(
            f"path_angle_deg: arrived {condition['path_angle_deg']:g}; expected more than -90, less than 90"
        )


@compiled_quickly
def _derived_quantities(
    airframe: AbstractAirframe, atmosphere: AbstractAtmosphere, point: TrimPoint, altitude: Scalar, speed: Scalar
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Return roll and pitch (rad), thrust along body x (N) and Mach number of a trim point."""
    roll, pitch, _ = euler_from_quaternion(point.state.quaternion)
    data = air_data(speed * air_direction_b(point.alpha, point.beta), altitude, atmosphere.at(altitude))
    return roll, pitch, airframe.engine.propulsion(point.power, data).force_b[0], data.mach


def _quantities(
    airframe: AbstractAirframe, atmosphere: AbstractAtmosphere, point: TrimPoint, altitude_m: float, speed_m_s: float
) -> tuple[tuple[str, float, str], ...]:
    roll, pitch, thrust, mach = map(
        float, _derived_quantities(airframe, atmosphere, point, as_array(altitude_m), as_array(speed_m_s))
    )
    is_heavy = float(airframe.mass_properties.mass) > _HEAVY_KG
    flow = {"angle of attack": point.alpha, "sideslip": point.beta, "roll": roll, "pitch": pitch}
    rates = zip(("roll rate", "pitch rate", "yaw rate"), np.asarray(point.state.rates_b), strict=True)
    surfaces = zip(airframe.actuators.names, np.asarray(point.state.surfaces), strict=True)
    quantities = (
        *((name, float(angle) * RAD_DEG, "deg") for name, angle in flow.items()),
        *((name, float(rate) * RAD_DEG, "deg/s") for name, rate in rates),
        *((surface_label(name), float(angle) * RAD_DEG, "deg") for name, angle in surfaces),
        ("throttle", float(point.controls.throttle), "0 to 1"),
        ("engine power", float(point.power), "percent"),
        ("thrust", thrust / 1000, "kN") if is_heavy else ("thrust", thrust, "N"),
        ("Mach number", mach, ""),
    )
    return tuple((name, 0.0 if abs(value) < _ROUNDING else value, unit) for name, value, unit in quantities)
