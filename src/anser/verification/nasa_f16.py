"""NASA's F-16 of the NESC check-cases.

Published DAVE-ML files, and the built-in model with actuators and engine that follow the commands without lag.
"""

import functools
from importlib import resources
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.actuators import FirstOrderActuators
from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.engines import AbstractEngine, EnginePower
from anser.aircraft.f16 import F16
from anser.aircraft_files.library import load_airframe
from anser.dave_ml.model import Model, read_dave_ml
from anser.numerics.arrays import as_array
from anser.shapes import Flag, Scalar, ScalarLike


@functools.cache
def published_model(name: str) -> Model:
    """Read a file of NASA's F-16 by name, without suffix: `F16_aero`. Sources: see the README beside the files."""
    content = resources.files("anser.dave_ml").joinpath(f"nasa/{name}.dml").read_bytes()
    return read_dave_ml(content, f"{name}.dml")


_LAGS_IN_STEP = 1.6
"""Integration step over lag. A classical Runge-Kutta step leaves at least 27 % of a difference, at this ratio."""


class EngineOverride(AbstractEngine):
    """Engine that delegates to `base`; subclasses override the differing methods."""

    base: AbstractEngine

    def steady_state(self, power: ScalarLike) -> Any:
        """State of the base engine."""
        return self.base.steady_state(power)

    def rate(self, state: Any, throttle: ScalarLike, air_data: AirData) -> Any:
        """Rate of the base engine."""
        return self.base.rate(state, throttle, air_data)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust of the base engine."""
        return self.base.propulsion(power, air_data)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Inverse of the base engine."""
        return self.base.power_for_thrust(thrust, air_data)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Inverse of the base engine."""
        return self.base.throttle_for_power(power)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Inverse of the base engine."""
        return self.base.throttle_for_power_rate(power, power_rate)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Range of the base engine."""
        return self.base.outside_tables(air_data)


class PromptEngine(EngineOverride):
    """Engine with the thrust tables of `base`; the power follows the throttle (1: 100 percent) at once.

    Attributes
    ----------
    lag
        Time constant of the power, s.
    """

    lag: Scalar

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """State: power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """First-order lag."""
        return EnginePower((100.0 * jnp.clip(throttle, 0.0, 1.0) - state.power) / self.lag)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Power as a fraction."""
        return jnp.clip(jnp.asarray(power) / 100.0, 0.0, 1.0)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Inverse of the lag."""
        return self.throttle_for_power(power + self.lag * power_rate)


def prompt_f16(step_s: float) -> F16:
    """Build the s119 F-16 with the shortest lags that a step (s) can integrate, and without rate limits."""
    published = load_airframe("f16", "s119")
    lag = as_array(step_s / _LAGS_IN_STEP)
    actuators = published.actuators
    prompt = FirstOrderActuators(
        time_constant=jnp.full_like(actuators.lower, lag),
        lower=actuators.lower,
        upper=actuators.upper,
        rate_limit=jnp.full_like(actuators.lower, jnp.inf),
    )
    engine = PromptEngine(published.engine, lag)
    return eqx.tree_at(lambda f16: (f16.actuators, f16.engine), published, (prompt, engine))
