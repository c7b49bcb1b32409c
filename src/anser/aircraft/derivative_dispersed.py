"""An aircraft of derivatives with its data dispersed."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators, FirstOrderActuators, SecondOrderActuators
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.electric_propeller import ElectricPropeller
from anser.aircraft.engine import AbstractEngine
from anser.aircraft.jet_engine import JetEngine
from anser.aircraft.piston_propeller import PistonPropeller
from anser.shapes import Scalar, Vector, Vector3


class DerivativeDispersion(eqx.Module):
    """How one aircraft differs from its data; factors of 1 and a shift of 0 leave it as it is.

    Attributes
    ----------
    derivatives
        Factor on each of `DerivativeAircraft.derivatives`.
    tables
        Factor on each function of its tables; None where it has none.
    thrust, mass
        Factors.
    inertia
        Factors on the moments of inertia in roll, pitch and yaw, shape (3,); positive. A product of inertia changes by
        the root of both of its factors, which keeps the matrix positive definite.
    actuator_bandwidth
        Factor on the bandwidth of all actuators; positive.
    cg_shift
        Of the centre of gravity, part of the mean chord; positive is aft.
    """

    derivatives: Float[Array, "6 columns"]
    tables: Vector | None
    thrust: Scalar
    mass: Scalar
    inertia: Vector3
    actuator_bandwidth: Scalar
    cg_shift: Scalar


def dispersed_derivative_aircraft(aircraft: DerivativeAircraft, dispersion: DerivativeDispersion) -> DerivativeAircraft:
    """Aircraft of the same structure with dispersed data."""
    properties = aircraft.mass_properties
    root = jnp.sqrt(dispersion.inertia)
    # D J D and its inverse: symmetric and positive definite with J
    congruence = root[:, None] * root[None, :]
    forward_b = jnp.stack([dispersion.cg_shift * aircraft.mean_chord, *jnp.zeros(2)])
    changed = eqx.tree_at(
        lambda a: (
            a.derivatives,
            a.mass_properties.mass,
            a.mass_properties.inertia_b,
            a.mass_properties.inertia_inverse_b,
            a.actuators,
            a.engine,
            a.cg_offset_b,
        ),
        aircraft,
        (
            aircraft.derivatives * dispersion.derivatives,
            properties.mass * dispersion.mass,
            properties.inertia_b * congruence,
            properties.inertia_inverse_b / congruence,
            quickened(aircraft.actuators, dispersion.actuator_bandwidth),
            changed_engine(aircraft.engine, dispersion.thrust, forward_b),
            aircraft.cg_offset_b - forward_b,
        ),
    )
    if aircraft.table_factors is None or dispersion.tables is None:
        return changed
    return eqx.tree_at(lambda a: a.table_factors, changed, aircraft.table_factors * dispersion.tables)


def quickened(actuators: AbstractActuators, factor: Scalar) -> AbstractActuators:
    """Actuators of another bandwidth.

    Raises
    ------
    TypeError
        Actuators of a kind that has no bandwidth known here.
    """
    if isinstance(actuators, FirstOrderActuators):
        return eqx.tree_at(lambda a: a.time_constant, actuators, actuators.time_constant / factor)
    if isinstance(actuators, SecondOrderActuators):
        return eqx.tree_at(lambda a: a.frequency, actuators, actuators.frequency * factor)
    raise TypeError(f"actuators: arrived {type(actuators).__name__}; expected first- or second-order ones")


def changed_engine(engine: AbstractEngine, thrust: Scalar, shift_b: Vector3) -> AbstractEngine:
    """Engine with a factor on its thrust, seen from a centre of gravity that lies so far behind (m); else as it is."""
    if not isinstance(engine, JetEngine | ElectricPropeller | PistonPropeller):
        return engine
    return eqx.tree_at(
        lambda e: (e.thrust_factor, e.point_b), engine, (engine.thrust_factor * thrust, engine.point_b + shift_b)
    )
