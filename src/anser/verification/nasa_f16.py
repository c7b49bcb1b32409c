"""NASA's F-16 of the NESC check-cases.

Its published DAVE-ML files, and the built-in model with actuators and an engine that follow commands almost at once.
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
"""Ratio of integration step to lag: here a classical Runge-Kutta step leaves the least part of a difference, 27 %."""


class EngineOverride(AbstractEngine):
    """Engine that passes every call on to `base`; subclasses override single methods."""

    base: AbstractEngine

    def steady_state(self, power: ScalarLike) -> Any:
        """Return the base engine's state of steady running at a power (percent)."""
        return self.base.steady_state(power)

    def rate(self, state: Any, throttle: ScalarLike, air_data: AirData) -> Any:
        """Return the time derivative of the base engine's state."""
        return self.base.rate(state, throttle, air_data)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Return force and moment of the base engine."""
        return self.base.propulsion(power, air_data)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the base engine's power (percent) for a thrust (N)."""
        return self.base.power_for_thrust(thrust, air_data)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Return the base engine's throttle for a power (percent)."""
        return self.base.throttle_for_power(power)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Return the base engine's throttle for a power rate (percent/s)."""
        return self.base.throttle_for_power_rate(power, power_rate)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition is outside the base engine's data."""
        return self.base.outside_tables(air_data)


class PromptEngine(EngineOverride):
    """Engine with the thrust tables of `base`, whose power follows 100 times the throttle with a very short lag.

    Attributes
    ----------
    lag
        Time constant of the power, s.
    """

    lag: Scalar

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """Return the engine state: the power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """Return the rate of the power, percent/s, by the first-order lag."""
        return EnginePower((100.0 * jnp.clip(throttle, 0.0, 1.0) - state.power) / self.lag)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Return the power as a fraction (0..1)."""
        return jnp.clip(jnp.asarray(power) / 100.0, 0.0, 1.0)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Return the throttle for a power rate (percent/s): the inverse of the lag."""
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
