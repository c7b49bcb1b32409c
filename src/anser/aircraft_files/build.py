"""Construction of airframes from aircraft files (derivatives or DAVE-ML), and deviations applied to airframes."""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, overload

import jax
import numpy as np
from jaxtyping import Array

from anser.aircraft.actuators import AbstractActuators, FirstOrderActuators, SecondOrderActuators
from anser.aircraft.air_data import Validity, air_data
from anser.aircraft.airframe import AbstractAirframe, MassProperties, rigid_body
from anser.aircraft.changes import AirframeChange, AirframeChanges, changed_airframe
from anser.aircraft.dave_ml_aircraft import (
    AERO_LENGTHS,
    AERO_OUTPUTS,
    ENGINE_OUTPUTS,
    ENGINE_POWER,
    INERTIA_OUTPUTS,
    STANDARD_INPUTS,
    SURFACE_INPUT,
    DaveMlAircraft,
    dave_ml_airframe,
    dave_ml_body_faults,
)
from anser.aircraft.derivative_aircraft import NO_STALL, DerivativeAircraft
from anser.aircraft.dispersions import (
    BodyDispersion,
    DerivativeDispersion,
    F16Dispersion,
    dispersed_dave_ml_aircraft,
    dispersed_derivative_aircraft,
    dispersed_f16,
)
from anser.aircraft.engines import AbstractEngine, JetEngine, NoEngine
from anser.aircraft.f16 import F16_COEFFICIENTS, AbstractF16
from anser.aircraft.propellers import ElectricPropeller, PistonPropeller
from anser.aircraft_files import schema_tables
from anser.aircraft_files.deviations import PRIMARY_SURFACES, Deviation
from anser.aircraft_files.schema import DAVE_ML_PARTS, AirframeFile, DaveMlFile, DaveMlText, coefficient_index
from anser.airframe_data import (
    BODY_COEFFICIENTS,
    COEFFICIENTS,
    DERIVATIVE_ARGUMENTS,
    STATIC_ARGUMENTS,
    derivative_columns,
)
from anser.config.errors import Problem, ScenarioError, describe_value, format_number
from anser.config.tables import content_hash
from anser.dave_ml.elements import DaveMlError
from anser.dave_ml.model import Model, adapt_model, read_dave_ml
from anser.dave_ml.standard_units import ANGLE, refuse_other_units
from anser.environment.atmosphere import StandardAtmosphere
from anser.numerics.arrays import as_array, stack_rows
from anser.numerics.tables import Tables, make_axes, make_tables
from anser.shapes import Scalar
from anser.units import DEG_RAD, RAD_DEG

_RPM_RAD_S = 2.0 * math.pi / 60.0
_ANYWHERE_M, _ANY_MACH = (-1e5, 1e5), (-1.0, 1e2)
"""Axes, altitude (m) and Mach number, of the table of a constant thrust: wider than the range of any flight."""


def build_range(bounds: tuple[float, float] | None, factor: float = 1.0) -> tuple[Scalar, Scalar]:
    """Return lower and upper bound of a range, multiplied by `factor`, as arrays; infinite if `bounds` is None."""
    lower, upper = (-math.inf, math.inf) if bounds is None else bounds
    return as_array(lower * factor), as_array(upper * factor)


def build_validity(valid: schema_tables.Validity) -> Validity:
    """Return the valid ranges of airspeed (m/s), altitude (m) and Mach number of a table [validity]."""
    return Validity(build_range(valid.airspeed_m_s), build_range(valid.altitude_m), build_range(valid.mach))


def build_mass(mass: schema_tables.Mass) -> MassProperties:
    """Build the mass properties (SI units, body axes) from a table [mass]."""
    return rigid_body(mass.mass_kg, np.asarray(mass.inertia), mass.spin_momentum_kg_m2_s)


def build_actuators(surface: Sequence[schema_tables.ActuatedSurface]) -> AbstractActuators:
    """Build the actuators of the surfaces, first order if the surfaces have a lag, second order if not."""
    names = tuple(s.name for s in surface)
    lower, upper = zip(*(s.stops_deg for s in surface), strict=True)
    lower, upper = (as_array(np.asarray(stops) * DEG_RAD) for stops in (lower, upper))
    rates = as_array(np.asarray([s.rate_limit_deg_s for s in surface]) * DEG_RAD)
    lags = [s.lag_s for s in surface if s.lag_s is not None]
    if lags:
        return FirstOrderActuators(as_array(lags), lower, upper, rates, names)
    pairs = [(s.frequency_rad_s, s.damping) for s in surface]
    frequency, damping = np.asarray(pairs, dtype=float).T
    return SecondOrderActuators(  # pyright: ignore[reportCallIssue] - the time constant is a property
        as_array(frequency), as_array(damping), lower, upper, rates, names
    )


def build_engine(engine: schema_tables.Engine | None) -> AbstractEngine:
    """Build the engine of a table [engine]; return `NoEngine` for None."""
    if engine is None:
        return NoEngine()
    builders = {"jet": _jet, "electric_propeller": _electric, "piston_propeller": _piston}
    table = getattr(engine, engine.kind)
    return builders[engine.kind](
        table, lag=as_array(table.lag_s), point_b=as_array(table.point_m), thrust_factor=as_array(1.0)
    )


def _jet(jet: schema_tables.Jet, **common: Array) -> JetEngine:
    altitudes, machs = (jet.altitude_m, jet.mach) if jet.mach else (_ANYWHERE_M, _ANY_MACH)
    shape = len(altitudes), len(machs)
    thrusts = [np.broadcast_to(np.asarray(thrust, dtype=float), shape) for thrust in (jet.idle_N, jet.full_N)]
    tables = make_tables(make_axes([altitudes, machs], clamp=True), [((0, 1), thrusts)])
    return JetEngine(thrust_tables=tables, **common)


def _electric(propeller: schema_tables.ElectricPropeller, **common: Array) -> ElectricPropeller:
    return ElectricPropeller(
        diameter=as_array(propeller.diameter_m),
        thrust_polynomial=as_array(propeller.thrust_coefficients),
        torque_polynomial=as_array(propeller.torque_coefficients),
        motor_constant=as_array(1.0 / (propeller.speed_constant_rpm_V * _RPM_RAD_S)),
        resistance=as_array(propeller.resistance_ohm),
        no_load_current=as_array(propeller.no_load_current_A),
        voltage_max=as_array(propeller.voltage_V),
        direction=as_array(1.0 if propeller.direction == "right" else -1.0),
        **common,
    )


def _piston(piston: schema_tables.PistonPropeller, **common: Array) -> PistonPropeller:
    reaction = 0.0 if piston.speed_rpm is None else 1.0 / (piston.speed_rpm * _RPM_RAD_S)
    return PistonPropeller(
        shaft_power=as_array(piston.shaft_power_W),
        efficiency=as_array(piston.efficiency),
        static_thrust=as_array(piston.static_thrust_N),
        torque_per_power=as_array(-reaction if piston.direction == "right" else reaction),
        **common,
    )


_REQUIRED_OUTPUTS: Mapping[str, Sequence[str]] = {
    "aerodynamics": (*AERO_OUTPUTS, *AERO_LENGTHS),
    "inertia": INERTIA_OUTPUTS,
    "propulsion": ENGINE_OUTPUTS,
}


def file_models(file: DaveMlFile) -> dict[str, Model]:
    """Read the DAVE-ML models of an aircraft file, by part (`DAVE_ML_PARTS`).

    A part without DAVE-ML file has no entry in the result. The names in [dave_ml.names] are not applied. Raises
    DaveMlError if a model is invalid.
    """
    return {part: _read_cached(text.text, text.file) for part, text in _file_texts(file)}


def _file_texts(file: DaveMlFile) -> list[tuple[str, DaveMlText]]:
    texts = [(part, getattr(file.dave_ml, part)) for part in DAVE_ML_PARTS]
    return [(part, text) for part, text in texts if text is not None]


@functools.lru_cache(maxsize=32)
def _read_cached(text: str, name: str) -> Model:
    return read_dave_ml(text, name)


def build_dave_ml(file: DaveMlFile) -> DaveMlAircraft:
    """Build the airframe of a validated aircraft file with DAVE-ML models.

    Raises ValueError if the models do not make an aircraft; see `dave_ml_airframe`.
    """
    models = {part: _adapt(file, model) for part, model in file_models(file).items()}
    offset = file.dave_ml.cg_offset_m or (0.0, 0.0, 0.0)
    (alpha_min, alpha_max), (beta_min, beta_max) = file.validity.alpha_deg, file.validity.beta_deg
    return dave_ml_airframe(
        models["aerodynamics"],
        models["inertia"] if file.mass is None else (build_mass(file.mass), as_array(offset)),
        models.get("propulsion") or build_engine(file.engine),
        build_actuators(file.surface),
        [s.input_name for s in file.surface],
        alpha_range=(alpha_min * DEG_RAD, alpha_max * DEG_RAD),
        beta_range=(beta_min * DEG_RAD, beta_max * DEG_RAD),
        engine_lag=file.dave_ml.propulsion_lag_s or 0.0,
        validity=build_validity(file.validity),
    )


def _has_variable(model: Model, name: str) -> bool:
    structure = model.evaluator.structure
    return name in structure.by_id or any(quantity.name == name for quantity in structure.quantities)


def _adapt(file: DaveMlFile, model: Model) -> Model:
    names = {name: variable for name, variable in file.dave_ml.names.items() if _has_variable(model, variable)}
    defaults = {name: value for name, value in file.dave_ml.given.items() if _has_variable(model, name)}
    return adapt_model(model, names, defaults)


def model_problems(file: DaveMlFile) -> list[Problem]:
    """List the faults of the DAVE-ML models of an aircraft file; empty if `build_dave_ml` can build the airframe."""
    for part, text in _file_texts(file):
        try:
            _read_cached(text.text, text.file)
        except DaveMlError as error:
            return [_problem_of(f"dave_ml.{part}", error)]
    raw, problems = file_models(file), []
    references = [("names", name, variable) for name, variable in file.dave_ml.names.items()]
    for key, name, variable in (*references, *(("given", name, name) for name in file.dave_ml.given)):
        if not any(_has_variable(model, variable) for model in raw.values()):
            expected = "the varID or the name of a variable of one of the files"
            problems.append(Problem(f"dave_ml.{key}.{name}", describe_value(variable), expected))
    if problems:
        return problems
    models = {}
    try:
        for part, model in raw.items():
            try:
                models[part] = _adapt(file, model)
            except DaveMlError as error:
                return [_problem_of(f"dave_ml.{part}", error)]
        problems = [
            *(problem for part, model in models.items() for problem in _output_problems(file, part, model)),
            *_input_problems(file, models),
        ]
        if not problems:
            faults = dave_ml_body_faults(models["aerodynamics"], models.get("inertia"), {})
            problems = [_problem_of(f"dave_ml.{part}", fault) for part, fault in faults]
        if not problems:
            jax.eval_shape(_evaluate_airframe, build_dave_ml(file))
    except ValueError as error:
        return [Problem("dave_ml", str(error), "files that make an aircraft together")]
    return problems


def _problem_of(key: str, error: DaveMlError) -> Problem:
    position = error.name if error.line is None else f"{error.name}, line {error.line}, column {error.column}"
    return Problem(f"{key} ({position})", error.arrived, error.expected)


def _output_problems(file: DaveMlFile, part: str, model: Model) -> list[Problem]:
    required = (*_REQUIRED_OUTPUTS[part], *([ENGINE_POWER] if part == "propulsion" else ()))
    missing = [name for name in required if not _has_variable(model, name)]
    if not missing:
        return []
    expected = "variables of these standard names, or what stands for them in [dave_ml.names]"
    arrived = f"{describe_value(getattr(file.dave_ml, part).file)}, which has no {', '.join(missing)}"
    return [Problem(f"dave_ml.{part}", arrived, expected)]


def _input_problems(file: DaveMlFile, models: Mapping[str, Model]) -> list[Problem]:
    """List unsuitable inputs of surfaces, and required model inputs without a value.

    Unsuitable inputs are unknown, used twice, air data or body rates, or not angles.
    """
    problems = []
    surface_inputs = [s.input_name for s in file.surface]
    for part, model in models.items():
        structure, constants = model.evaluator.structure, model.evaluator.constants
        input_ids = {structure.by_id[k].name: k for k in structure.inputs}
        available = [] if part == "inertia" else [*STANDARD_INPUTS, *([ENGINE_POWER] if part == "propulsion" else ())]
        output_ids = {structure.find(name) for name in _REQUIRED_OUTPUTS[part] if _has_variable(model, name)}
        required = structure.required_variables(output_ids, constants.keys())
        surface_names = {*surface_inputs, *(name for name, key in input_ids.items() if key in surface_inputs)}
        if part == "aerodynamics":
            surface_ids: set[str] = set()
            for k, key in enumerate(surface_inputs):
                if key not in input_ids and key not in structure.inputs:
                    source = describe_value(file.dave_ml.aerodynamics.file)
                    expected = f"an input of {source}: {', '.join(sorted(input_ids))}"
                    problems.append(Problem(f"surface[{k}].input", describe_value(key), expected))
                    continue
                variable_id = structure.find(key)
                if variable_id in surface_ids or structure.by_id[variable_id].name in STANDARD_INPUTS:
                    problems.append(Problem(f"surface[{k}].input", describe_value(key), SURFACE_INPUT))
                surface_ids.add(variable_id)
                try:
                    refuse_other_units(model.definition.variables[variable_id], ANGLE)
                except DaveMlError as error:
                    problems.append(_problem_of(f"surface[{k}].input", error))
            available += surface_names
        missing = [n for n, i in input_ids.items() if n not in available and i in required - constants.keys()]
        for name in missing:
            unit = structure.by_id[input_ids[name]].units
            text = f"nothing for {name} ({unit}), an input of {describe_value(getattr(file.dave_ml, part).file)}"
            expected = "a value, a surface that moves it, or the standard name that it stands for in [dave_ml.names]"
            problems.append(Problem("dave_ml.given", text, expected))
    return problems


def _evaluate_airframe(airframe: DaveMlAircraft) -> object:
    """Return aerodynamic and propulsive `Wrench` at 50 m/s at sea level; raises ValueError for unknown units."""
    data = air_data(as_array([50.0, 0.0, 1.0]), as_array(0.0), StandardAtmosphere().at(as_array(0.0)))
    neutral = as_array([0.0] * len(airframe.inputs))
    return airframe.aerodynamics(data, as_array([0.0] * 3), neutral), airframe.engine.propulsion(as_array(50.0), data)


@overload
def build_airframe(file: AirframeFile) -> DerivativeAircraft: ...
@overload
def build_airframe(file: DaveMlFile) -> DaveMlAircraft: ...
@overload
def build_airframe(file: AirframeFile | DaveMlFile) -> DerivativeAircraft | DaveMlAircraft: ...
@jax.ensure_compile_time_eval()  # cached, so the arrays must not belong to the trace of the first caller
def build_airframe(file: AirframeFile | DaveMlFile) -> DerivativeAircraft | DaveMlAircraft:
    """Build the airframe of a validated file, or return the cached airframe of a file with equal content."""
    return _build_cached(content_hash(file), _UnhashedFile(file))


class _UnhashedFile:
    """Wrapper of a file for a cached function; all wrappers are equal, so that the cache ignores the file."""

    def __init__(self, file: AirframeFile | DaveMlFile) -> None:
        self.file = file

    def __hash__(self) -> int:
        return 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _UnhashedFile)


@functools.lru_cache(maxsize=64)
def _build_cached(_: str, unhashed: _UnhashedFile) -> DerivativeAircraft | DaveMlAircraft:
    file = unhashed.file
    return build_dave_ml(file) if isinstance(file, DaveMlFile) else _build_derivative_aircraft(file)


def _build_derivative_aircraft(file: AirframeFile) -> DerivativeAircraft:
    geometry, aero, valid = file.geometry, file.aerodynamics, file.validity
    aspect = geometry.span_m**2 / geometry.wing_area_m2
    tables, table_indices = _tables(file)
    derivatives, inputs = _derivatives(file), ("alpha", "beta", *file.surfaces)
    return DerivativeAircraft(
        mass_properties=build_mass(file.mass),
        actuators=build_actuators(file.surface),
        engine=build_engine(file.engine),
        alpha_range=build_range(valid.alpha_deg, DEG_RAD),
        beta_range=build_range(valid.beta_deg, DEG_RAD),
        span=as_array(geometry.span_m),
        wing_area=as_array(geometry.wing_area_m2),
        mean_chord=as_array(geometry.mean_chord_m),
        cg_offset_b=as_array(geometry.cg_offset_m),
        derivatives=as_array(derivatives),
        induced_drag=as_array(0.0 if aero.oswald is None else 1.0 / (math.pi * aero.oswald * aspect)),
        stall_sharpness=as_array(aero.stall_sharpness),
        stall_alpha=as_array(NO_STALL if aero.stall_alpha_deg is None else aero.stall_alpha_deg * DEG_RAD),
        validity=build_validity(valid),
        tables=tables,
        table_factors=None if tables is None else as_array(np.ones(len(table_indices))),
        table_derivatives=table_indices,
        table_arguments=tuple(inputs.index(name) for name, _, _ in _axes(file)),
        has_static_side_force=_has_still_side_force(derivatives, table_indices),
    )


def _has_still_side_force(derivatives: np.ndarray, table_indices: Sequence[tuple[int, int]]) -> bool:
    """Whether CY has a derivative or a table that acts while sideslip, rates and deflections are zero."""
    row = COEFFICIENTS.index("CY")
    constant_columns = [column for column, name in enumerate(DERIVATIVE_ARGUMENTS) if name in STATIC_ARGUMENTS]
    return bool(np.any(derivatives[row, constant_columns])) or any(
        index in {(row, column) for column in constant_columns} for index in table_indices
    )


def angle_factors(file: AirframeFile) -> np.ndarray:
    """Return factors from the file's angle unit to rad, one for each column of the derivatives: (8 + surfaces,)."""
    per_rad = RAD_DEG if file.aerodynamics.per == "deg" else 1.0
    factors = {"_alpha": per_rad, "_beta": per_rad, "_alpha2": per_rad**2, "_beta2": per_rad**2}
    return np.asarray([*(factors.get(column, 1.0) for column in DERIVATIVE_ARGUMENTS), *[per_rad] * len(file.surface)])


def _derivatives(file: AirframeFile) -> np.ndarray:
    by_argument = [[getattr(file.aerodynamics, row + name) for name in DERIVATIVE_ARGUMENTS] for row in COEFFICIENTS]
    by_surface = [[getattr(surface, row) for surface in file.surface] for row in COEFFICIENTS]
    return np.hstack([by_argument, by_surface]) * angle_factors(file)


def _axes(file: AirframeFile) -> dict[tuple[str, tuple[float, ...], bool], int]:
    """Number the distinct axes of all tables; the key of an axis is (argument, breakpoints in deg, is clamped)."""
    axis_numbers: dict[tuple[str, tuple[float, ...], bool], int] = {}
    for file_table in file.table:
        for name, points in zip(file_table.over, file_table.breakpoints_deg, strict=True):
            axis_numbers.setdefault((name, points, file_table.beyond == "hold"), len(axis_numbers))
    return axis_numbers


def _tables(file: AirframeFile) -> tuple[Tables | None, tuple[tuple[int, int], ...]]:
    if not file.table:
        return None, ()
    axes, scale = _axes(file), angle_factors(file)
    groups: dict[tuple[int, ...], list[tuple[np.ndarray, tuple[int, int]]]] = {}
    for file_table in file.table:
        axis_numbers = tuple(
            axes[name, points, file_table.beyond == "hold"]
            for name, points in zip(file_table.over, file_table.breakpoints_deg, strict=True)
        )
        index = coefficient_index(file_table.replaces, file.surfaces)
        if index is None:
            raise ValueError(f"table of {file_table.replaces!r}: no such coefficient")  # the schema refuses it
        factor = 1.0 if file_table.replaces in COEFFICIENTS else scale[index[1]]
        groups.setdefault(axis_numbers, []).append((np.asarray(file_table.values, dtype=float) * factor, index))
    breakpoints = [np.asarray(points) * DEG_RAD for _, points, _ in axes]
    tables = make_tables(
        make_axes(breakpoints, clamp=[is_clamped for _, _, is_clamped in axes]),
        [(axis_numbers, [values for values, _ in functions]) for axis_numbers, functions in groups.items()],
    )
    return tables, tuple(index for functions in groups.values() for _, index in functions)


def with_derivatives(
    airframe: DerivativeAircraft, file: AirframeFile, replacements: dict[str, float]
) -> DerivativeAircraft:
    """Return a copy of the airframe of `file` with some derivatives replaced.

    `replacements` are values in the file's units by name, such as `Cm_q`. Derivatives by surface deflections are not
    supported.
    """
    values, scale = np.array(airframe.derivatives), angle_factors(file)
    for name, value in replacements.items():
        column = DERIVATIVE_ARGUMENTS.index(name[2:])
        values[COEFFICIENTS.index(name[:2]), column] = value * scale[column]
    has_static_side_force = _has_still_side_force(values, airframe.table_derivatives)
    return dataclasses.replace(airframe, derivatives=as_array(values), has_static_side_force=has_static_side_force)


_BODY_KEYS = ("thrust", "mass", "second_moments", "actuator_bandwidth", "cg_shift")
_FORCE_KEYS = ("drag", "lift_slope")


def disperse_airframe(nominal: AbstractAirframe, deviation: Deviation) -> AbstractAirframe:
    """Return the airframe that the simulation flies: `nominal` with a deviation that is constant during the flight.

    The factors on coefficients apply to the coefficients of an F-16, to the `derivatives` of a `DerivativeAircraft`, or
    to CX to Cn of a DAVE-ML aircraft. Raises TypeError for an airframe of another class, and for an engine that cannot
    be dispersed.
    """
    dispersed = _with_coefficients_and_body(nominal, deviation)
    if not deviation.changes_forces:
        return dispersed
    forces = _change(dispersed, deviation, dict(zip(_BODY_KEYS, (1.0, 1.0, (1.0,) * 3, 1.0, 0.0), strict=True)))
    return changed_airframe(dispersed, forces)


def _change(airframe: AbstractAirframe, deviation: Deviation, body: Mapping[str, Any]) -> AirframeChange:
    effectiveness = [getattr(deviation.surface_effectiveness, name, 1.0) for name in airframe.actuators.names]
    values = {**body, **{key: getattr(deviation, key) for key in _FORCE_KEYS}}
    return AirframeChange(
        surface_effectiveness=as_array(effectiveness), **{key: as_array(value) for key, value in values.items()}
    )


def build_changes(
    airframe: AbstractAirframe, deviations: Sequence[tuple[float, Deviation]], source: str
) -> AirframeChanges:
    """Build the changes of an airframe during a flight from pairs (start time in s, deviation).

    Raises ScenarioError if a deviation shifts the centre of gravity of an airframe without mean chord, or changes the
    effectiveness of a surface that the airframe lacks. `source` names the origin of the deviations in the message.
    """
    problems = []
    for index, (_, deviation) in enumerate(deviations):
        if deviation.cg_shift != 0.0 and getattr(airframe, "mean_chord", None) is None:
            expected = f"0: {type(airframe).__name__} has no attribute mean_chord, the unit of the shift"
            problems.append(Problem(f"[{index}].cg_shift", format_number(deviation.cg_shift), expected))
        for name in PRIMARY_SURFACES:
            factor = getattr(deviation.surface_effectiveness, name)
            if factor != 1.0 and name not in airframe.actuators.names:
                expected = f"a surface of the aircraft: {', '.join(airframe.actuators.names)}"
                problems.append(Problem(f"[{index}].surface_effectiveness.{name}", format_number(factor), expected))
    if problems:
        raise ScenarioError(source, problems)
    changes = [
        _change(airframe, deviation, {key: getattr(deviation, key) for key in _BODY_KEYS})
        for _, deviation in deviations
    ]
    return AirframeChanges(as_array([time_s for time_s, _ in deviations]), stack_rows(changes))


def _with_coefficients_and_body(nominal: AbstractAirframe, deviation: Deviation) -> AbstractAirframe:
    body = {key: as_array(getattr(deviation, key)) for key in _BODY_KEYS}
    factors_in_file = deviation.coefficients

    def factors_on(names: Sequence[str]) -> Array:
        return as_array([getattr(factors_in_file, name) for name in names])

    if isinstance(nominal, AbstractF16):
        return dispersed_f16(nominal, F16Dispersion(**body, coefficients=factors_on(F16_COEFFICIENTS)))
    if isinstance(nominal, DaveMlAircraft):
        return dispersed_dave_ml_aircraft(nominal, factors_on(BODY_COEFFICIENTS), BodyDispersion(**body))
    if not isinstance(nominal, DerivativeAircraft):
        raise TypeError(f"a deviation of {type(nominal).__name__}, of which no coefficients are known")
    columns = derivative_columns(nominal.actuators.names)
    factors = np.asarray([[getattr(factors_in_file, row + column, 1.0) for column in columns] for row in COEFFICIENTS])
    tables = as_array([factors[place] for place in nominal.table_derivatives]) if nominal.table_derivatives else None
    dispersion = DerivativeDispersion(as_array(factors), tables, BodyDispersion(**body))
    return dispersed_derivative_aircraft(nominal, dispersion)
