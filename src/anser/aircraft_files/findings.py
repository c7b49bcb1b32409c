"""Search for probable errors in aircraft files and in the F-16's tables; a file with findings remains valid."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.air_data import AirData
from anser.aircraft.dave_ml_aircraft import DaveMlAircraft
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.engines import NoEngine
from anser.aircraft.f16 import variant_tables
from anser.aircraft.table_checks import GriddedTable, SuspectPoint, suspect_points
from anser.aircraft_files.build import build_airframe, file_models
from anser.aircraft_files.library import library_data
from anser.aircraft_files.schema import AirframeFile, DaveMlFile
from anser.aircraft_files.schema_tables import CoefficientTable
from anser.airframe_data import COEFFICIENTS
from anser.dave_ml.definition import Definition
from anser.dave_ml.model import Model
from anser.environment.atmosphere import StandardAtmosphere
from anser.numerics.arrays import as_array
from anser.units import DEG_RAD

_File = AirframeFile | DaveMlFile
_Airframe = DerivativeAircraft | DaveMlAircraft


@dataclass(frozen=True)
class Finding:
    """Probable error in a file: `location` is the key or the line; `text` has value, reason and expected value."""

    location: str
    text: str

    def __str__(self) -> str:
        return f"{self.location}: {self.text}"


_GAP = 4.0
"""Ratio of an interval between breakpoints to the median interval above which the interval counts as a gap."""
_AXIS_ORDER = ("alpha", "beta")


def table_findings(file: AirframeFile) -> Iterator[Finding]:
    """Yield findings for a file's coefficient tables: suspect points, gaps in axes, axes that are too short."""
    tables = {f"table[{k}]": table for k, table in enumerate(file.table)}
    for point in suspect_points({table_key: _sorted_coefficient_table(table) for table_key, table in tables.items()}):
        if point.table not in tables:
            text = f"at {_format_point(_AXIS_ORDER[:2], point.location)}: {describe_suspect(point)}"
            yield Finding("table", text)
            continue
        table = tables[point.table]
        over = _sorted_axes(table)
        coordinates = dict(zip(over, point.location, strict=True))
        axes = zip(table.over, table.breakpoints_deg, strict=True)
        brackets = "".join(f"[{points.index(coordinates[name])}]" for name, points in axes)
        text = f"{_format_point(over, point.location)}: {describe_suspect(point)}"
        yield Finding(f"{point.table}.values{brackets} ({table.replaces})", text)
    for table_key, table in tables.items():
        for axis, (name, points) in enumerate(zip(table.over, table.breakpoints_deg, strict=True)):
            axis_key = f"{table_key} ({table.replaces}), breakpoints_deg[{axis}]"
            yield from (Finding(axis_key, text) for text in _axis_findings(file, table, name, points))


def describe_suspect(point: SuspectPoint) -> str:
    """Return the text of a finding about a suspect point and its neighbours."""
    start = "most tables stand out from their" if math.isnan(point.value) else f"{point.value:.4g} stands out from its"
    neighbours = f", with {len(point.neighbours)} beside it in its row" if point.neighbours else ""
    return f"{start} neighbours by {point.score:.1f} times their scatter{neighbours}"


def _sorted_axes(table: CoefficientTable) -> tuple[str, ...]:
    """Return the arguments of a table in the order alpha, beta, surfaces."""
    return tuple(
        sorted(table.over, key=lambda name: _AXIS_ORDER.index(name) if name in _AXIS_ORDER else len(_AXIS_ORDER))
    )


def _sorted_coefficient_table(table: CoefficientTable) -> GriddedTable:
    over = _sorted_axes(table)
    axis_order = [table.over.index(name) for name in over]
    values = np.transpose(np.asarray(table.values, dtype=float), axis_order)
    return GriddedTable(tuple(np.asarray(table.breakpoints_deg[k], dtype=float) for k in axis_order), values)


def _format_point(over: Sequence[str], coordinates: Sequence[float]) -> str:
    return ", ".join(f"{name} {value:g} deg" for name, value in zip(over, coordinates, strict=True))


def _axis_findings(file: AirframeFile, table: CoefficientTable, name: str, points: Sequence[float]) -> Iterator[str]:
    steps = np.diff(points)
    for k in map(int, np.flatnonzero(steps > _GAP * np.median(steps))):
        yield f"a gap in {name} from {points[k]:g} to {points[k + 1]:g} deg, elsewhere every {np.median(steps):g} deg"
    ranges = {"alpha": file.validity.alpha_deg, "beta": file.validity.beta_deg}
    limits = ranges.get(name) or next(surface.stops_deg for surface in file.surface if surface.name == name)
    requirement = "the data are said to hold" if name in ranges else "the surface moves"
    extrapolation = "the last value is held" if table.beyond == "hold" else "the last slope goes on"
    if points[0] > limits[0]:
        yield f"{name} begins at {points[0]:g} deg, but {requirement} from {limits[0]:g} deg: {extrapolation}"
    if points[-1] < limits[1]:
        yield f"{name} ends at {points[-1]:g} deg, but {requirement} up to {limits[1]:g} deg: {extrapolation}"


_LEADING_AXES = ("angleOfAttack", "angleOfSideslip")
"""Inputs of the first two axes of the table check, along which points are compared with neighbours."""


def model_table_findings(file: DaveMlFile) -> Iterator[Finding]:
    """Yield findings for suspect points in the gridded tables of an aircraft's DAVE-ML files."""
    for part, model in file_models(file).items():
        for table, text in suspect_table_points(model, file.dave_ml.names):
            location = f"dave_ml.{part} ({table})" if table in model.definition.gridded else f"dave_ml.{part}"
            yield Finding(location, text)


def suspect_table_points(model: Model, aliases: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield table name ("all": all tables) and text for each suspect point in the gridded tables of a DAVE-ML file.

    `aliases` maps standard names (ANSI/AIAA S-119) to the names of the variables in the file.
    """
    definition = model.definition
    axes = {name: _axes(aliases, model, name) for name in definition.gridded}
    tables = {name: _sorted_model_table(definition, name, order) for name, order in axes.items()}
    for point in suspect_points(tables):
        if point.table in axes:
            over = [definition.breakpoints[definition.gridded[point.table].axes[k]] for k in axes[point.table]]
            names = [breakpoints.name or breakpoints.id for breakpoints in over]
        else:
            names = ["first axis", "second axis"]
        coordinates = ", ".join(f"{name} {value:g}" for name, value in zip(names, point.location, strict=True))
        yield point.table, f"{coordinates}: {describe_suspect(point)}"


def _axes(aliases: Mapping[str, str], model: Model, table: str) -> list[int]:
    """Return the indices of a gridded table's axes in the order angle of attack, sideslip, remaining arguments."""
    function = next((f for f in model.definition.functions if f.table == table), None)
    axes = range(len(model.definition.gridded[table].axes))
    if function is None:
        return list(axes)
    name_sets = [{name, aliases.get(name, name)} for name in _LEADING_AXES]

    def rank(axis: int) -> int:
        inputs = _inputs_of(model, function.arguments[axis].id)
        return next((k for k, names in enumerate(name_sets) if inputs and inputs <= names), len(name_sets))

    return sorted(axes, key=rank)


def _inputs_of(model: Model, identifier: str) -> set[str]:
    """Return the names of the inputs from which the variable with varID `identifier` is computed."""
    structure = model.evaluator.structure
    required = structure.required_variables({identifier}, set())
    return {structure.by_id[k].name for k in required if k in structure.inputs}


def _sorted_model_table(definition: Definition, name: str, axis_order: list[int]) -> GriddedTable:
    table = definition.gridded[name]
    points = tuple(definition.breakpoints[table.axes[k]].points for k in axis_order)
    return GriddedTable(points, np.transpose(np.asarray(table.values, dtype=float), axis_order))


_GRAVITY_M_S2 = 9.80665
_SMALL_ALPHA_DEG = 2.0
_GYRATION = {"Jxx_kg_m2": (0.04, 0.4), "Jyy_kg_m2": (0.04, 0.6), "Jzz_kg_m2": (0.06, 0.7)}
"""Radii of gyration as fractions of the span, lower and upper bound; wide, to detect wrong units only.

Raymer, *Aircraft Design*, table 16.1, has 0.17 to 0.25 of the span in roll."""
_CHORD = (0.5, 2.0)
"""Bounds of the mean chord over S/b: 1 for a rectangle, 4/3 for the mean aerodynamic chord of a triangle."""
_SLOPE_RATIO_MAX = 5
"""Ratio of lift slopes, file to wing theory or inverse, that suggests a wrong angle unit (rad and deg: 57)."""


def collect_findings(file: _File) -> tuple[Finding, ...]:
    """Return the probable errors of a valid file: in signs, units, proportions, tables, lift and thrust."""
    airframe = build_airframe(file)
    slopes = _slopes(airframe, file)
    findings = list(_sign_findings(file, slopes))
    if isinstance(file, AirframeFile):
        findings += [*_mirror_findings(file), *_slope_unit_findings(file, slopes), *_chord_findings(file)]
    findings += [*_angle_unit_findings(file), *_inertia_findings(file, airframe)]
    findings += model_table_findings(file) if isinstance(file, DaveMlFile) else table_findings(file)
    return (*findings, *_force_findings(file, airframe))


def level_air_data(
    V: float, alpha: float, beta: float = 0.0, altitude: float = 0.0, density: float | None = None
) -> AirData:
    """Return air data at airspeed V (m/s), flow angles (rad) and altitude (m) in the standard atmosphere.

    `density`, kg/m^3, replaces the standard density.
    """
    air = StandardAtmosphere().at(altitude)
    density = float(air.density) if density is None else density
    return AirData(
        *map(as_array, (V, alpha, beta, density, 0.5 * density * V * V, V / float(air.speed_of_sound), altitude))
    )


def _slopes(airframe: _Airframe, file: _File) -> dict[str, float]:
    """Return the stability and control derivatives by name, such as "Cm_alpha", and the drag coefficient "CD".

    The derivatives are per rad or per dimensionless rate, at sea level, at the middle of the valid airspeeds and at the
    valid alpha nearest to 2 deg; sideslip, rates and deflections are zero. Moments are about the centre of gravity.
    """
    alpha_min_deg, alpha_max_deg = file.validity.alpha_deg
    alpha = min(max(_SMALL_ALPHA_DEG, alpha_min_deg), alpha_max_deg) * DEG_RAD
    data = level_air_data(sum(file.validity.airspeed_m_s) / 2.0, alpha)
    angles, zero_rates, neutral = jnp.asarray([alpha, 0.0]), jnp.zeros(3), jnp.zeros(len(file.surface))
    slopes, values = _derivatives(airframe, data, angles, zero_rates, neutral)
    columns = np.concatenate(slopes, axis=1).T
    names = ("alpha", "beta", "p", "q", "r", *file.surfaces)
    return {
        f"{coefficient}_{name}": float(slope)
        for name, column in zip(names, columns, strict=True)
        for coefficient, slope in zip(COEFFICIENTS, column, strict=True)
    } | {"CD": float(values[1])}


def _lift_and_drag(force_b: jax.Array, alpha: jax.Array) -> tuple[jax.Array, jax.Array]:
    sa, ca = jnp.sin(alpha), jnp.cos(alpha)
    return force_b[0] * sa - force_b[2] * ca, -force_b[0] * ca - force_b[2] * sa


@jax.jit
def _derivatives(
    airframe: _Airframe, at: AirData, angles: jax.Array, reduced: jax.Array, surfaces: jax.Array
) -> tuple[Any, jax.Array]:
    """Return the derivatives of `COEFFICIENTS` in the flight condition `at`, and the coefficients.

    The derivatives are three arrays (coefficient, argument), with respect to `angles` (alpha, beta), `reduced` (p b/2V,
    q c/2V, r b/2V) and `surfaces`; angles in rad. Moments are about the centre of gravity.
    """
    b, c, S = airframe.span, airframe.mean_chord, airframe.wing_area

    def coefficients(angles: jax.Array, reduced: jax.Array, surfaces: jax.Array) -> tuple[jax.Array, jax.Array]:
        inner_data = AirData(at.V, angles[0], angles[1], at.density, at.qbar, at.mach, at.altitude)
        rates = reduced * 2.0 * at.V / jnp.stack([b, c, b])
        wrench = airframe.aerodynamics(inner_data, rates, surfaces)
        moments = wrench.moment_b / (at.qbar * S * jnp.stack([b, c, b]))
        forces = wrench.force_b / (at.qbar * S)
        values = jnp.concatenate([jnp.stack([*_lift_and_drag(forces, angles[0]), forces[1]]), moments])
        return values, values

    return jax.jacfwd(coefficients, argnums=(0, 1, 2), has_aux=True)(angles, reduced, surfaces)


_EXPECTED_SIGNS = (
    ("CL_alpha", 1, "lift that falls with the angle of attack"),
    ("Cl_p", -1, "a roll that its own rate drives on; damping is negative"),
    ("Cm_q", -1, "a pitch rate that drives itself on; damping is negative"),
    ("Cn_r", -1, "a yaw rate that drives itself on; damping is negative"),
    ("Cm_alpha", -1, "a nose that rises when the angle of attack does: unstable in pitch about the centre of gravity"),
    ("Cn_beta", 1, "a nose that turns away from the flow: unstable in yaw"),
    ("Cl_beta", -1, "a roll into the sideslip: dihedral the wrong way"),
    ("CY_beta", -1, "a side force toward the side that the air comes from"),
)
"""Derivatives with their usual sign, and the meaning of the opposite sign."""


def _sign_findings(file: _File, slopes: dict[str, float]) -> Iterator[Finding]:
    """Yield findings for derivatives of unusual sign or of 0, drag of 0 or less, and missing roll or pitch control."""
    for name, sign, meaning in _EXPECTED_SIGNS:
        location, value = _derivative_key(file, name), slopes[name]
        if value * sign < 0.0:
            yield Finding(location, f"{value:.4g} per rad near zero angles: {meaning}")
        elif value == 0.0:
            yield Finding(location, "0, or left out: expected a value of its own, which every aircraft has")
    if slopes["CD"] <= 0.0:
        text = f"a drag coefficient of {slopes['CD']:.4g}: expected a positive one"
        yield Finding(_derivative_key(file, "CD0"), text)
    for axis, coefficient in (("roll", "Cl"), ("pitch", "Cm")):
        if all(slopes[f"{coefficient}_{name}"] == 0.0 for name in file.surfaces):
            yield Finding("surface", f"no surface that makes a moment of {axis}: the aircraft cannot be flown")


def _mirror_findings(file: AirframeFile) -> Iterator[Finding]:
    """Yield findings for nonzero derivatives that contradict the mirror symmetry of an aircraft."""
    for name in ("CL_beta", "CD_beta", "Cm_beta", "CY_alpha", "Cl_alpha", "Cn_alpha"):
        value = getattr(file.aerodynamics, name)
        if value != 0.0:
            reason = "a part that changes sign with its angle, which the mirror image of an aircraft contradicts"
            yield Finding(f"aerodynamics.{name}", f"{value:.4g}: {reason}")


def _derivative_key(file: _File, name: str) -> str:
    """Return the key of a derivative in the file, or the key of the table that replaces the derivative."""
    if isinstance(file, DaveMlFile):
        return f"dave_ml.aerodynamics ({name})"
    coefficient, ending = name[:2], name[2:].removeprefix("_")
    for k, table in enumerate(file.table):
        if table.replaces == name or (table.replaces == coefficient and ending in ("0", *table.over)):
            return f"table[{k}] ({table.replaces})"
    return f"aerodynamics.{name}"


def _slope_unit_findings(file: AirframeFile, slopes: dict[str, float]) -> Iterator[Finding]:
    """Yield a finding if the lift slope differs so much from wing theory that the angle unit is probably wrong."""
    aspect = file.geometry.span_m**2 / file.geometry.wing_area_m2
    wing = 2.0 * math.pi * aspect / (aspect + 2.0)
    value = slopes["CL_alpha"]
    unit, other_unit = ("rad", "deg") if file.aerodynamics.per == "rad" else ("deg", "rad")
    if 0.0 < value < wing / _SLOPE_RATIO_MAX or value > wing * _SLOPE_RATIO_MAX:
        question = f"has about {wing:.1f}; is it given per {other_unit}, not per {unit}?"
        text = f"{value:.4g} per rad: a wing of aspect ratio {aspect:.1f} {question}"
        yield Finding(_derivative_key(file, "CL_alpha"), text)


def _angle_unit_findings(file: _File) -> Iterator[Finding]:
    """Yield findings for ranges, stops and rate limits so small that rad instead of deg is probable."""
    for key in ("alpha_deg", "beta_deg"):
        bounds = getattr(file.validity, key)
        if max(map(abs, bounds)) < 1.6:
            yield Finding(f"validity.{key}", f"[{bounds[0]:g}, {bounds[1]:g}] deg: narrow; are these rad?")
    for k, surface in enumerate(file.surface):
        if max(map(abs, surface.stops_deg)) < 1.6:
            text = f"{surface.stops_deg[1]:g} deg ({surface.name}): small; is it in rad?"
            key = "upper_deg" if surface.limit_deg is None else "limit_deg"
            yield Finding(f"surface[{k}].{key}", text)
        if surface.rate_limit_deg_s < 10.0:
            text = f"{surface.rate_limit_deg_s:g} deg/s ({surface.name}): slow; is it in rad/s?"
            yield Finding(f"surface[{k}].rate_limit_deg_s", text)


def _inertia_findings(file: _File, airframe: _Airframe) -> Iterator[Finding]:
    """Yield findings for moments of inertia whose radius of gyration does not fit the span (`_GYRATION`)."""
    span, mass = float(airframe.span), float(airframe.mass_properties.mass)
    values = np.diag(np.asarray(airframe.mass_properties.inertia_b))
    for (key, (lowest, highest)), value in zip(_GYRATION.items(), map(float, values), strict=True):
        key_path = f"mass.{key}" if file.mass is not None else f"dave_ml.inertia ({key.removesuffix('_kg_m2')})"
        radius = math.sqrt(value / mass) / span
        if not lowest <= radius <= highest:
            proportion = f"a radius of gyration of {radius:.3g} of the span, expected {lowest:g} to {highest:g}"
            yield Finding(key_path, f"{value:.4g} kg m^2: {proportion}; is the unit kg m^2?")


def _chord_findings(file: AirframeFile) -> Iterator[Finding]:
    """Yield a finding for a mean chord that does not fit wing area over span (`_CHORD`)."""
    geometry = file.geometry
    mean = geometry.wing_area_m2 / geometry.span_m
    if not _CHORD[0] <= geometry.mean_chord_m / mean <= _CHORD[1]:
        question = f"area over span is {mean:.3g} m; do span, area and chord belong to one wing, in m and m^2?"
        yield Finding("geometry.mean_chord_m", f"{geometry.mean_chord_m:g} m: {question}")


def _force_findings(file: _File, airframe: _Airframe) -> Iterator[Finding]:
    """Yield findings on level flight at sea level, over the valid airspeeds and angles of attack.

    Findings are a lift below the weight at every airspeed or, if not, at the least airspeed; and a full thrust that is
    not above the drag at any airspeed.
    """
    speed_min, speed_max = file.validity.airspeed_m_s
    weight = float(airframe.mass_properties.mass) * _GRAVITY_M_S2
    alphas, speeds = np.linspace(*file.validity.alpha_deg, 46) * DEG_RAD, np.linspace(speed_min, speed_max, 28)
    forces = _lift_drag_thrust(airframe, level_air_data(1.0, 0.0), jnp.asarray(speeds), jnp.asarray(alphas))
    lift, drag, full_thrust = map(np.asarray, forces)
    carries = lift.max(axis=1) >= weight
    if not carries.any():
        shortfall = f"at none of these airspeeds does the lift carry the weight of {weight:.4g} N"
        yield Finding("validity.airspeed_m_s", f"[{speed_min:g}, {speed_max:g}] m/s: {shortfall}")
        return
    if not carries[0]:
        first_speed = speeds[np.argmax(carries)]
        text = f"{speed_min:g} m/s: the lift carries the weight only from about {first_speed:.3g} m/s on"
        yield Finding("validity.airspeed_m_s[0]", text)
    if isinstance(airframe.engine, NoEngine):
        return
    drag_min = np.where(lift >= weight, drag, np.inf).min(axis=1)
    if not (full_thrust.max(axis=1) > drag_min).any():
        text = "at no valid airspeed is the full thrust more than the drag of level flight at sea level"
        yield Finding("engine", text)


@jax.jit
def _lift_drag_thrust(
    airframe: _Airframe, unit_speed_data: AirData, speeds: jax.Array, alphas: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Compute lift, drag and full thrust (N) over `speeds` (m/s) and `alphas` (rad), each of shape (speeds, alphas).

    `unit_speed_data` are the air data at an airspeed of 1 m/s.
    """
    neutral, zero_rates = jnp.zeros(len(airframe.actuators.names)), jnp.zeros(3)

    def forces(V: jax.Array, alpha: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        qbar = 0.5 * unit_speed_data.density * V * V
        data = AirData(V, alpha, 0.0 * V, unit_speed_data.density, qbar, V * unit_speed_data.mach, 0.0 * V)
        force_b = airframe.aerodynamics(data, zero_rates, neutral).force_b
        return *_lift_and_drag(force_b, alpha), airframe.engine.propulsion(100.0, data).force_b[0]

    return jax.vmap(jax.vmap(forces, in_axes=(None, 0)), in_axes=(0, None))(speeds, alphas)


_SURFACE_NAMES = {"dh": "elevator"}  # name of the horizontal tail in TP-1538


def f16_findings(variant: str) -> tuple[Finding, ...]:
    """Return findings for the suspect points in the tables of an F-16 variant, worst first.

    The result is empty for the variant "global", which has no tables.
    """
    if variant == "global":
        return ()  # a model without tables
    names, tables = _tp1538() if variant == "tp1538" else _reduced(variant)
    findings = []
    for point in suspect_points(tables):
        axis_names = names.get(point.table, ("alpha", "beta"))
        coordinates = ", ".join(f"{name} {value:g} deg" for name, value in zip(axis_names, point.location, strict=True))
        location = "all tables" if point.table == "all" else f"table {point.table}"
        findings.append(Finding(location, f"{coordinates}: {describe_suspect(point)}"))
    return tuple(findings)


def _tp1538() -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    data = library_data("tp1538")
    values = {name: np.asarray(table["values"], dtype=float) for name, table in data["tables"].items()}
    names, tables = _gridded(data["tables"], values, data["breakpoints_deg"])

    def plain_name(axis: str) -> str:
        return _SURFACE_NAMES.get(axis.rstrip("12"), axis.rstrip("12"))

    return {table: tuple(map(plain_name, axes)) for table, axes in names.items()}, tables


def _reduced(variant: str) -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    data = library_data("f16")
    axes = {**data["axes"], "elevator_deg": data["variants"][variant]["elevator_axis_deg"]}
    aerodynamic_tables = {name: entry for name, entry in data["tables"].items() if not name.startswith("T_")}
    names, tables = _gridded(aerodynamic_tables, variant_tables(data, variant), axes)
    return {name: tuple(axis.removesuffix("_deg") for axis in entry) for name, entry in names.items()}, tables


def _gridded(
    tables: Mapping[str, Any], values: Mapping[str, np.ndarray], axes: Mapping[str, Sequence[float]]
) -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    names = {name: tuple(table["axes"]) for name, table in tables.items()}
    points = {axis: np.asarray(breakpoints, dtype=float) for axis, breakpoints in axes.items()}
    grids = {name: tuple(points[axis] for axis in table_axes) for name, table_axes in names.items()}
    return names, {name: GriddedTable(grid, values[name]) for name, grid in grids.items()}
