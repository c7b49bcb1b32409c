"""What befalls one aircraft in flight."""

import equinox as eqx
import jax.numpy as jnp

from anser.numerics import as_array
from anser.shapes import Flag, Scalar, ScalarLike


class Faults(eqx.Module):
    """Losses of one aircraft, each from a time on (s); infinite: never.

    Attributes
    ----------
    thrust_time, thrust_left
        From when on its engine gives only a part (0..1) of its thrust.
    sensor_time
        From when on the sensor of its goal fails.
    leaving_time
        From when on it is no longer one of its fleet: it flies the plan that is made for it then, straight on, and
        nobody waits for it.
    """

    thrust_time: Scalar
    thrust_left: Scalar
    sensor_time: Scalar
    leaving_time: Scalar

    def thrust(self, time: ScalarLike) -> Scalar:
        """Part of the thrust that is left."""
        return jnp.where(time >= self.thrust_time, self.thrust_left, 1.0)

    def goal_sensor_works(self, time: ScalarLike) -> Flag:
        """Whether the goal can be sensed."""
        return jnp.asarray(time < self.sensor_time)

    def left(self, time: ScalarLike) -> Flag:
        """Whether it has left its fleet."""
        return jnp.asarray(time >= self.leaving_time)


def no_faults() -> Faults:
    """None."""
    never = as_array(jnp.inf)
    return Faults(never, as_array(1.0), never, never)
