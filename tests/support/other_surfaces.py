"""The light aircraft with different names and numbers of control surfaces, for code that must not assume three."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import (
    AbstractActuators,
    AbstractAirframe,
    AbstractEngine,
    AirData,
    FirstOrderActuators,
    MassProperties,
    SecondOrderActuators,
    Wrench,
)
from anser.shapes import Flag, Scalar, Vector, Vector3
from anser.units import DEG_RAD
from support.light_aircraft import light_aircraft

ELEVONS = ("left_elevon", "right_elevon")
SPLIT = ("elevator", "left_aileron", "right_aileron", "rudder")


class MixedSurfaces(AbstractAirframe):
    """An airframe whose surfaces act as linear combinations of another airframe's surfaces.

    Attributes
    ----------
    base
        The underlying airframe.
    mixing
        Matrix from the deflections to those of the base, shape (surfaces of the base, surfaces).
    """

    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    base: AbstractAirframe
    mixing: Float[Array, "others surfaces"]

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Aerodynamics of the base."""
        return self.base.aerodynamics(air_data, rates_b, self.mixing @ surfaces)

    def outside_tables(self, air_data: AirData) -> Flag:
        """As for the base."""
        return self.base.outside_tables(air_data)


def _mixed(actuators, mixing):
    base = light_aircraft()
    return MixedSurfaces(
        mass_properties=base.mass_properties,
        actuators=actuators,
        engine=base.engine,
        alpha_range=base.alpha_range,
        beta_range=base.beta_range,
        base=base,
        mixing=jnp.asarray(mixing),
    )


def elevon_aircraft():
    """Two elevons: half their sum is the elevator, half their difference the ailerons; no rudder."""
    limit = jnp.full(2, 25.0 * DEG_RAD)
    actuators = FirstOrderActuators(
        time_constant=jnp.full(2, 0.1), lower=-limit, upper=limit, rate_limit=jnp.full(2, 1.0), names=ELEVONS
    )
    return _mixed(actuators, [[0.5, 0.5], [0.5, -0.5], [0.0, 0.0]])


def four_elevator_aircraft():
    """Four elevators; no ailerons and no rudder: no surface makes a moment about the roll or the yaw axis."""
    limit = jnp.full(4, 25.0 * DEG_RAD)
    names = ("left_inner", "left_outer", "right_inner", "right_outer")
    actuators = FirstOrderActuators(
        time_constant=jnp.full(4, 0.1), lower=-limit, upper=limit, rate_limit=jnp.full(4, 1.0), names=names
    )
    return _mixed(actuators, [[0.25] * 4, [0.0] * 4, [0.0] * 4])


def split_aileron_aircraft():
    """Separate ailerons on each side instead of a common deflection; second-order actuators."""
    limit = jnp.array([25.0, 20.0, 20.0, 20.0]) * DEG_RAD
    actuators = SecondOrderActuators(
        frequency=jnp.full(4, 20.0),
        damping=jnp.full(4, 0.8),
        lower=-limit,
        upper=limit,
        rate_limit=jnp.full(4, 1.0),
        names=SPLIT,
    )
    return _mixed(actuators, [[1.0, 0.0, 0.0, 0.0], [0.0, 0.5, 0.5, 0.0], [0.0, 0.0, 0.0, 1.0]])
