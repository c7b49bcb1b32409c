"""Airframes: list, description, check against published data, and survey of coefficients, thrust and level flight."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.dave_ml_aircraft import DaveMlAircraft, DaveMlEngine
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.engines import JetEngine, NoEngine
from anser.aircraft.f16 import F16Engine
from anser.aircraft.propellers import ElectricPropeller, PistonPropeller
from anser.aircraft_files.check_data import CheckedValue, ModelCheck, check_model, compare_check_data
from anser.aircraft_files.findings import Finding, collect_findings, f16_findings
from anser.aircraft_files.library import is_aircraft_path, load_airframe
from anser.aircraft_files.schema import AirframeFile, DaveMlFile
from anser.aircraft_files.sources import AIRFRAMES, LIBRARY_FILES, VARIANTS, entry_points, library_file, read_airframe
from anser.airframe_data import COEFFICIENTS
from anser.analysis.trim_points import map_points, resolve_airframe
from anser.compiling.options import compiled, enable_compilation_cache
from anser.environment.environment import Environment, standard_environment
from anser.numerics.arrays import as_array
from anser.results.documents import version_attributes
from anser.results.variable_labels import scatter_rows, unit_attributes
from anser.shapes import Scalar
from anser.spatial.wind_axes import air_direction_b
from anser.steady.trim import trim_target
from anser.units import DEG_RAD, RAD_DEG

if TYPE_CHECKING:
    import xarray as xr


_ANGLES, _SPEEDS = 61, 28
_ALPHA = 2.0 * DEG_RAD
"""Fixed angle of attack of the coefficients over sideslip, rad."""
_F16_SPEEDS_M_S = (60.0, 320.0)
"""Airspeeds of the F-16, and of airframes whose data have no range of airspeeds, m/s."""
_COEFFICIENT_MEANINGS = ("Lift", "Drag", "Side force", "Roll moment", "Pitch moment", "Yaw moment")
POWERS = (0.0, 25.0, 50.0, 75.0, 100.0)
"""Engine powers for the thrust curves, percent."""


def survey_airframe(
    # name, file or object of an airframe, and variant of the F-16: see `resolve_airframe`
    aircraft: str | AbstractAirframe,
    variant: str = "textbook",
    *,
    altitude_m: float = 0.0,  # altitude of the thrust curves and of the level flights
    # least and greatest airspeed; None: the range of the airframe's data, or 60 to 320 m/s if unknown
    airspeeds_m_s: tuple[float, float] | None = None,
) -> "xr.Dataset":
    """Survey an airframe: aerodynamic coefficients, thrust, and level flight over airspeed.

    Raises ValueError if the airspeeds are not positive and ascending. Errors of the aircraft: see `resolve_airframe`.

    Returns
    -------
    xr.Dataset
        - `over_alpha`, `over_beta`: CL, CD, CY, Cl, Cm, Cn over `alpha` (deg), and over `beta` (deg) at 2 deg of alpha
        - `thrust` (N) over `airspeed` (m/s) and `power` (percent)
        - `trimmable` over `airspeed`: True if level flight is within all limits
        - `trim_alpha_deg`, `trim_power` (percent), `trim_surface_deg` over `airspeed`; NaN if no trim exists
    """
    enable_compilation_cache()
    airframe, attributes = resolve_airframe(aircraft, variant)
    environment = standard_environment()
    slowest, fastest = valid_airspeed_range(airframe) if airspeeds_m_s is None else airspeeds_m_s
    if not 0.0 < slowest < fastest < np.inf:
        raise ValueError(f"airspeeds_m_s: arrived {airspeeds_m_s!r}; expected two positive numbers, the lower first")
    speeds = np.linspace(slowest, fastest, _SPEEDS)
    mean_speed = as_array(float(np.mean(speeds)))
    alphas, betas = (
        np.linspace(float(low), float(high), _ANGLES) for low, high in (airframe.alpha_range, airframe.beta_range)
    )
    zeros = np.zeros(_ANGLES)
    over_alpha = _coefficients(airframe, environment, mean_speed, as_array(alphas), as_array(zeros))
    over_beta = _coefficients(airframe, environment, mean_speed, as_array(zeros + _ALPHA), as_array(betas))
    targets = jax.vmap(trim_target, in_axes=(0, None))(as_array(speeds), altitude_m)
    points = map_points((airframe, environment), (targets, None))
    thrust = _thrusts(airframe, environment, as_array(speeds), as_array(POWERS), as_array(altitude_m))
    converged = np.asarray(points.trim.converged)
    trim_alpha, trim_power, trim_surfaces = (
        scatter_rows(np.asarray(values)[converged], converged)
        for values in (points.trim.alpha * RAD_DEG, points.trim.power, points.trim.state.surfaces * RAD_DEG)
    )
    variables = (
        ("over_alpha", ("alpha", "coefficient"), over_alpha, "1", "Coefficient, no sideslip"),
        ("over_beta", ("beta", "coefficient"), over_beta, "1", "Coefficient over sideslip"),
        ("thrust", ("airspeed", "power"), thrust, "N", "Thrust"),
        ("trimmable", ("airspeed",), points.trimmable, "1", "Whether level flight is within all limits"),
        ("trim_alpha_deg", ("airspeed",), trim_alpha, "degree", "Angle of attack in level flight"),
        ("trim_power", ("airspeed",), trim_power, "percent", "Power in level flight"),
        ("trim_surface_deg", ("airspeed", "surface"), trim_surfaces, "degree", "Deflection in level flight"),
        ("alpha", ("alpha",), alphas * RAD_DEG, "degree", "Angle of attack"),
        ("beta", ("beta",), betas * RAD_DEG, "degree", "Sideslip"),
        ("airspeed", ("airspeed",), speeds, "m s-1", "True airspeed"),
        ("power", ("power",), POWERS, "percent", "Engine power"),
        ("coefficient", ("coefficient",), COEFFICIENTS, "", "Coefficient"),
        ("surface", ("surface",), airframe.actuators.names, "", "Control surface"),
    )
    data = {
        name: (dimensions, np.asarray(values), unit_attributes(unit, long_name))
        for name, dimensions, values, unit, long_name in variables
    }
    coordinates = {"coefficient_meaning": ("coefficient", np.array(_COEFFICIENT_MEANINGS))}
    attributes |= {"altitude_m": altitude_m, "dimensionless": int(_sizes(airframe) is not None)}
    import xarray as xr

    return xr.Dataset(data, coordinates, {**attributes, **version_attributes()})


def valid_airspeed_range(airframe: AbstractAirframe) -> tuple[float, float]:
    """Return the least and the greatest airspeed (m/s) of an airframe's data; 60 and 320 m/s if unknown."""
    if isinstance(airframe, DerivativeAircraft | DaveMlAircraft):
        low, high = (float(end) for end in airframe.validity.airspeed)
        if low > 0.0 and high < np.inf:
            return low, high
    return _F16_SPEEDS_M_S


def _sizes(airframe: AbstractAirframe) -> tuple[Scalar, Scalar, Scalar] | None:
    """Return wing area (m^2), span (m) and mean chord (m); None if the airframe lacks one of the three."""
    sizes = tuple(getattr(airframe, name, None) for name in ("wing_area", "span", "mean_chord"))
    return None if None in sizes else sizes  # pyright: ignore[reportReturnType]


@compiled
def _coefficients(
    airframe: AbstractAirframe, environment: Environment, V: Scalar, alphas: Array, betas: Array
) -> Float[Array, "angle 6"]:
    """Compute CL, CD, CY, Cl, Cm, Cn at pairs of alpha and beta (rad) for zero body rates and neutral surfaces.

    If the airframe lacks one of its `_sizes`, the results have units: forces (N) and moments (N m), each divided by the
    dynamic pressure (Pa).
    """
    sizes = _sizes(airframe)
    S, b, c = (jnp.ones(()),) * 3 if sizes is None else sizes
    air = environment.atmosphere.at(0.0)

    def coefficients_at(alpha: Scalar, beta: Scalar) -> Float[Array, "6"]:
        ca, sa = jnp.cos(alpha), jnp.sin(alpha)
        data = air_data(V * air_direction_b(alpha, beta), 0.0, air)
        neutral = airframe.actuators.scheduled_position(jnp.zeros(len(airframe.actuators.names)), data)
        wrench = airframe.aerodynamics(data, jnp.zeros(3), neutral)
        X, Y, Z = wrench.force_b / (data.qbar * S)
        moments = wrench.moment_b / (data.qbar * S * jnp.stack([b, c, b]))
        return jnp.concatenate([jnp.stack([X * sa - Z * ca, -X * ca - Z * sa, Y]), moments])

    return jax.vmap(coefficients_at)(alphas, betas)


@compiled
def _thrusts(
    airframe: AbstractAirframe, environment: Environment, speeds: Array, powers: Array, altitude: Scalar
) -> Float[Array, "speed power"]:
    air = environment.atmosphere.at(altitude)

    def thrust_at(V: Scalar, power: Scalar) -> Scalar:
        data = air_data(jnp.stack([V, 0.0 * V, 0.0 * V]), altitude, air)
        return airframe.engine.propulsion(power, data).force_b[0]

    return jax.vmap(jax.vmap(thrust_at, in_axes=(None, 0)), in_axes=(0, None))(speeds, powers)


@dataclass(frozen=True)
class AirframeEntry:
    """Entry in the list of airframes: `origin` is "library", "library, file" or "entry point ...".

    The data are valid in the range `airspeed_m_s`. If an entry point could not be loaded, `problem` is the reason, and
    only `name` and `origin` are set.
    """

    name: str
    origin: str
    mass_kg: float | None = None
    span_m: float | None = None
    airspeed_m_s: tuple[float, float] | None = None
    surfaces: tuple[str, ...] = ()
    problem: str | None = None


def list_airframes() -> list[AirframeEntry]:
    """Return the airframes of the library, then the airframes of entry points (plug-ins of installed packages)."""
    entries = [_library_entry(name, "library, file" if name in LIBRARY_FILES else "library") for name in AIRFRAMES]
    for name, point in entry_points().items():
        origin = f"entry point {point.value}"
        try:
            entries.append(_library_entry(name, origin))
        except (ImportError, AttributeError, TypeError, ValueError) as error:
            entries.append(AirframeEntry(name, origin, problem=f"{type(error).__name__}: {error}"))
    return entries


def _library_entry(name: str, origin: str) -> AirframeEntry:
    airframe = load_airframe(name)
    span = getattr(airframe, "span", None)
    mass_kg, span_m = float(airframe.mass_properties.mass), None if span is None else float(span)
    return AirframeEntry(name, origin, mass_kg, span_m, valid_airspeed_range(airframe), airframe.actuators.names)


def find_aircraft_file(name: str) -> AirframeFile | DaveMlFile | None:
    """Return the content of an aircraft file, given by library name or path; None for an airframe defined in code."""
    if is_aircraft_path(name):
        return read_airframe(name)
    return library_file(name) if name in LIBRARY_FILES else None


_ENGINES: dict[type, str] = {
    DaveMlEngine: "thrust as its DAVE-ML file has it",
    ElectricPropeller: "electric motor with propeller",
    F16Engine: "jet engine of the F-16",
    JetEngine: "jet engine",
    NoEngine: "none",
    PistonPropeller: "piston engine with propeller",
}
"""Descriptions of the engines by class; an engine of a different class is described by the class name."""


def describe_airframe(airframe: AbstractAirframe) -> list[tuple[str, str, str]]:
    """Return mass, inertia, size, surfaces, engine and valid ranges of an airframe as texts (name, value, unit)."""
    properties, actuators = airframe.mass_properties, airframe.actuators
    J = np.asarray(properties.inertia_b)
    quantities = [("mass", f"{float(properties.mass):.6g}", "kg")]
    quantities += [(f"J{axis}", f"{J[k, k]:.6g}", "kg m^2") for k, axis in enumerate(("xx", "yy", "zz"))]
    quantities += [
        (f"J{name}", f"{-J[index]:.6g}", "kg m^2")
        for name, index in (("xy", (0, 1)), ("xz", (0, 2)), ("yz", (1, 2)))
        if J[index] != 0.0
    ]
    for name, unit in (("span", "m"), ("wing_area", "m^2"), ("mean_chord", "m")):
        size = getattr(airframe, name, None)
        quantities += [] if size is None else [(name.replace("_", " "), f"{float(size):.6g}", unit)]
    lower, upper = (np.asarray(end) * RAD_DEG for end in (actuators.lower, actuators.upper))
    for k, name in enumerate(actuators.names):
        speed, lag = float(actuators.rate_limit[k]) * RAD_DEG, float(actuators.time_constant[k])
        quantities.append((name, f"{lower[k]:.4g} to {upper[k]:.4g}", f"deg, {speed:.4g} deg/s, lag {lag:.3g} s"))
    engine_class = type(airframe.engine)
    quantities.append(("engine", _ENGINES.get(engine_class, engine_class.__name__), ""))
    for description, bounds in (("angles of attack", airframe.alpha_range), ("sideslip angles", airframe.beta_range)):
        low, high = (float(end) * RAD_DEG for end in bounds)
        quantities.append((f"data valid for {description}", f"{low:.4g} to {high:.4g}", "deg"))
    low, high = valid_airspeed_range(airframe)
    quantities.append(("data valid for airspeeds", f"{low:.4g} to {high:.4g}", "m/s"))
    return quantities


def trim_speed_range(dataset: Any) -> tuple[float, float] | None:
    """Return the range of trimmable airspeeds (m/s) in a dataset of `survey_airframe`; None if the range is empty."""
    speeds: Sequence[float] = dataset["airspeed"].values[dataset["trimmable"].values]
    return (float(min(speeds)), float(max(speeds))) if len(speeds) else None


def check_dave_ml(path: str) -> ModelCheck:
    """Check a DAVE-ML file: compare the model with the check data, find probable errors, list inputs and outputs.

    Raises ScenarioError if the file is not a DAVE-ML file.
    """
    enable_compilation_cache()
    return check_model(path)


def check_airframe(aircraft: str, variant: str = "textbook") -> tuple[tuple[CheckedValue, ...], tuple[Finding, ...]]:
    """Return the comparison of an aircraft with the check data of its file, and probable errors of the data.

    The F-16 has no check data, and the comparison is empty. Raises ValueError if the airframe comes from an entry
    point, which has no file to check; ScenarioError if the aircraft file is not valid.
    """
    enable_compilation_cache()
    file = find_aircraft_file(aircraft)
    if file is not None:
        return compare_check_data(file), collect_findings(file)
    if aircraft not in VARIANTS:
        raise ValueError(f"{aircraft!r} is an airframe in code, without a file or tables that could be checked")
    return (), f16_findings(variant)
