"""An airframe, and an engine, whose numbers come from DAVE-ML files (ANSI/AIAA S-119) with its standard names."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData
from anser.aircraft.engine import AbstractEngine, EnginePower
from anser.aircraft.interface import AbstractAirframe, MassProperties
from anser.aircraft.lagged_power import lagged_rate, steady_throttle, throttle_of_rate
from anser.aircraft.wrench import Wrench
from anser.dave_ml import Evaluator
from anser.numerics import cross
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3

_FORCES = tuple(f"aeroBodyForceCoefficient_{axis}" for axis in "XYZ")
_MOMENTS = tuple(f"aeroBodyMomentCoefficient_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
_RATES = tuple(f"bodyAngularRate_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
_LENGTHS = ("referenceWingArea", "referenceWingSpan", "referenceWingChord")
_THRUST = tuple(f"thrustBodyForce_{axis}" for axis in "XYZ")
_TORQUE = tuple(f"thrustBodyMoment_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
_POWER = "powerLeverAngle"
AERO_OUTPUTS = (*_FORCES, *_MOMENTS)
"""What a file of aerodynamics must give, besides `AERO_LENGTHS`."""
AERO_LENGTHS = _LENGTHS
ENGINE_OUTPUTS = (*_THRUST, *_TORQUE)
"""What a file of propulsion must give."""
ENGINE_POWER = _POWER
"""The input of a file of propulsion by which it is set, percent."""
_OF_AIR = ("trueAirspeed", "angleOfAttack", "angleOfSideslip", "mach", "altitudeMSL", "dynamicPressure", "airDensity")
KNOWN_INPUTS = (*_OF_AIR, *_RATES)
"""Inputs that are known of any aircraft; all others have to be its surfaces, or have a usual value."""
_POWERS = np.arange(0.0, 101.0, 10.0)


def _air_inputs(evaluator: Evaluator, air_data: AirData) -> dict[str, ScalarLike]:
    """Those of `_OF_AIR` that a file has as inputs, SI units and rad."""
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
    return {name: value for name, value in zip(_OF_AIR, given, strict=True) if name in asked}


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
    """

    evaluator: Evaluator
    lag: Scalar
    altitude_range: tuple[Scalar, Scalar]
    mach_range: tuple[Scalar, Scalar]

    def settled(self, power: ScalarLike) -> EnginePower:
        """Power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """First-order lag toward 100 times the throttle, percent/s."""
        return lagged_rate(state.power, throttle, self.lag)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust and its moment about the centre of gravity."""
        # percent is a fraction in SI units
        inputs = {**_air_inputs(self.evaluator, air_data), _POWER: jnp.asarray(power) / 100.0}
        found = self.evaluator.evaluate_si(inputs, ENGINE_OUTPUTS)
        return Wrench(*(jnp.stack([found[name] for name in names]) for names in (_THRUST, _TORQUE)))

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Power (0..100 percent) whose thrust is nearest to `thrust` (N): exact where it is linear between tenths."""
        powers = jnp.asarray(_POWERS)
        known = jax.vmap(lambda power: self.propulsion(power, air_data).force_b[0])(powers)
        rising = jax.lax.cummax(known)
        at = jnp.clip(jnp.sum(thrust >= rising) - 1, 0, _POWERS.size - 2)
        span = rising[at + 1] - rising[at]
        share = (thrust - rising[at]) / jnp.where(span > 0.0, span, 1.0)
        return jnp.clip(powers[at] + 10.0 * jnp.clip(share, 0.0, 1.0), 0.0, 100.0)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Throttle that holds a power."""
        return steady_throttle(power)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Throttle whose lag gives nearest to the wanted rate."""
        return throttle_of_rate(power, power_rate, self.lag)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether altitude or Mach number lies outside what is told of the tables."""
        low, high = self.altitude_range
        slow, fast = self.mach_range
        out = (air_data.altitude < low) | (air_data.altitude > high)
        return out | (air_data.mach < slow) | (air_data.mach > fast)


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
    inputs
        The file's input that each surface moves.
    airspeed_least
        Below it the airspeed of the file is held, m/s: p b/2V has no bound at rest.
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
    airspeed_least: Scalar
    inputs: tuple[str, ...] = eqx.field(static=True)

    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Float[Array, "6"]:
        """CX, CY, CZ, Cl, Cm, Cn of the file, moments about its reference centre."""
        slow = eqx.tree_at(lambda d: d.V, air_data, jnp.maximum(air_data.V, self.airspeed_least))
        inputs = {
            **_air_inputs(self.evaluator, slow),
            **dict(zip(_RATES, rates_b, strict=True)),
            **dict(zip(self.inputs, surfaces, strict=True)),
        }
        found = self.evaluator.evaluate_si(inputs, AERO_OUTPUTS)
        return jnp.stack([found[name] for name in AERO_OUTPUTS])

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Force qbar S (CX, CY, CZ); moment qbar S (b Cl, c Cm, b Cn) less the centre of mass cross the force."""
        c = self.coefficients(air_data, rates_b, surfaces)
        scale = air_data.qbar * self.wing_area
        force_b = scale * c[:3]
        about_reference = scale * jnp.stack([self.span, self.mean_chord, self.span]) * c[3:]
        return Wrench(force_b, about_reference - cross(self.centre_b, force_b))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Outside the ranges of alpha and beta, or outside the engine's."""
        return (
            (air_data.alpha < self.alpha_range[0])
            | (air_data.alpha > self.alpha_range[1])
            | (air_data.beta < self.beta_range[0])
            | (air_data.beta > self.beta_range[1])
            | self.engine.outside_tables(air_data)
        )
