"""A second airframe, different from the F-16 throughout: constant derivatives, a propeller, a tenth of the mass.

The North American Navion at 176 ft/s, sea level: R. C. Nelson, *Flight Stability and Automatic Control*, 2nd ed., table
B.1 ("General aviation airplane: NAVION"); the data go back to G. L. Teper, NASA CR-96008, 1969. Deviations from the
source, each with its reason:

- the alpha_dot derivatives are omitted (an airframe gets the air data, not their rates);
- the drag is the parabola CD0 + K CL^2 through the printed CD and its printed slope, so that it stays positive;
- Cl of the rudder is 0.0107: the printed 0.107 repeats the value of Clr and is ten times too large for this fin.

The engine is not published with the derivatives: 285 hp (the Rangemaster's) through a propeller of efficiency 0.8,
power proportional to density, response a first-order lag of 0.8 s; throttle and power differ by the factor 100 only.
"""

import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, AbstractEngine, AirData, FirstOrderActuators, MassProperties, Wrench
from anser.aircraft.engines import EnginePower, thrust_along_body_x
from anser.environment import StandardAtmosphere
from anser.numerics.linear import inverse3
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.units import DEG_RAD, FOOT_M, POUND_KG, SLUG_FT2_KG_M2

_PROPELLER_POWER_W = 0.8 * 285 * 745.7
_PROPELLER_SPEED_M_S = 20.0
"""Keeps the thrust of an ideal propeller, power over speed, finite at rest."""


class LightEngine(AbstractEngine):
    """Piston engine and propeller: power falls with density, thrust with speed, and the response has one lag."""

    lag: Scalar  #: Time constant, s.

    def _thrust_at_full_power(self, air_data: AirData) -> Scalar:
        sea = StandardAtmosphere().at(0.0)
        share = air_data.density / sea.density
        return _PROPELLER_POWER_W * share / jnp.sqrt(air_data.V**2 + _PROPELLER_SPEED_M_S**2)

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """Power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """First-order lag toward 100 times the throttle, percent/s."""
        return EnginePower((100 * jnp.clip(throttle, 0.0, 1.0) - state.power) / self.lag)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust along body x through the centre of gravity, proportional to power."""
        return thrust_along_body_x(power / 100 * self._thrust_at_full_power(air_data))

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Power, 0..100 percent, for the thrust nearest to `thrust`."""
        return jnp.clip(100 * thrust / self._thrust_at_full_power(air_data), 0.0, 100.0)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Steady-state throttle for a power."""
        return jnp.clip(jnp.asarray(power) / 100, 0.0, 1.0)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Throttle for the power rate nearest to `power_rate`."""
        return jnp.clip((power + self.lag * power_rate) / 100, 0.0, 1.0)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Never: the formula holds at any speed."""
        return air_data.V < 0.0


class LightAircraft(AbstractAirframe):
    """Light propeller aircraft with aerodynamic coefficients linear in everything but the drag."""

    mass_properties: MassProperties
    actuators: FirstOrderActuators
    engine: LightEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    #: Reference lengths (m) and area (m^2).
    span: Scalar
    wing_area: Scalar
    mean_chord: Scalar

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Lift and drag turned by alpha into body axes, side force, moments; all derivatives per rad."""
        V = jnp.maximum(air_data.V, 1.0)
        alpha, beta = air_data.alpha, air_data.beta
        elevator, aileron, rudder = surfaces[0], surfaces[1], surfaces[2]
        p = rates_b[0] * self.span / (2 * V)
        q = rates_b[1] * self.mean_chord / (2 * V)
        r = rates_b[2] * self.span / (2 * V)
        K = 0.33 / (2 * 0.41 * 4.44)
        CL = 0.41 + 4.44 * alpha + 3.8 * q + 0.355 * elevator
        CD = 0.05 + K * (CL**2 - 0.41**2)
        CY = -0.564 * beta + 0.157 * rudder
        Cl = -0.074 * beta - 0.410 * p + 0.107 * r - 0.134 * aileron + 0.0107 * rudder
        Cm = -0.683 * alpha - 9.96 * q - 0.923 * elevator
        Cn = 0.071 * beta - 0.0575 * p - 0.125 * r - 0.0035 * aileron - 0.072 * rudder
        sa, ca = jnp.sin(alpha), jnp.cos(alpha)
        scale = air_data.qbar * self.wing_area
        return Wrench(
            force_b=scale * jnp.stack([CL * sa - CD * ca, CY, -CL * ca - CD * sa]),
            moment_b=scale * jnp.stack([self.span * Cl, self.mean_chord * Cm, self.span * Cn]),
        )


def light_aircraft() -> AbstractAirframe:
    """Build the Navion."""
    inertia_b = jnp.diag(jnp.array([1048.0, 3000.0, 3530.0])) * SLUG_FT2_KG_M2
    limit = jnp.array([25.0, 20.0, 20.0]) * DEG_RAD
    return LightAircraft(
        mass_properties=MassProperties(
            mass=jnp.asarray(2750.0 * POUND_KG),
            inertia_b=inertia_b,
            inertia_inverse_b=inverse3(inertia_b),
            spin_momentum_b=jnp.zeros(3),
        ),
        actuators=FirstOrderActuators(
            time_constant=jnp.full(3, 0.1), lower=-limit, upper=limit, rate_limit=jnp.full(3, 60.0 * DEG_RAD)
        ),
        engine=LightEngine(lag=jnp.asarray(0.8)),
        # up to the stall, at a CL of about 1.35
        alpha_range=(jnp.asarray(-10.0 * DEG_RAD), jnp.asarray(12.0 * DEG_RAD)),
        beta_range=(jnp.asarray(-20.0 * DEG_RAD), jnp.asarray(20.0 * DEG_RAD)),
        span=jnp.asarray(33.4 * FOOT_M),
        wing_area=jnp.asarray(184.0 * FOOT_M**2),
        mean_chord=jnp.asarray(5.7 * FOOT_M),
    )
