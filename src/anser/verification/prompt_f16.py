"""The F-16 of the NESC check-cases: surfaces and power follow their commands at once, as nearly as a step allows."""

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft import F16, AbstractEngine, AirData, EnginePower, FirstOrderActuators, Wrench
from anser.numerics import as_array
from anser.scenario import load_airframe
from anser.shapes import Flag, Scalar, ScalarLike

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

    def settled(self, power: ScalarLike) -> EnginePower:
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
