"""Findings about an aircraft file or the F-16's tables.

Signs, units, proportions, lift, thrust and table points that are probably wrong. A finding is reported, not refused.
"""

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
from anser.aircraft_files.schema_aerodynamics import CoefficientTable
from anser.airframe_data import COEFFICIENTS
from anser.dave_ml.definition import Definition
from anser.dave_ml.model import Model
from anser.environment.atmosphere import StandardAtmosphere
from anser.units import DEG_RAD

_GAP = 4.0
"""Intervals of so many times the median one are gaps."""
_AXIS_ORDER = ("alpha", "beta")


def table_findings(file: AirframeFile) -> Iterator[tuple[str, str]]:
    """Place and text of what is suspect in the tables of a file."""
    named = {f"table[{k}]": one for k, one in enumerate(file.table)}
    for point in suspect_points({place: _sorted_coefficient_table(one) for place, one in named.items()}):
        if point.table not in named:
            yield "table", f"at {_format_point(_AXIS_ORDER[:2], point.location)}: {describe_suspect(point)}"
            continue
        one = named[point.table]
        over = _sorted_axes(one)
        at = dict(zip(over, point.location, strict=True))
        index = [points.index(at[name]) for name, points in zip(one.over, one.breakpoints_deg, strict=True)]
        brackets = "".join(f"[{k}]" for k in index)
        yield (
            f"{point.table}.values{brackets} ({one.replaces})",
            f"{_format_point(over, point.location)}: {describe_suspect(point)}",
        )
    for place, one in named.items():
        for axis, (name, points) in enumerate(zip(one.over, one.breakpoints_deg, strict=True)):
            where = f"{place} ({one.replaces}), breakpoints_deg[{axis}]"
            yield from ((where, text) for text in _axis_findings(file, one, name, points))


def describe_suspect(point: SuspectPoint) -> str:
    """What is said of a suspect point."""
    what = "most tables stand out from their" if math.isnan(point.value) else f"{point.value:.4g} stands out from its"
    beside = f", with {len(point.neighbours)} beside it in its row" if point.neighbours else ""
    return f"{what} neighbours by {point.score:.1f} times their scatter{beside}"


def _sorted_axes(table: CoefficientTable) -> tuple[str, ...]:
    """What a table is over: alpha first, then beta, then surfaces."""
    return tuple(
        sorted(table.over, key=lambda name: _AXIS_ORDER.index(name) if name in _AXIS_ORDER else len(_AXIS_ORDER))
    )


def _sorted_coefficient_table(table: CoefficientTable) -> GriddedTable:
    over = _sorted_axes(table)
    places = [table.over.index(name) for name in over]
    values = np.transpose(np.asarray(table.values, dtype=float), places)
    return GriddedTable(tuple(np.asarray(table.breakpoints_deg[k], dtype=float) for k in places), values)


def _format_point(over: Sequence[str], place: Sequence[float]) -> str:
    return ", ".join(f"{name} {value:g} deg" for name, value in zip(over, place, strict=True))


def _axis_findings(file: AirframeFile, table: CoefficientTable, name: str, points: Sequence[float]) -> Iterator[str]:
    steps = np.diff(points)
    for k in map(int, np.flatnonzero(steps > _GAP * np.median(steps))):
        yield f"a gap in {name} from {points[k]:g} to {points[k + 1]:g} deg, elsewhere every {np.median(steps):g} deg"
    ranges = {"alpha": file.validity.alpha_deg, "beta": file.validity.beta_deg}
    limits = ranges.get(name) or next(surface.stops_deg for surface in file.surface if surface.name == name)
    what = "the data are said to hold" if name in ranges else "the surface moves"
    way = "the last value is held" if table.beyond == "hold" else "the last slope goes on"
    if points[0] > limits[0]:
        yield f"{name} begins at {points[0]:g} deg, but {what} from {limits[0]:g} deg: {way}"
    if points[-1] < limits[1]:
        yield f"{name} ends at {points[-1]:g} deg, but {what} up to {limits[1]:g} deg: {way}"


_LEADING_AXES = ("angleOfAttack", "angleOfSideslip")
"""What tables are looked at along first: their points are compared along these and, of these, with mirror images."""


def model_table_findings(file: DaveMlFile) -> Iterator[tuple[str, str]]:
    """Place and text of what is suspect in the gridded tables of an aircraft's DAVE-ML files."""
    for part, model in file_models(file).items():
        for table, text in suspect_table_points(model, file.dave_ml.names):
            yield f"dave_ml.{part} ({table})" if table in model.definition.gridded else f"dave_ml.{part}", text


def suspect_table_points(model: Model, aliases: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Table, and text, of what is suspect in the gridded tables of a file.

    Parameters
    ----------
    model
        The file.
    aliases
        Its own names of variables, by their standard ones.
    """
    definition = model.definition
    axes = {name: _axes(aliases, model, name) for name in definition.gridded}
    tables = {name: _sorted_model_table(definition, name, [k for _, k in of]) for name, of in axes.items()}
    for point in suspect_points(tables):
        if point.table in axes:
            over = [definition.breakpoints[definition.gridded[point.table].axes[k]] for _, k in axes[point.table]]
            names = [one.name or one.id for one in over]
        else:
            names = ["first axis", "second axis"]
        where = ", ".join(f"{name} {value:g}" for name, value in zip(names, point.location, strict=True))
        yield point.table, f"{where}: {describe_suspect(point)}"


def _axes(aliases: Mapping[str, str], model: Model, table: str) -> list[tuple[int, int]]:
    """Rank and number of each axis of a table: along the angle of attack first, then the sideslip, then the others."""
    function = next((one for one in model.definition.functions if one.table == table), None)
    count = len(model.definition.gridded[table].axes)
    ranks = [len(_LEADING_AXES)] * count
    if function is not None:
        own = [{name, aliases.get(name, name)} for name in _LEADING_AXES]
        for k, argument in enumerate(function.arguments):
            inputs = _inputs_of(model, argument.id)
            ranks[k] = next((rank for rank, names in enumerate(own) if inputs and inputs <= names), len(_LEADING_AXES))
    return sorted(zip(ranks, range(count), strict=True))


def _inputs_of(model: Model, identifier: str) -> set[str]:
    """Names of the inputs that a variable depends on."""
    structure = model.evaluator.structure
    needed = structure.required_variables({identifier}, set())
    return {structure.by_id[one].name for one in needed if one in structure.inputs}


def _sorted_model_table(definition: Definition, name: str, places: list[int]) -> GriddedTable:
    table = definition.gridded[name]
    points = tuple(definition.breakpoints[table.axes[k]].points for k in places)
    return GriddedTable(points, np.transpose(np.asarray(table.values, dtype=float), places))


_File = AirframeFile | DaveMlFile
_Airframe = DerivativeAircraft | DaveMlAircraft

_GRAVITY_M_S2 = 9.80665
_SMALL_ALPHA_DEG = 2.0
_GYRATION = {"Jxx_kg_m2": (0.04, 0.4), "Jyy_kg_m2": (0.04, 0.6), "Jzz_kg_m2": (0.06, 0.7)}
"""Radii of gyration of aircraft, parts of the span: Raymer, *Aircraft Design*, table 16.1, has 0.17 to 0.25 of it in
roll and of length and mean length in the others; these bounds are wide, so that only wrong units lie outside."""
_CHORD = (0.5, 2.0)
"""Mean chord over S/b: 1 of a rectangle, 4/3 of a triangle's mean aerodynamic chord."""
_SLOPE_RATIO_MAX = 5
"""Ratio by which a slope differs from a wing's before another angle unit is suspected; the units differ by 57."""


@dataclass(frozen=True)
class Finding:
    """One thing that is probably wrong.

    Attributes
    ----------
    place
        Key in the file.
    text
        What stands there, why it looks wrong, and what would not.
    """

    location: str
    text: str

    def __str__(self) -> str:
        return f"{self.location}: {self.text}"


def collect_findings(file: _File) -> tuple[Finding, ...]:
    """Look for what is probably wrong in a valid file: signs, units, proportions, tables, lift and thrust."""
    airframe = build_airframe(file)
    slopes = _slopes(airframe, file)
    if isinstance(file, DaveMlFile):
        own, tables = (), model_table_findings(file)
    else:
        own, tables = (
            (*_mirror_findings(file), *_slope_unit_findings(file, slopes), *_chord_findings(file)),
            table_findings(file),
        )
    return (
        *_sign_findings(file, slopes),
        *own,
        *_angle_unit_findings(file),
        *_inertia_findings(file, airframe),
        *(Finding(place, text) for place, text in tables),
        *_force_findings(file, airframe),
    )


def _air_data(V: float, alpha: float, beta: float = 0.0, altitude: float = 0.0) -> AirData:
    air = StandardAtmosphere().at(altitude)
    density = float(air.density)
    numbers = (V, alpha, beta, density, 0.5 * density * V * V, V / float(air.speed_of_sound), altitude)
    return AirData(*(jnp.asarray(float(number)) for number in numbers))


def _slopes(airframe: _Airframe, file: _File) -> dict[str, float]:
    """Derivatives near zero angles, tables included, moments about the centre of gravity; rates made dimensionless."""
    low, high = file.validity.alpha_deg
    alpha = min(max(_SMALL_ALPHA_DEG, low), high) * DEG_RAD
    at = _air_data(sum(file.validity.airspeed_m_s) / 2.0, alpha)
    angles, still, neutral = jnp.asarray([alpha, 0.0]), jnp.zeros(3), jnp.zeros(len(file.surface))
    (by_angle, by_rate, by_surface), values = _derivatives(airframe, at, angles, still, neutral)
    found = {}
    for names, slopes in (
        (("alpha", "beta"), by_angle),
        (("p", "q", "r"), by_rate),
        (file.surfaces, by_surface),
    ):
        for k, name in enumerate(names):
            found |= {f"{row}_{name}": float(slopes[j, k]) for j, row in enumerate(COEFFICIENTS)}
    return found | {"CD": float(values[1])}


@jax.jit
def _derivatives(
    airframe: _Airframe, at: AirData, angles: jax.Array, reduced: jax.Array, surfaces: jax.Array
) -> tuple[Any, jax.Array]:
    """Slopes of `COEFFICIENTS` by angles, reduced rates and surfaces, and their values."""
    b, c, S = airframe.span, airframe.mean_chord, airframe.wing_area

    def coefficients(angles: jax.Array, reduced: jax.Array, surfaces: jax.Array) -> tuple[jax.Array, jax.Array]:
        data = AirData(at.V, angles[0], angles[1], at.density, at.qbar, at.mach, at.altitude)
        rates = reduced * 2.0 * at.V / jnp.stack([b, c, b])
        wrench = airframe.aerodynamics(data, rates, surfaces)
        moments = wrench.moment_b / (at.qbar * S * jnp.stack([b, c, b]))
        forces = wrench.force_b / (at.qbar * S)
        sa, ca = jnp.sin(angles[0]), jnp.cos(angles[0])
        lift, drag = forces[0] * sa - forces[2] * ca, -forces[0] * ca - forces[2] * sa
        values = jnp.concatenate([jnp.stack([lift, drag, forces[1]]), moments])
        return values, values

    return jax.jacfwd(coefficients, argnums=(0, 1, 2), has_aux=True)(angles, reduced, surfaces)


def _sign_findings(file: _File, slopes: dict[str, float]) -> list[Finding]:
    """Damping that excites, an aircraft that turns away from the flow, drag that drives."""
    wanted = (
        ("CL_alpha", 1, "lift that falls with the angle of attack"),
        ("Cl_p", -1, "a roll that its own rate drives on; damping is negative"),
        ("Cm_q", -1, "a pitch rate that drives itself on; damping is negative"),
        ("Cn_r", -1, "a yaw rate that drives itself on; damping is negative"),
        (
            "Cm_alpha",
            -1,
            "a nose that rises when the angle of attack does: unstable in pitch about the centre of gravity",
        ),
        ("Cn_beta", 1, "a nose that turns away from the flow: unstable in yaw"),
        ("Cl_beta", -1, "a roll into the sideslip: dihedral the wrong way"),
        ("CY_beta", -1, "a side force toward the side that the air comes from"),
    )
    found = []
    for name, sign, words in wanted:
        value = slopes[name]
        if value * sign < 0.0:
            found.append(Finding(_derivative_key(file, name), f"{value:.4g} per rad near zero angles: {words}"))
        elif value == 0.0:
            found.append(
                Finding(
                    _derivative_key(file, name), "0, or left out: expected a value of its own, which every aircraft has"
                )
            )
    if slopes["CD"] <= 0.0:
        found.append(
            Finding(_derivative_key(file, "CD0"), f"a drag coefficient of {slopes['CD']:.4g}: expected a positive one")
        )
    for axis, row in (("roll", "Cl"), ("pitch", "Cm")):
        if all(slopes[f"{row}_{name}"] == 0.0 for name in file.surfaces):
            found.append(Finding("surface", f"no surface that makes a moment of {axis}: the aircraft cannot be flown"))
    return found


def _mirror_findings(file: AirframeFile) -> list[Finding]:
    """Derivatives that the mirror image of an aircraft contradicts."""
    found = []
    for one in ("CL_beta", "CD_beta", "Cm_beta", "CY_alpha", "Cl_alpha", "Cn_alpha"):
        if getattr(file.aerodynamics, one) != 0.0:
            words = "a part that changes sign with its angle, which the mirror image of an aircraft contradicts"
            found.append(Finding(f"aerodynamics.{one}", f"{getattr(file.aerodynamics, one):.4g}: {words}"))
    return found


def _derivative_key(file: _File, name: str) -> str:
    """Key that gives a derivative: the table's where one takes its place."""
    if isinstance(file, DaveMlFile):
        return f"dave_ml.aerodynamics ({name})"
    row, _, ending = name.partition("_")
    for k, one in enumerate(file.table):
        if one.replaces == name or (one.replaces == row and ending in one.over):
            return f"table[{k}] ({one.replaces})"
    return f"aerodynamics.{name}"


def _slope_unit_findings(file: AirframeFile, slopes: dict[str, float]) -> list[Finding]:
    """A slope of the lift as if per degree where per rad is meant, and the other way."""
    aspect = file.geometry.span_m**2 / file.geometry.wing_area_m2
    wing = 2.0 * math.pi * aspect / (aspect + 2.0)
    value = slopes["CL_alpha"]
    given, other = ("rad", "deg") if file.aerodynamics.per == "rad" else ("deg", "rad")
    if 0.0 < value < wing / _SLOPE_RATIO_MAX or value > wing * _SLOPE_RATIO_MAX:
        words = f"a wing of aspect ratio {aspect:.1f} has about {wing:.1f}; is it given per {other}, not per {given}?"
        return [Finding(_derivative_key(file, "CL_alpha"), f"{value:.4g} per rad: {words}")]
    return []


def _angle_unit_findings(file: _File) -> list[Finding]:
    """Angles as if in rad."""
    found = []
    for key in ("alpha_deg", "beta_deg"):
        low, high = getattr(file.validity, key)
        if max(abs(low), abs(high)) < 1.6:
            found.append(Finding(f"validity.{key}", f"[{low:g}, {high:g}] deg: narrow; are these rad?"))
    for k, one in enumerate(file.surface):
        low, high = one.stops_deg
        if max(abs(low), abs(high)) < 1.6:
            found.append(Finding(f"surface[{k}].limit_deg", f"{high:g} deg ({one.name}): small; is it in rad?"))
        if one.rate_limit_deg_s < 10.0:
            words = f"{one.rate_limit_deg_s:g} deg/s ({one.name}): slow; is it in rad/s?"
            found.append(Finding(f"surface[{k}].rate_limit_deg_s", words))
    return found


def _inertia_findings(file: _File, airframe: _Airframe) -> list[Finding]:
    """Inertias that are not those of such a mass."""
    found, span, mass = [], float(airframe.span), float(airframe.mass_properties.mass)
    values = np.diag(np.asarray(airframe.mass_properties.inertia_b))
    for (key, (low, high)), value in zip(_GYRATION.items(), map(float, values), strict=True):
        place = f"mass.{key}" if file.mass is not None else f"dave_ml.inertia ({key.removesuffix('_kg_m2')})"
        part = math.sqrt(value / mass) / span
        if not low <= part <= high:
            words = f"a radius of gyration of {part:.3g} of the span, expected {low:g} to {high:g}; is the unit kg m^2?"
            found.append(Finding(place, f"{value:.4g} kg m^2: {words}"))
    return found


def _chord_findings(file: AirframeFile) -> list[Finding]:
    """Proportions of no wing."""
    geometry = file.geometry
    mean = geometry.wing_area_m2 / geometry.span_m
    if _CHORD[0] <= geometry.mean_chord_m / mean <= _CHORD[1]:
        return []
    words = f"area over span is {mean:.3g} m; do span, area and chord belong to one wing, in m and m^2?"
    return [Finding("geometry.mean_chord_m", f"{geometry.mean_chord_m:g} m: {words}")]


def _force_findings(file: _File, airframe: _Airframe) -> list[Finding]:
    """Lift that does not carry the weight, thrust that does not balance the drag, where the data are said to hold."""
    found = []
    low, high = file.validity.airspeed_m_s
    weight = float(airframe.mass_properties.mass) * _GRAVITY_M_S2
    least_deg, most_deg = file.validity.alpha_deg
    alphas = np.linspace(least_deg, most_deg, 46) * DEG_RAD
    speeds = np.linspace(low, high, 28)
    rows = _lift_drag_thrust(airframe, _air_data(1.0, 0.0), jnp.asarray(speeds), jnp.asarray(alphas))
    lift, drag, full = map(np.asarray, rows)
    carries = lift.max(axis=1) >= weight
    if not carries.any():
        text = f"[{low:g}, {high:g}] m/s: at none of these airspeeds does the lift carry the weight of {weight:.4g} N"
        return [Finding("validity.airspeed_m_s", text)]
    if not carries[0]:
        first = speeds[np.argmax(carries)]
        text = f"{low:g} m/s: the lift carries the weight only from about {first:.3g} m/s on"
        found.append(Finding("validity.airspeed_m_s[0]", text))
    if isinstance(airframe.engine, NoEngine):
        return found
    least = np.where(lift >= weight, drag, np.inf).min(axis=1)
    if not (full.max(axis=1) > least).any():
        text = "at no valid airspeed is the full thrust more than the drag of level flight at sea level"
        found.append(Finding("engine", text))
    return found


@jax.jit
def _lift_drag_thrust(
    airframe: _Airframe, at: AirData, speeds: jax.Array, alphas: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Lift, drag and full thrust, N, over airspeed and angle of attack; `at` is the air at 1 m/s."""
    neutral, still = jnp.zeros(len(airframe.actuators.names)), jnp.zeros(3)

    def forces(V: jax.Array, alpha: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        qbar = 0.5 * at.density * V * V
        data = AirData(V, alpha, 0.0 * V, at.density, qbar, V * at.mach, 0.0 * V)
        force_b = airframe.aerodynamics(data, still, neutral).force_b
        sa, ca = jnp.sin(alpha), jnp.cos(alpha)
        full = airframe.engine.propulsion(100.0, data).force_b[0]
        return force_b[0] * sa - force_b[2] * ca, -force_b[0] * ca - force_b[2] * sa, full

    return jax.vmap(jax.vmap(forces, in_axes=(None, 0)), in_axes=(0, None))(speeds, alphas)


_SURFACE_NAMES = {"dh": "elevator"}  # as TP-1538 calls its horizontal tail


def f16_findings(variant: str) -> tuple[Finding, ...]:
    """What stands out in the tables of a variant, the worst first; see `anser.aircraft.suspect_points`."""
    names, tables = _tp1538() if variant == "tp1538" else _reduced(variant)
    found = []
    for point in suspect_points(tables):
        of = names.get(point.table, ("alpha", "beta"))
        where = ", ".join(f"{name} {value:g} deg" for name, value in zip(of, point.location, strict=True))
        place = "all tables" if point.table == "all" else f"table {point.table}"
        found.append(Finding(place, f"{where}: {describe_suspect(point)}"))
    return tuple(found)


def _tp1538() -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    """What each table is over, and the tables."""
    data = library_data("tp1538")
    values = {name: np.asarray(one["values"], dtype=float) for name, one in data["tables"].items()}
    names, tables = _gridded(data["tables"], values, data["breakpoints_deg"])
    plain = {name: [axis.rstrip("12") for axis in of] for name, of in names.items()}
    return {name: tuple(_SURFACE_NAMES.get(one, one) for one in of) for name, of in plain.items()}, tables


def _reduced(variant: str) -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    data = library_data("f16")
    axes = {**data["axes"], "elevator_deg": data["variants"][variant]["elevator_axis_deg"]}
    of = {name: one for name, one in data["tables"].items() if not name.startswith("T_")}
    names, tables = _gridded(of, variant_tables(data, variant), axes)
    return {name: tuple(axis.removesuffix("_deg") for axis in one) for name, one in names.items()}, tables


def _gridded(
    tables: Mapping[str, Any], values: Mapping[str, np.ndarray], axes: Mapping[str, Sequence[float]]
) -> tuple[dict[str, tuple[str, ...]], dict[str, GriddedTable]]:
    return (
        {name: tuple(one["axes"]) for name, one in tables.items()},
        {
            name: GriddedTable(tuple(np.asarray(axes[axis], dtype=float) for axis in one["axes"]), values[name])
            for name, one in tables.items()
        },
    )
