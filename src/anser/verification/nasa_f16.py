"""NASA's F-16 of the NESC check-cases.

Its published DAVE-ML files, and the built-in model with actuators and engine that follow their commands without lag.
"""

import functools
from importlib import resources

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
    """A file of NASA's F-16 by its name without ending, `F16_aero`; the README beside them says whence."""
    content = resources.files("anser.dave_ml").joinpath(f"nasa/{name}.dml").read_bytes()
    return read_dave_ml(content, f"{name}.dml")


_LAGS_IN_STEP = 1.6
"""Steps of the integrator in units of the lag: 27 % of a difference are left after a step, the least that a classical
Runge-Kutta step can leave."""


class PromptEngine(AbstractEngine):
    """The thrust tables of another engine, with a power that follows the throttle, 1 for 100 percent, at once.

    Attributes
    ----------
    published
        Engine whose thrust it has.
    lag
        Time constant of the power, s.
    """

    published: AbstractEngine
    lag: Scalar

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """Power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """First-order lag."""
        return EnginePower((100.0 * jnp.clip(throttle, 0.0, 1.0) - state.power) / self.lag)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """As published."""
        return self.published.propulsion(power, air_data)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """As published."""
        return self.published.power_for_thrust(thrust, air_data)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Power as a fraction."""
        return jnp.clip(jnp.asarray(power) / 100.0, 0.0, 1.0)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Inverse of the lag."""
        return self.throttle_for_power(power + self.lag * power_rate)

    def outside_tables(self, air_data: AirData) -> Flag:
        """As published."""
        return self.published.outside_tables(air_data)


def prompt_f16(step_s: float) -> F16:
    """The s119 F-16 without lags and rate limits that a step (s) could resolve."""
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
