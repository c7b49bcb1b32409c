"""An engine whose thrust comes from a DAVE-ML file (ANSI/AIAA S-119) with its standard names."""

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.air_data import AirData
from anser.aircraft.engine import AbstractEngine, EnginePower
from anser.aircraft.lagged_power import lagged_rate, steady_throttle, throttle_of_rate
from anser.aircraft.wrench import Wrench
from anser.dave_ml import Evaluator
from anser.numerics import cross
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

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
_POWERS = np.arange(0.0, 101.0, 10.0)


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
    beyond: Scalar
    point_b: Vector3
    thrust_factor: Scalar

    def settled(self, power: ScalarLike) -> EnginePower:
        """Power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """First-order lag toward 100 times the throttle, percent/s."""
        return lagged_rate(state.power, throttle, self.lag)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust and its moment about the centre of gravity."""
        # percent is a fraction in SI units
        within = jnp.clip(power, 0.0, 100.0)
        inputs = {**air_inputs(self.evaluator, air_data), ENGINE_POWER: within / 100.0}
        found = self.evaluator.evaluate_si(inputs, ENGINE_OUTPUTS)
        force_b, moment_b = (jnp.stack([found[name] for name in names]) for names in (_THRUST, _TORQUE))
        force_b = self.thrust_factor * force_b.at[0].add(self.beyond * (power - within) / 100.0)
        return Wrench(force_b, self.thrust_factor * moment_b + cross(self.point_b, force_b))

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Power (0..100 percent) whose thrust is nearest to `thrust` (N): exact where it is linear between tenths."""
        powers = jnp.asarray(_POWERS, air_data.V.dtype)
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
