"""Mass, inertia, centre of gravity, actuators and thrust of an aircraft dispersed."""

from typing import TypeVar, cast

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.actuators import AbstractActuators, FirstOrderActuators, SecondOrderActuators
from anser.aircraft.dave_ml_engine import DaveMlEngine
from anser.aircraft.electric_propeller import ElectricPropeller
from anser.aircraft.engine import AbstractEngine, NoEngine
from anser.aircraft.interface import AbstractAirframe, MassProperties
from anser.aircraft.jet_engine import JetEngine
from anser.aircraft.piston_propeller import PistonPropeller
from anser.numerics import inverse3
from anser.shapes import Scalar, Vector3

AnyAirframe = TypeVar("AnyAirframe", bound=AbstractAirframe)


class BodyDispersion(eqx.Module):
    """How one aircraft differs from its data but for its aerodynamics; factors of 1 and a shift of 0 leave it as it is.

    Attributes
    ----------
    thrust, mass
        Factors.
    second_moments
        Factors on the second moments of mass along body x, y, z, shape (3,); positive. See `dispersed_mass`.
    actuator_bandwidth
        Factor on the bandwidth of all actuators; positive.
    cg_shift
        Of the centre of gravity, part of the mean chord; positive is aft.
    """

    thrust: Scalar
    mass: Scalar
    second_moments: Vector3
    actuator_bandwidth: Scalar
    cg_shift: Scalar


def dispersed_mass(properties: MassProperties, mass: Scalar, second_moments: Vector3) -> MassProperties:
    """Mass properties with a factor on the mass, and on each second moment of mass.

    The second moments are the integrals of x^2, y^2 and z^2 over the mass; Jxx is the sum of the latter two, and so on.
    A product of inertia changes by the root of both of its factors: the body is stretched along its axes, so that its
    principal moments are positive and within the triangle inequality whatever the factors.
    """
    root = jnp.sqrt(second_moments)
    J_b, eye = properties.inertia_b, jnp.eye(3, dtype=properties.inertia_b.dtype)
    integrals = 0.5 * jnp.trace(J_b) * eye - J_b  # of r r^T
    # as a change of J, which is exactly none for factors of 1
    change = integrals * (root[:, None] * root[None, :] - 1.0)
    changed_b = J_b + jnp.trace(change) * eye - change
    inverse_b = jnp.where(jnp.all(second_moments == 1.0), properties.inertia_inverse_b, inverse3(changed_b))
    return eqx.tree_at(
        lambda p: (p.mass, p.inertia_b, p.inertia_inverse_b),
        properties,
        (properties.mass * mass, changed_b, inverse_b),
    )


def dispersed_body(airframe: AnyAirframe, dispersion: BodyDispersion, shift_b: Vector3) -> AnyAirframe:
    """Airframe of the same structure with another mass, other actuators and another thrust.

    Its aerodynamics are as before: whoever calls moves their centre of gravity.

    Parameters
    ----------
    airframe
        As its data have it.
    dispersion
        How it differs.
    shift_b
        What the centre of gravity was before, seen from where it is now, m.
    """
    changed = eqx.tree_at(
        lambda a: (a.mass_properties, a.actuators, a.engine),
        airframe,
        (
            dispersed_mass(airframe.mass_properties, dispersion.mass, dispersion.second_moments),
            _quickened(airframe.actuators, dispersion.actuator_bandwidth),
            _changed_engine(airframe.engine, dispersion.thrust, shift_b),
        ),
    )
    return cast(AnyAirframe, changed)


def _quickened(actuators: AbstractActuators, factor: Scalar) -> AbstractActuators:
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


def _changed_engine(engine: AbstractEngine, thrust: Scalar, shift_b: Vector3) -> AbstractEngine:
    """Engine with a factor on its thrust, seen from a centre of gravity that lies so far behind (m).

    Raises
    ------
    TypeError
        An engine of a kind whose thrust is not known here.
    """
    if isinstance(engine, NoEngine):
        return engine
    if not isinstance(engine, DaveMlEngine | JetEngine | ElectricPropeller | PistonPropeller):
        raise TypeError(f"engine: arrived {type(engine).__name__}; expected a jet, a propeller, one by DAVE-ML")
    return eqx.tree_at(
        lambda e: (e.thrust_factor, e.point_b), engine, (engine.thrust_factor * thrust, engine.point_b + shift_b)
    )
