"""Changed aircraft: factors on effectiveness, drag, lift, mass and actuators, and a shifted centre of gravity."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe, MassProperties
from anser.aircraft.dispersions import dispersed_mass
from anser.aircraft.engines import AbstractEngine
from anser.numerics.linear import cross
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3


class AirframeChange(eqx.Module):
    """Change of an airframe by fault, ice or load: factors (1: no change), and a shift of the centre of gravity."""

    #: Factor on the aerodynamically effective deflection of each surface; actuators and stops are unchanged.
    surface_effectiveness: Vector
    #: Factors on drag and lift in stability axes (body axes turned by alpha alone). The moments about the original
    #: centre of gravity and the zero-lift angle of attack do not change.
    drag: Scalar
    lift_slope: Scalar
    #: Factor on force and moment of the engine. The simulation applies this factor through the `Disturbance` of the
    #: aircraft; a `ChangedAirframe` does not contain the factor.
    thrust: Scalar
    mass: Scalar  #: Factor on the mass.
    second_moments: Vector3  #: Factors on the second moments of mass along body x, y, z (`dispersed_mass`).
    actuator_bandwidth: Scalar  #: Factor on the bandwidth of every actuator.
    cg_shift: Scalar  #: Shift of the centre of gravity, fraction of the mean chord, positive aft; 0: no shift.


class AirframeChanges(eqx.Module):
    """Changes of an aircraft during the flight; each change lasts from its time to the end of the flight.

    The factors of simultaneous changes are multiplied; the shifts are added.
    """

    times: Float[Array, " changes"]  #: Time of each change, s.
    changes: AirframeChange  #: The changes as one object; each array has the leading axis of `times`.

    def at(self, time: ScalarLike) -> AirframeChange:
        """Return one change that combines all changes with times up to `time` (s)."""
        is_active = jnp.asarray(time) >= self.times

        def total(values: Array) -> Array:
            mask = is_active.reshape(-1, *[1] * (values.ndim - 1))
            return jnp.prod(jnp.where(mask, values, 1.0), axis=0)

        shift = jnp.sum(jnp.where(is_active, self.changes.cg_shift, 0.0))
        return eqx.tree_at(lambda c: c.cg_shift, jax.tree.map(total, self.changes), shift)


class ChangedAirframe(AbstractAirframe):
    """An airframe to which an `AirframeChange` is applied, except for the factor on the thrust."""

    airframe: AbstractAirframe  #: The airframe without the change.
    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    surface_effectiveness: Vector
    drag: Scalar
    lift_slope: Scalar
    shift_b: Vector3  #: Original centre of gravity relative to the shifted one, body axes, m.

    @property
    def symmetric(self) -> bool:
        """Whether the unchanged airframe is symmetric: `AbstractAirframe.symmetric`."""
        return self.airframe.symmetric

    @property
    def span(self) -> Any:
        """Wing span, m; raises AttributeError if the unchanged airframe has none."""
        return self.airframe.span  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def wing_area(self) -> Any:
        """Wing area, m^2; raises AttributeError if the unchanged airframe has none."""
        return self.airframe.wing_area  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def mean_chord(self) -> Any:
        """Mean chord, m; raises AttributeError if the unchanged airframe has none."""
        return self.airframe.mean_chord  # pyright: ignore[reportAttributeAccessIssue]

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute the force (N) and the moment about the shifted centre of gravity (N m), body axes.

        The factors act on drag D = -(X cos(alpha) + Z sin(alpha)) and lift L = X sin(alpha) - Z cos(alpha), where X and
        Z are the force along body x and z. Arguments: `AbstractAirframe.aerodynamics`.
        """
        wrench = self.airframe.aerodynamics(air_data, rates_b, surfaces * self.surface_effectiveness)
        X, _, Z = wrench.force_b
        sine, cosine = jnp.sin(air_data.alpha), jnp.cos(air_data.alpha)
        less_drag = (self.drag - 1.0) * (X * cosine + Z * sine)
        more_lift = (self.lift_slope - 1.0) * (X * sine - Z * cosine)
        added_b = jnp.stack(
            [cosine * less_drag + sine * more_lift, jnp.zeros_like(X), sine * less_drag - cosine * more_lift]
        )
        force_b = wrench.force_b + added_b
        return Wrench(force_b, wrench.moment_b + cross(self.shift_b, force_b))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition is outside the valid range of the unchanged airframe's or its engine's data."""
        return self.airframe.outside_tables(air_data)


def changed_airframe(airframe: AbstractAirframe, change: AirframeChange) -> ChangedAirframe:
    """Return an airframe with a change applied, except for the factor on the thrust.

    The centre of gravity is not shifted if the airframe has no `mean_chord`. Raises ValueError if the number of factors
    in `change.surface_effectiveness` differs from the number of surfaces.
    """
    count = len(airframe.actuators.names)
    if change.surface_effectiveness.shape != (count,):
        raise ValueError(
            f"surface_effectiveness: arrived shape {change.surface_effectiveness.shape}; expected ({count},), a factor "
            f"for each of {', '.join(airframe.actuators.names)}"
        )
    forward = change.cg_shift * getattr(airframe, "mean_chord", 0.0)
    shift_b = jnp.stack([forward, *jnp.zeros(2, forward.dtype)])
    return ChangedAirframe(
        airframe=airframe,
        mass_properties=dispersed_mass(airframe.mass_properties, change.mass, change.second_moments),
        actuators=airframe.actuators.with_bandwidth_scaled(change.actuator_bandwidth),
        engine=airframe.engine.with_point_shifted(shift_b),
        alpha_range=airframe.alpha_range,
        beta_range=airframe.beta_range,
        surface_effectiveness=change.surface_effectiveness,
        drag=change.drag,
        lift_slope=change.lift_slope,
        shift_b=shift_b,
    )
