"""Rigid bodies of the NESC check-cases: constant drag coefficient and rate damping, no controls, no engine."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.actuators import AbstractActuators, FirstOrderActuators
from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe, MassProperties, rigid_body
from anser.aircraft.engines import AbstractEngine, NoEngine
from anser.shapes import Flag, Scalar, Vector, Vector3
from anser.units import FOOT_M, SLUG_FT2_KG_M2, SLUG_KG


class SimpleBody(AbstractAirframe):
    """A body with a constant drag coefficient, and with damping moments proportional to the body rates."""

    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    area: Scalar  # reference area, m^2
    span: Scalar  # reference length for roll and yaw, m
    chord: Scalar  # reference length for pitch, m
    drag_coefficient: Scalar  # CD, drag over qbar S; the drag is opposite to the velocity through the air
    damping: Vector3  # derivatives Clp, Cmq, Cnr with respect to p b/2V, q c/2V, r b/2V
    speed_min: Scalar  # lower limit of V in p b/2V, q c/2V, r b/2V, m/s: keeps the damping finite at rest

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute the drag (N) and the damping moments (N m), body axes. Source: [NESC] cases 1 to 10.

        `rates_b` are the body rates relative to the air, rad/s; `surfaces` have no effect.
        """
        ca, sa, cb, sb = (f(x) for x in (air_data.alpha, air_data.beta) for f in (jnp.cos, jnp.sin))
        scale = air_data.qbar * self.area
        lengths = jnp.stack([self.span, self.chord, self.span])
        reduced = rates_b * lengths / (2.0 * jnp.maximum(air_data.V, self.speed_min))
        return Wrench(
            force_b=-scale * self.drag_coefficient * jnp.stack([ca * cb, sb, sa * cb]),
            moment_b=scale * lengths * self.damping * reduced,
        )

    def outside_tables(self, air_data: AirData) -> Flag:
        """Return False: the constant coefficients have no limits."""
        return air_data.V < 0.0


def body_from_data(data: Mapping[str, Any], name: str) -> SimpleBody:
    """Build the body `name` from `data`, the content of `data/bodies.json`; raises ValueError for an unknown name."""
    if name not in data["bodies"]:
        raise ValueError(f"body {name!r}: known are {', '.join(data['bodies'])}")
    body = data["bodies"][name]
    inertia_b = np.diag(np.asarray(body["inertia_slug_ft2"], dtype=float) * SLUG_FT2_KG_M2)
    built = SimpleBody(
        mass_properties=rigid_body(body["mass_slug"] * SLUG_KG, inertia_b),
        # No surfaces: the stops are at zero.
        actuators=FirstOrderActuators(jnp.ones(3), jnp.zeros(3), jnp.zeros(3), jnp.zeros(3)),
        engine=NoEngine(),
        alpha_range=(jnp.asarray(-jnp.pi), jnp.asarray(jnp.pi)),
        beta_range=(jnp.asarray(-0.5 * jnp.pi), jnp.asarray(0.5 * jnp.pi)),
        area=body["area_ft2"] * FOOT_M**2,
        span=body["span_ft"] * FOOT_M,
        chord=body["chord_ft"] * FOOT_M,
        drag_coefficient=body["drag_coefficient"],
        damping=jnp.asarray(body["damping"], dtype=float),
        speed_min=data["speed_min_ft_s"] * FOOT_M,
    )
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), built)
