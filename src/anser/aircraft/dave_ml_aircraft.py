"""Airframe and engine from DAVE-ML files with the variable names of the standard (ANSI/AIAA S-119)."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData, Validity, Wrench, is_outside, unlimited_validity
from anser.aircraft.airframe import AbstractAirframe, MassProperties, refuse_impossible_body, rigid_body
from anser.aircraft.engines import AbstractEngine, AbstractLaggedEngine, NoEngine
from anser.airframe_data import BodyFault, body_faults
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.dave_ml.elements import DaveMlError
from anser.dave_ml.evaluator import Evaluator
from anser.dave_ml.model import Model
from anser.dave_ml.standard_units import ANGLE, refuse_other_units
from anser.numerics.arrays import as_array
from anser.numerics.linear import cross
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3

_THRUST = tuple(f"thrustBodyForce_{axis}" for axis in "XYZ")
_TORQUE = tuple(f"thrustBodyMoment_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
ENGINE_OUTPUTS = (*_THRUST, *_TORQUE)
"""Variables that a propulsion file must define: thrust force and moment along the body axes."""
ENGINE_POWER = "powerLeverAngle"
"""Name of the propulsion file's input for the engine power, percent."""
AIR_INPUTS = {
    "trueAirspeed": "V",
    "angleOfAttack": "alpha",
    "angleOfSideslip": "beta",
    "mach": "mach",
    "altitudeMSL": "altitude",
    "dynamicPressure": "qbar",
    "airDensity": "density",
}
"""Names of the inputs of a DAVE-ML file that describe the air data, and the attributes of `AirData`."""
_POWER_GRID = np.arange(0.0, 101.0, 10.0)


def _used_inputs(evaluator: Evaluator, values: Mapping[str, ScalarLike]) -> dict[str, ScalarLike]:
    """Return the entries of `values` (by variable name) that are inputs of the evaluator's DAVE-ML file."""
    input_names = {evaluator.structure.by_id[variable_id].name for variable_id in evaluator.structure.inputs}
    return {name: value for name, value in values.items() if name in input_names}


def air_inputs(evaluator: Evaluator, air_data: AirData) -> dict[str, ScalarLike]:
    """Return the air data that the evaluator's file has as inputs, by the names in `AIR_INPUTS`, in SI units."""
    return _used_inputs(evaluator, {name: getattr(air_data, key) for name, key in AIR_INPUTS.items()})


class DaveMlEngine(AbstractLaggedEngine):
    """Engine with thrust and thrust moment from a DAVE-ML file, functions of power (percent) and air data."""

    evaluator: Evaluator
    lag: Scalar  # time constant of the first-order lag from throttle to power, s
    # valid range of the tables: m and Mach number
    altitude_range: tuple[Scalar, Scalar]
    mach_range: tuple[Scalar, Scalar]
    # slope of the thrust where the power is below 0 or above 100 percent, N per 100 percent; for trim searches only
    extrapolation_thrust: Scalar
    point_b: Vector3  # moment reference point of the file relative to the centre of gravity, m
    thrust_factor: Scalar  # factor on thrust and thrust moment; 1 for the values of the file

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Compute the thrust force (N) and the thrust moment about the centre of gravity (N m) at a power (percent).

        Trim searches may pass a power outside 0..100 percent; the thrust is then extrapolated by
        `extrapolation_thrust`.
        """
        # in SI units percent becomes a fraction
        within = jnp.clip(power, 0.0, 100.0)
        inputs = {**air_inputs(self.evaluator, air_data), ENGINE_POWER: within / 100.0}
        outputs = self.evaluator.evaluate_si(inputs, ENGINE_OUTPUTS)
        force_b, moment_b = (jnp.stack([outputs[name] for name in names]) for names in (_THRUST, _TORQUE))
        force_b = self.thrust_factor * force_b.at[0].add(self.extrapolation_thrust * (power - within) / 100.0)
        return Wrench(force_b, self.thrust_factor * moment_b + cross(self.point_b, force_b))

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the power (0..100 percent) whose thrust along body x is nearest to `thrust` (N), by interpolation.

        Where the thrust falls as the power rises, the search takes the greatest thrust at lower power instead.
        """
        powers = jnp.asarray(_POWER_GRID, air_data.V.dtype)
        thrusts = jax.vmap(lambda power: self.propulsion(power, air_data).force_b[0])(powers)
        rising = jax.lax.cummax(thrusts)
        index = jnp.clip(jnp.sum(thrust >= rising) - 1, 0, _POWER_GRID.size - 2)

        def interpolate(low: tuple[Scalar, Scalar], high: tuple[Scalar, Scalar]) -> Scalar:
            span = high[1] - low[1]
            share = (thrust - low[1]) / jnp.where(span > 0.0, span, 1.0)
            return low[0] + (high[0] - low[0]) * jnp.clip(share, 0.0, 1.0)

        def narrow(_: object, ends: tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]) -> Any:
            power = interpolate(*ends)
            between = power, self.propulsion(power, air_data).force_b[0]
            is_below = between[1] <= thrust
            return jax.tree.map(lambda a, b: jnp.where(is_below, a, b), (between, ends[1]), (ends[0], between))

        ends = tuple((powers[k], rising[k]) for k in (index, index + 1))
        return jnp.clip(interpolate(*jax.lax.fori_loop(0, 2, narrow, ends)), 0.0, 100.0)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether altitude or Mach number is outside `altitude_range` or `mach_range`."""
        return is_outside(air_data.altitude, self.altitude_range) | is_outside(air_data.mach, self.mach_range)


_FORCES = tuple(f"aeroBodyForceCoefficient_{axis}" for axis in "XYZ")
_MOMENTS = tuple(f"aeroBodyMomentCoefficient_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
_RATES = tuple(f"bodyAngularRate_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
AERO_OUTPUTS = (*_FORCES, *_MOMENTS)
"""Variables that an aerodynamics file must define, besides `AERO_LENGTHS`: CX, CY, CZ, Cl, Cm, Cn."""
AERO_LENGTHS = ("referenceWingArea", "referenceWingSpan", "referenceWingChord")
STANDARD_INPUTS = (*AIR_INPUTS, *_RATES)
"""Inputs available for any aircraft; other inputs must be surfaces or have a default value."""
SURFACE_INPUT = "an input of its own, neither air data nor a body rate nor the input of another surface"
_INERTIAS = (
    *(f"bodyMomentOfInertia_{axis}" for axis in ("Roll", "Pitch", "Yaw")),
    *(f"bodyProductOfInertia_{axes}" for axes in ("XY", "YZ", "ZX")),
)
_QUANTITIES = ("Jxx", "Jyy", "Jzz", "Jxy", "Jyz", "Jxz")
_CENTRE = tuple(f"bodyPositionOfCmWrtMrc_{axis}" for axis in "XYZ")
INERTIA_OUTPUTS = (*_INERTIAS, *_CENTRE, "totalMass")
"""Variables that an inertia file must define: moments and products of inertia, centre of mass and mass."""
_ALPHAS, _SPEEDS_M_S, _POWERS = 41, (20.0, 60.0, 200.0, 600.0), (0.0, 50.0, 100.0)
"""Grid of the search for a static side force: number of alphas, airspeeds (m/s), and engine powers (percent)."""


class DaveMlAircraft(AbstractAirframe):
    """Airframe whose coefficients, in body axes about a moment reference centre, come from a DAVE-ML file."""

    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    evaluator: Evaluator
    #: Reference lengths (m) and area (m^2) of the file.
    span: Scalar
    wing_area: Scalar
    mean_chord: Scalar
    centre_b: Vector3  #: Centre of mass relative to the moment reference centre, body axes, m.
    coefficient_factors: Float[Array, "6"]  #: Factors on CX, CY, CZ, Cl, Cm, Cn of the file; 1 for no change.
    airspeed_min: Scalar  #: Least airspeed that the file receives, m/s, because p b/2V is unbounded at rest.
    validity: Validity
    #: Name or varID of the file's input for each surface, in the actuators' order.
    inputs: tuple[str, ...] = eqx.field(static=True)
    #: Whether airframe or engine may have a side force while sideslip, rates and deflections are zero.
    has_static_side_force: bool = eqx.field(static=True, default=True)

    @property
    def symmetric(self) -> bool:
        """Whether the side force is zero if sideslip, rates and deflections are zero."""
        return not self.has_static_side_force

    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Float[Array, "6"]:
        """Return the file's CX, CY, CZ, Cl, Cm, Cn times `coefficient_factors`.

        The moments are about the moment reference centre. `rates_b` are the body rates relative to the air, rad/s;
        `surfaces` are the deflections, rad.
        """
        limited_air_data = eqx.tree_at(lambda d: d.V, air_data, jnp.maximum(air_data.V, self.airspeed_min))
        inputs = {
            **air_inputs(self.evaluator, limited_air_data),
            **_used_inputs(self.evaluator, dict(zip(_RATES, rates_b, strict=True))),
            **dict(zip(self.inputs, surfaces, strict=True)),
        }
        outputs = self.evaluator.evaluate_si(inputs, AERO_OUTPUTS)
        return self.coefficient_factors * jnp.stack([outputs[name] for name in AERO_OUTPUTS])

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute the force (N) and the moment about the centre of mass (N m), in body axes.

        Force F = qbar S (CX, CY, CZ); moment qbar S (b Cl, c Cm, b Cn) - `centre_b` x F. Arguments:
        `AbstractAirframe.aerodynamics`.
        """
        c = self.coefficients(air_data, rates_b, surfaces)
        scale = air_data.qbar * self.wing_area
        force_b = scale * c[:3]
        reference_moment_b = scale * jnp.stack([self.span, self.mean_chord, self.span]) * c[3:]
        return Wrench(force_b, reference_moment_b - cross(self.centre_b, force_b))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether alpha, beta, airspeed, altitude or Mach number is outside the aerodynamic or the engine data."""
        return super().outside_tables(air_data) | self.validity.excludes(air_data)


def dave_ml_airframe(
    aerodynamics: Model,
    inertia: Model | tuple[MassProperties, Vector3],
    propulsion: Model | AbstractEngine | None,
    actuators: AbstractActuators,
    inputs: Sequence[str],
    *,
    alpha_range: tuple[float, float],
    beta_range: tuple[float, float],
    engine_lag: float = 1.0,
    altitude_range: tuple[float, float] = (-math.inf, math.inf),
    mach_range: tuple[float, float] = (0.0, math.inf),
    inertia_inputs: Mapping[str, float] | None = None,
    validity: Validity | None = None,
) -> DaveMlAircraft:
    """Build an airframe from models with S-119 variable names.

    Parameters
    ----------
    aerodynamics
        Model with the six coefficients in body axes (`AERO_OUTPUTS`) and the reference area, span and chord.
    inertia
        Model with the variables `INERTIA_OUTPUTS`; or a pair: mass properties, and position of the centre of mass
        relative to the moment reference centre (body axes, m).
    propulsion
        Model with thrust and thrust moment (`ENGINE_OUTPUTS`) as functions of the power lever angle in percent; or an
        engine; or None for no engine.
    actuators
        Actuators of the surfaces.
    inputs
        For each surface, name or varID of the input of `aerodynamics` that receives the deflection.
    alpha_range, beta_range
        Valid range of the aerodynamic tables, rad.
    engine_lag
        Time constant from throttle to power, s, if `propulsion` is a model.
    altitude_range, mach_range
        Valid range of the propulsion model, m and Mach number.
    inertia_inputs
        Inputs of `inertia`, for example the centre of gravity, in the units of the file.
    validity
        Valid range of airspeed, altitude and Mach number; None: unlimited.

    Raises
    ------
    ValueError
        Any of these faults:

        - a model lacks a required variable;
        - the number of `inputs` differs from the number of surfaces;
        - the input of a surface is air data, a body rate or the input of another surface;
        - an input of the aerodynamics has no default value and is neither air data, body rate nor surface;
        - mass properties that are given as a pair are physically impossible.
    DaveMlError
        In a model, a reference length, mass or inertia is physically impossible, or a surface's input is not an angle.
    """
    _require("aerodynamics", aerodynamics, (*AERO_OUTPUTS, *AERO_LENGTHS))
    structure = aerodynamics.evaluator.structure
    ids_by_name = {structure.by_id[variable_id].name: variable_id for variable_id in structure.inputs}
    unknown = [name for name in inputs if name not in ids_by_name and name not in structure.inputs]
    if len(inputs) != len(actuators.names) or unknown:
        raise ValueError(
            f"inputs of the surfaces: arrived {', '.join(inputs)}; expected one of {', '.join(ids_by_name)} "
            f"for each of {', '.join(actuators.names)}"
        )
    surface_ids = [structure.find(name) for name in inputs]
    for k, variable_id in enumerate(surface_ids):
        refuse_other_units(aerodynamics.definition.variables[variable_id], ANGLE)
        if variable_id in surface_ids[:k] or structure.by_id[variable_id].name in STANDARD_INPUTS:
            arrived = f"{inputs[k]} for {actuators.names[k]}"
            raise ValueError(f"inputs of the surfaces: arrived {arrived}; expected {SURFACE_INPUT}")
    constants = aerodynamics.evaluator.constants
    required_ids = structure.required_variables({structure.find(name) for name in AERO_OUTPUTS}, constants.keys())
    missing = [
        n
        for n, variable_id in ids_by_name.items()
        if variable_id in required_ids - constants.keys() - {*surface_ids} and n not in STANDARD_INPUTS
    ]
    if missing:
        raise ValueError(f"aerodynamics: nothing gives {', '.join(missing)}; expected inputs of {STANDARD_INPUTS}")
    if isinstance(inertia, Model):
        _require("inertia", inertia, INERTIA_OUTPUTS)
    faults = dave_ml_body_faults(aerodynamics, inertia if isinstance(inertia, Model) else None, inertia_inputs or {})
    if faults:
        raise faults[0][1]
    mass_properties, centre_b = (
        _read_mass_properties(inertia, inertia_inputs or {}) if isinstance(inertia, Model) else inertia
    )
    engine: AbstractEngine = NoEngine()
    if isinstance(propulsion, AbstractEngine):
        engine = propulsion
    elif propulsion is not None:
        _require("propulsion", propulsion, ENGINE_OUTPUTS)
        engine = DaveMlEngine(
            evaluator=propulsion.evaluator,
            lag=as_array(engine_lag),
            altitude_range=(as_array(altitude_range[0]), as_array(altitude_range[1])),
            mach_range=(as_array(mach_range[0]), as_array(mach_range[1])),
            extrapolation_thrust=mass_properties.mass * STANDARD_GRAVITY_M_S2,
            point_b=as_array(np.zeros(3)),
            thrust_factor=as_array(1.0),
        )
    wing_area, span, mean_chord = (as_array(value) for value in _si(aerodynamics, AERO_LENGTHS, {}).values())
    aircraft = DaveMlAircraft(
        mass_properties=mass_properties,
        actuators=actuators,
        engine=engine,
        alpha_range=(as_array(alpha_range[0]), as_array(alpha_range[1])),
        beta_range=(as_array(beta_range[0]), as_array(beta_range[1])),
        evaluator=aerodynamics.evaluator,
        wing_area=wing_area,
        span=span,
        mean_chord=mean_chord,
        centre_b=centre_b,
        coefficient_factors=as_array(np.ones(6)),
        airspeed_min=as_array(1.0),
        validity=unlimited_validity() if validity is None else validity,
        inputs=tuple(inputs),
    )
    refuse_impossible_body(aircraft, "dave_ml_airframe")
    return dataclasses.replace(aircraft, has_static_side_force=_has_static_side_force(aircraft))


def _has_static_side_force(aircraft: DaveMlAircraft) -> bool:
    """Whether airframe or engine has a side force at sea level while sideslip, rates and deflections are zero."""
    low, high = aircraft.alpha_range
    alphas = np.linspace(float(low), float(high), _ALPHAS)
    return bool(np.any(_side_forces(aircraft, *(as_array(grid) for grid in (alphas, _SPEEDS_M_S, _POWERS)))))


@jax.jit
def _side_forces(aircraft: DaveMlAircraft, alphas: Array, speeds: Array, powers: Array) -> Array:
    """Compute side forces (N) without sideslip, rates and deflections; shape (alphas, speeds, powers + 1).

    The last axis holds the engine's side force at each power (percent), then the aerodynamic side force. `alphas` are
    in rad, `speeds` in m/s.
    """
    zero = jnp.zeros(())

    def side(alpha: Scalar, speed: Scalar) -> Vector:
        air_data = AirData(speed, alpha, zero, zero + 1.0, 0.5 * speed**2, speed / 340.0, zero)
        force_b = aircraft.aerodynamics(air_data, jnp.zeros(3), jnp.zeros(len(aircraft.inputs))).force_b
        engine_forces = jax.vmap(lambda power: aircraft.engine.propulsion(power, air_data).force_b[1])(powers)
        return jnp.append(engine_forces, force_b[1])

    return jax.vmap(jax.vmap(side, in_axes=(None, 0)), in_axes=(0, None))(alphas, speeds)


def dave_ml_body_faults(
    aerodynamics: Model | None, inertia: Model | None, inertia_inputs: Mapping[str, float]
) -> list[tuple[str, DaveMlError]]:
    """List the impossible reference lengths, masses and moments of inertia of an aerodynamics and an inertia file.

    Each fault is a pair: "aerodynamics" or "inertia", and an error with the position in that file. A model that is None
    is not checked; `inertia_inputs` are in the units of the file.
    """
    located_faults: list[tuple[str, DaveMlError]] = []
    if aerodynamics is not None:
        faults = body_faults(_si(aerodynamics, AERO_LENGTHS, {}), np.eye(3).tolist())
        located_faults += [("aerodynamics", _fault(aerodynamics, fault.quantity, fault)) for fault in faults]
    if inertia is None:
        return located_faults
    values = _si(inertia, INERTIA_OUTPUTS, inertia_inputs)
    located_faults += [
        ("inertia", _fault(inertia, name, BodyFault(name, values[name], "a finite number")))
        for name in _CENTRE
        if not math.isfinite(values[name])
    ]
    names = {**dict(zip(_QUANTITIES, _INERTIAS, strict=True)), "totalMass": "totalMass"}
    faults = body_faults({"totalMass": values["totalMass"]}, _inertia_matrix(values).tolist())
    return located_faults + [("inertia", _fault(inertia, names[fault.quantity], fault)) for fault in faults]


def _fault(model: Model, name: str, fault: BodyFault) -> DaveMlError:
    variable = model.definition.variables[model.evaluator.structure.find(name)]
    unit = model.evaluator.unit(name)
    si = f" {unit.si}" if unit.si else ""
    arrived = (
        f"{fault.arrived / unit.factor:.10g} {variable.units}, {fault.arrived:.10g}{si}, of {name} ({variable.id})"
    )
    return variable.location.fault(arrived, fault.expected)


def _si(model: Model, names: Sequence[str], inputs: Mapping[str, float]) -> dict[str, float]:
    """Return the values of a model's variables by name, in SI units; `inputs` are in the units of the file."""
    values = model.evaluate(inputs, names)
    return {name: float(value) * model.evaluator.unit(name).factor for name, value in values.items()}


def _inertia_matrix(si: Mapping[str, float]) -> np.ndarray:
    Jx, Jy, Jz, Jxy, Jyz, Jzx = (si[name] for name in _INERTIAS)
    return np.array([[Jx, -Jxy, -Jzx], [-Jxy, Jy, -Jyz], [-Jzx, -Jyz, Jz]])


def _read_mass_properties(inertia: Model, inputs: Mapping[str, float]) -> tuple[MassProperties, Vector3]:
    """Return the mass properties and the centre of mass relative to the moment reference centre (body axes, m)."""
    si = _si(inertia, INERTIA_OUTPUTS, inputs)
    return rigid_body(si["totalMass"], _inertia_matrix(si)), as_array([si[name] for name in _CENTRE])


def _require(file_label: str, model: Model, names: Sequence[str]) -> None:
    structure = model.evaluator.structure
    available_names = {quantity.name for quantity in structure.quantities} | set(structure.by_id)
    available_names |= {quantity.name for quantity in structure.by_id.values()}
    missing = [name for name in names if name not in available_names]
    if missing:
        raise ValueError(f"{file_label}: the file has no variable named {', '.join(missing)}")
