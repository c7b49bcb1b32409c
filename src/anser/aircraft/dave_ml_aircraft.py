"""An airframe and an engine whose numbers come from DAVE-ML files (ANSI/AIAA S-119) with the standard's.

Variable names.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData, Validity, Wrench, is_outside, unlimited_validity
from anser.aircraft.airframe import AbstractAirframe, MassProperties, refuse_impossible_body
from anser.aircraft.engines import (
    AbstractEngine,
    EnginePower,
    NoEngine,
    lagged_power_rate,
    steady_throttle,
    throttle_for_rate,
)
from anser.airframe_data import BodyFault, body_faults
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
"""What a file of propulsion must give."""
ENGINE_POWER = "powerLeverAngle"
"""The input of a file of propulsion by which it is set, percent."""
AIR_INPUTS = (
    "trueAirspeed",
    "angleOfAttack",
    "angleOfSideslip",
    "mach",
    "altitudeMSL",
    "dynamicPressure",
    "airDensity",
)
"""Inputs that say in what air a file is asked."""
_POWER_GRID = np.arange(0.0, 101.0, 10.0)


def air_inputs(evaluator: Evaluator, air_data: AirData) -> dict[str, ScalarLike]:
    """Those of `AIR_INPUTS` that a file has as inputs, SI units and rad."""
    given = (
        air_data.V,
        air_data.alpha,
        air_data.beta,
        air_data.mach,
        air_data.altitude,
        air_data.qbar,
        air_data.density,
    )
    asked = {evaluator.structure.by_id[one].name for one in evaluator.structure.inputs}
    return {name: value for name, value in zip(AIR_INPUTS, given, strict=True) if name in asked}


class DaveMlEngine(AbstractEngine):
    """Thrust by a file, set by its power lever in percent; the power follows the throttle with one lag.

    Attributes
    ----------
    evaluator
        Of the file.
    lag
        Time constant, s: a file of propulsion has none.
    altitude_range, mach_range
        Where its tables hold: m and Mach number.
    beyond
        Thrust by 100 percent of power beyond 0 to 100, N. No flight gets there; a search for a steady one does on its
        way, and finds no way back where a file holds its thrust at the ends.
    point_b
        What the moment of the file is about, seen from the centre of gravity, m.
    thrust_factor
        On all thrust and its moment; 1 as the file has it.
    """

    evaluator: Evaluator
    lag: Scalar
    altitude_range: tuple[Scalar, Scalar]
    mach_range: tuple[Scalar, Scalar]
    extrapolation_thrust: Scalar
    point_b: Vector3
    thrust_factor: Scalar

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """Power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """First-order lag toward 100 times the throttle, percent/s."""
        return lagged_power_rate(state.power, throttle, self.lag)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust and its moment about the centre of gravity."""
        # percent is a fraction in SI units
        within = jnp.clip(power, 0.0, 100.0)
        inputs = {**air_inputs(self.evaluator, air_data), ENGINE_POWER: within / 100.0}
        found = self.evaluator.evaluate_si(inputs, ENGINE_OUTPUTS)
        force_b, moment_b = (jnp.stack([found[name] for name in names]) for names in (_THRUST, _TORQUE))
        force_b = self.thrust_factor * force_b.at[0].add(self.extrapolation_thrust * (power - within) / 100.0)
        return Wrench(force_b, self.thrust_factor * moment_b + cross(self.point_b, force_b))

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Power (0..100 percent) whose thrust is nearest to `thrust` (N): exact where it is linear between tenths."""
        powers = jnp.asarray(_POWER_GRID, air_data.V.dtype)
        known = jax.vmap(lambda power: self.propulsion(power, air_data).force_b[0])(powers)
        rising = jax.lax.cummax(known)
        at = jnp.clip(jnp.sum(thrust >= rising) - 1, 0, _POWER_GRID.size - 2)
        span = rising[at + 1] - rising[at]
        share = (thrust - rising[at]) / jnp.where(span > 0.0, span, 1.0)
        return jnp.clip(powers[at] + 10.0 * jnp.clip(share, 0.0, 1.0), 0.0, 100.0)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Throttle that holds a power."""
        return steady_throttle(power)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Throttle whose lag gives nearest to the wanted rate."""
        return throttle_for_rate(power, power_rate, self.lag)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether altitude or Mach number lies outside what is told of the tables."""
        low, high = self.altitude_range
        slow, fast = self.mach_range
        out = (air_data.altitude < low) | (air_data.altitude > high)
        return out | (air_data.mach < slow) | (air_data.mach > fast)


_FORCES = tuple(f"aeroBodyForceCoefficient_{axis}" for axis in "XYZ")
_MOMENTS = tuple(f"aeroBodyMomentCoefficient_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
_RATES = tuple(f"bodyAngularRate_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
_LENGTHS = ("referenceWingArea", "referenceWingSpan", "referenceWingChord")
AERO_OUTPUTS = (*_FORCES, *_MOMENTS)
"""What a file of aerodynamics must give, besides `AERO_LENGTHS`."""
AERO_LENGTHS = _LENGTHS
STANDARD_INPUTS = (*AIR_INPUTS, *_RATES)
"""Inputs that are known of any aircraft; all others have to be its surfaces, or have a usual value."""
_INERTIAS = (
    *(f"bodyMomentOfInertia_{axis}" for axis in ("Roll", "Pitch", "Yaw")),
    *(f"bodyProductOfInertia_{axes}" for axes in ("XY", "YZ", "ZX")),
)
_QUANTITIES = ("Jxx", "Jyy", "Jzz", "Jxy", "Jyz", "Jxz")
_CENTRE = tuple(f"bodyPositionOfCmWrtMrc_{axis}" for axis in "XYZ")
INERTIA_OUTPUTS = (*_INERTIAS, *_CENTRE, "totalMass")
"""What a file of inertia must give."""
_GRAVITY_M_S2 = 9.80665
_ALPHAS, _SPEEDS_M_S, _POWERS = 41, (20.0, 60.0, 200.0, 600.0), (0.0, 50.0, 100.0)
"""Where a side force is looked for: Mach numbers up to 1.8, at sea level."""


class DaveMlAircraft(AbstractAirframe):
    """Aerodynamics by a file: coefficients in body axes about its moment reference centre.

    Attributes
    ----------
    evaluator
        Of the file.
    span, wing_area, mean_chord
        Reference lengths (m) and area (m^2) of the file.
    centre_b
        Centre of mass seen from the moment reference centre, body axes, m.
    coefficient_factors
        On CX, CY, CZ, Cl, Cm, Cn of the file; 1 as they are.
    inputs
        The file's input that each surface moves.
    still_side_force
        Whether there may be a side force without sideslip, rates and deflections.
    airspeed_least
        Below it the airspeed of the file is held, m/s: p b/2V has no bound at rest.
    validity
        Of airspeed, altitude and Mach number.
    """

    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    evaluator: Evaluator
    span: Scalar
    wing_area: Scalar
    mean_chord: Scalar
    centre_b: Vector3
    coefficient_factors: Float[Array, "6"]
    airspeed_least: Scalar
    validity: Validity
    inputs: tuple[str, ...] = eqx.field(static=True)
    has_static_side_force: bool = eqx.field(static=True, default=True)

    @property
    def symmetric(self) -> bool:
        """Whether `has_static_side_force` says so."""
        return not self.has_static_side_force

    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Float[Array, "6"]:
        """CX, CY, CZ, Cl, Cm, Cn of the file times their factors, moments about its reference centre."""
        slow = eqx.tree_at(lambda d: d.V, air_data, jnp.maximum(air_data.V, self.airspeed_least))
        inputs = {
            **air_inputs(self.evaluator, slow),
            **dict(zip(_RATES, rates_b, strict=True)),
            **dict(zip(self.inputs, surfaces, strict=True)),
        }
        found = self.evaluator.evaluate_si(inputs, AERO_OUTPUTS)
        return self.coefficient_factors * jnp.stack([found[name] for name in AERO_OUTPUTS])

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Force qbar S (CX, CY, CZ); moment qbar S (b Cl, c Cm, b Cn) less the centre of mass cross the force."""
        c = self.coefficients(air_data, rates_b, surfaces)
        scale = air_data.qbar * self.wing_area
        force_b = scale * c[:3]
        about_reference = scale * jnp.stack([self.span, self.mean_chord, self.span]) * c[3:]
        return Wrench(force_b, about_reference - cross(self.centre_b, force_b))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Outside the ranges of alpha, beta, airspeed, altitude or Mach number, or of the engine's data."""
        return (
            is_outside(air_data.alpha, self.alpha_range)
            | is_outside(air_data.beta, self.beta_range)
            | self.validity.excludes(air_data)
            | self.engine.outside_tables(air_data)
        )


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
    given: Mapping[str, float] | None = None,
    validity: Validity | None = None,
) -> DaveMlAircraft:
    """Build an airframe from models that name their variables as S-119 does.

    Parameters
    ----------
    aerodynamics
        Gives the six coefficients in body axes (`AERO_OUTPUTS`) and the reference area, span and chord.
    inertia
        Gives mass, moments and products of inertia, and the centre of mass seen from the moment reference centre (body
        axes, m); or these themselves.
    propulsion
        Gives thrust and its moment (`ENGINE_OUTPUTS`) from the power lever angle in percent; or an engine; None: none.
    actuators
        Of the surfaces: a file of aerodynamics has none.
    inputs
        The variable of `aerodynamics` that each surface moves.
    alpha_range, beta_range
        Where its tables hold, rad.
    engine_lag
        Time constant with which the power follows the throttle, s: a file of propulsion has none.
    altitude_range, mach_range
        Where the tables of the engine hold, m and Mach number.
    given
        Inputs of `inertia`, such as the centre of gravity, in the units of the file.
    validity
        For which airspeeds, altitudes and Mach numbers the data hold; None: for any.

    Raises
    ------
    ValueError
        A model lacks a variable; the message names it and what there is. Or an input of the aerodynamics is none of the
        air, the body rates or the surfaces, and has no usual value. Or mass properties are none that a body has.
    DaveMlError
        A reference length, the mass or the inertia is none that a body has, or the input of a surface is no angle.
    """
    _require("aerodynamics", aerodynamics, (*AERO_OUTPUTS, *AERO_LENGTHS))
    structure = aerodynamics.evaluator.structure
    named = {structure.by_id[one].name: one for one in structure.inputs}
    unknown = [name for name in inputs if name not in named and name not in structure.inputs]
    if len(inputs) != len(actuators.names) or unknown:
        raise ValueError(
            f"inputs of the surfaces: arrived {', '.join(inputs)}; expected one of {', '.join(named)} for each of "
            f"{', '.join(actuators.names)}"
        )
    for name in inputs:
        refuse_other_units(aerodynamics.definition.variables[structure.find(name)], ANGLE)
    constants = aerodynamics.evaluator.constants
    needed = structure.required_variables({structure.find(name) for name in AERO_OUTPUTS}, constants.keys())
    missing = [
        n for n, one in named.items() if one in needed - constants.keys() and n not in (*STANDARD_INPUTS, *inputs)
    ]
    if missing:
        raise ValueError(f"aerodynamics: nothing gives {', '.join(missing)}; expected inputs of {STANDARD_INPUTS}")
    if isinstance(inertia, Model):
        _require("inertia", inertia, INERTIA_OUTPUTS)
    faults = dave_ml_body_faults(aerodynamics, inertia if isinstance(inertia, Model) else None, given or {})
    if faults:
        raise faults[0][1]
    mass_properties, centre_b = _mass_of(inertia, given or {}) if isinstance(inertia, Model) else inertia
    engine: AbstractEngine = NoEngine()
    if isinstance(propulsion, AbstractEngine):
        engine = propulsion
    elif propulsion is not None:
        _require("propulsion", propulsion, ENGINE_OUTPUTS)
        altitudes = as_array(altitude_range[0]), as_array(altitude_range[1])
        machs = as_array(mach_range[0]), as_array(mach_range[1])
        engine = DaveMlEngine(
            propulsion.evaluator,
            as_array(engine_lag),
            altitudes,
            machs,
            mass_properties.mass * _GRAVITY_M_S2,
            point_b=as_array(np.zeros(3)),
            thrust_factor=as_array(1.0),
        )
    wing_area, span, mean_chord = (as_array(value) for value in _si(aerodynamics, AERO_LENGTHS, {}).values())
    made = DaveMlAircraft(
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
        airspeed_least=as_array(1.0),
        validity=unlimited_validity() if validity is None else validity,
        inputs=tuple(inputs),
    )
    refuse_impossible_body(made, "dave_ml_airframe")
    return dataclasses.replace(made, has_static_side_force=_has_still_side_force(made))


def _has_still_side_force(aircraft: DaveMlAircraft) -> bool:
    """Whether files leave a side force at any of some angles of attack, airspeeds and powers, all else at rest."""
    low, high = aircraft.alpha_range
    alphas = np.linspace(float(low), float(high), _ALPHAS)
    return bool(np.any(_side_forces(aircraft, *(as_array(one) for one in (alphas, _SPEEDS_M_S, _POWERS)))))


@jax.jit
def _side_forces(aircraft: DaveMlAircraft, alphas: Vector, speeds: Vector, powers: Vector) -> Array:
    """Side force of air and engine without sideslip, rates and deflections, N, over angle of attack and airspeed."""
    zero = jnp.zeros(())

    def side(alpha: Scalar, speed: Scalar) -> Vector:
        air_data = AirData(speed, alpha, zero, zero + 1.0, 0.5 * speed**2, speed / 340.0, zero)
        force_b = aircraft.aerodynamics(air_data, jnp.zeros(3), jnp.zeros(len(aircraft.inputs))).force_b
        pushed = jax.vmap(lambda power: aircraft.engine.propulsion(power, air_data).force_b[1])(powers)
        return jnp.append(pushed, force_b[1])

    return jax.vmap(jax.vmap(side, in_axes=(None, 0)), in_axes=(0, None))(alphas, speeds)


def dave_ml_body_faults(
    aerodynamics: Model | None, inertia: Model | None, given: Mapping[str, float]
) -> list[tuple[str, DaveMlError]]:
    """Find reference lengths, mass and inertia of files that no body has.

    Parameters
    ----------
    aerodynamics, inertia
        As of `dave_ml_airframe`, with all variables that it asks for; None: no such file.
    given
        Inputs of `inertia`, in the units of the file.

    Returns
    -------
    Each with the part, "aerodynamics" or "inertia", and its place in the file.
    """
    found: list[tuple[str, DaveMlError]] = []
    if aerodynamics is not None:
        faults = body_faults(_si(aerodynamics, AERO_LENGTHS, {}), np.eye(3).tolist())
        found += [("aerodynamics", _fault(aerodynamics, fault.quantity, fault)) for fault in faults]
    if inertia is None:
        return found
    values = _si(inertia, INERTIA_OUTPUTS, given)
    found += [
        ("inertia", _fault(inertia, name, BodyFault(name, values[name], "a finite number")))
        for name in _CENTRE
        if not math.isfinite(values[name])
    ]
    names = {**dict(zip(_QUANTITIES, _INERTIAS, strict=True)), "totalMass": "totalMass"}
    faults = body_faults({"totalMass": values["totalMass"]}, _inertia_matrix(values).tolist())
    return found + [("inertia", _fault(inertia, names[fault.quantity], fault)) for fault in faults]


def _fault(model: Model, name: str, fault: BodyFault) -> DaveMlError:
    variable = model.definition.variables[model.evaluator.structure.find(name)]
    unit = model.evaluator.unit(name)
    si = f" {unit.si}" if unit.si else ""
    arrived = (
        f"{fault.arrived / unit.factor:.10g} {variable.units}, {fault.arrived:.10g}{si}, of {name} ({variable.id})"
    )
    return variable.location.fault(arrived, fault.expected)


def _si(model: Model, names: Sequence[str], given: Mapping[str, float]) -> dict[str, float]:
    """Values of variables, SI units."""
    values = model.evaluate(given, names)
    return {name: float(value) * model.evaluator.unit(name).factor for name, value in values.items()}


def _inertia_matrix(si: Mapping[str, float]) -> np.ndarray:
    Jx, Jy, Jz, Jxy, Jyz, Jzx = (si[name] for name in _INERTIAS)
    return np.array([[Jx, -Jxy, -Jzx], [-Jxy, Jy, -Jyz], [-Jzx, -Jyz, Jz]])


def _mass_of(inertia: Model, given: Mapping[str, float]) -> tuple[MassProperties, Vector3]:
    """Mass, inertia and centre of mass by a file."""
    si = _si(inertia, INERTIA_OUTPUTS, given)
    inertia_b = _inertia_matrix(si)
    properties = MassProperties(
        mass=as_array(si["totalMass"]),
        inertia_b=as_array(inertia_b),
        inertia_inverse_b=as_array(np.linalg.inv(inertia_b)),
        spin_momentum_b=as_array(np.zeros(3)),
    )
    return properties, as_array([si[name] for name in _CENTRE])


def _require(what: str, model: Model, names: Sequence[str]) -> None:
    structure = model.evaluator.structure
    there = {quantity.name for quantity in structure.quantities} | set(structure.by_id)
    there |= {quantity.name for quantity in structure.by_id.values()}
    missing = [name for name in names if name not in there]
    if missing:
        raise ValueError(f"{what}: the file has no variable named {', '.join(missing)}")
