"""F-16 with the constants of Stevens & Lewis' program, with which the textbook's numbers were computed.

Source: second note of the aircraft's data file. Each constant changes the last digits of a printed number.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators, Deflections
from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls, MassProperties
from anser.aircraft.engines import AbstractEngine, EnginePower
from anser.aircraft.f16 import F16
from anser.aircraft.motion import moment_for_acceleration, state_derivative
from anser.aircraft_files.library import load_f16
from anser.environment.atmosphere import AbstractAtmosphere, Air
from anser.environment.earth import FlatEarth
from anser.environment.environment import Environment, SteadyWind
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.spatial.rotations import euler_from_quaternion, quaternion_from_euler
from anser.spatial.wind_axes import flow_angles
from anser.units import DEG_RAD, FOOT_M, FT_LBF_N_M, PSF_PA, RAD_DEG, RANKINE_K, SLUG_FT3_KG_M3, SLUG_KG

TextbookState = Float[Array, "13"]
"""State vector of the textbook: VT (ft/s), alpha, beta, phi, theta, psi (rad), P, Q, R (rad/s).

Then north, east, altitude (ft) and power (percent)."""
TextbookControls = Float[Array, "4"]
"""Control vector of the textbook: throttle (0..1), elevator, aileron, rudder (deg)."""

INERTIA_RATIOS = (-0.770, 0.02755, 1.055e-4, 1.642e-6, 0.9604, 1.759e-2, 1.792e-5, -0.7336, 1.587e-5)
"""c1..c9 of the textbook's program, rounded to four digits; moments in ft lbf."""
ENGINE_MOMENTUM_SLUG_FT2_S = 160.0


class TextbookAtmosphere(AbstractAtmosphere):
    """Atmosphere of the textbook's program ([SL] appendix A, subroutine ADC)."""

    def at(self, altitude: ScalarLike) -> Air:
        """Return the air at an altitude (m)."""
        h = altitude / FOOT_M
        factor = 1.0 - 0.703e-5 * h
        temperature = jnp.where(h >= 35000.0, 390.0, 519.0 * factor)
        density = 0.002377 * factor**4.14
        return Air(
            density=density * SLUG_FT3_KG_M3,
            pressure=1715.0 * density * temperature * PSF_PA,
            temperature=temperature * RANKINE_K,
            speed_of_sound=jnp.sqrt(1.4 * 1716.3 * temperature) * FOOT_M,
        )


class TextbookF16(AbstractAirframe):
    """F-16 with the textbook's 57.3 deg/rad in CZ = CZ0 (1 - (beta/57.3)^2) and its rounded inertia ratios.

    The rounded ratios act through the moment: with the exact inertia, the adapted moment gives the textbook's angular
    acceleration.
    """

    f16: F16
    rounded_inertia: bool = eqx.field(static=True)
    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute force and moment with the textbook's CZ; Cm follows by the lever of the centre of gravity."""
        f16 = self.f16
        CZ0 = f16.tables(air_data.alpha * RAD_DEG, 0.0, 0.0)[0][0]
        change = CZ0 * (air_data.beta**2 - (air_data.beta * RAD_DEG / 57.3) ** 2)
        force = air_data.qbar * f16.wing_area * change
        zero = jnp.zeros_like(force)
        moment = force * f16.mean_chord * (f16.x_cg_reference - f16.x_cg)
        wrench = f16.aerodynamics(air_data, rates_b, surfaces) + Wrench(
            jnp.stack([zero, zero, force]), jnp.stack([zero, moment, zero])
        )
        if not self.rounded_inertia:
            return wrench
        acceleration = _textbook_acceleration(rates_b, wrench.moment_b)
        return Wrench(wrench.force_b, moment_for_acceleration(self.mass_properties, rates_b, acceleration))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition is outside the F-16's tables."""
        return self.f16.outside_tables(air_data)


def _textbook_acceleration(rates_b: Vector3, moment_b: Vector3) -> Vector3:
    """Compute the angular acceleration (rad/s^2) as the textbook's program does, with the engine's angular momentum HE.

    Source: [SL] eq. (1.7-5).
    """
    c1, c2, c3, c4, c5, c6, c7, c8, c9 = INERTIA_RATIOS
    P, Q, R = rates_b
    L, M, N = moment_b / FT_LBF_N_M
    HE = ENGINE_MOMENTUM_SLUG_FT2_S
    return jnp.stack(
        [
            (c2 * P + c1 * R + c4 * HE) * Q + c3 * L + c4 * N,
            (c5 * P - c7 * HE) * R + c6 * (R * R - P * P) + c7 * M,
            (c8 * P - c2 * R + c9 * HE) * Q + c4 * L + c9 * N,
        ]
    )


def textbook_aircraft(x_cg_over_c: float, *, rounded_inertia: bool = True) -> TextbookF16:
    """Build the F-16 of the textbook's printed numbers, with a mass of 1/0.00157 slug."""
    f16 = load_f16("textbook", x_cg_over_c)
    mass_properties = eqx.tree_at(lambda m: m.mass, f16.mass_properties, jnp.asarray(SLUG_KG / 1.57e-3))
    return TextbookF16(
        f16=f16,
        rounded_inertia=rounded_inertia,
        mass_properties=mass_properties,
        actuators=f16.actuators,
        engine=f16.engine,
        alpha_range=f16.alpha_range,
        beta_range=f16.beta_range,
    )


def textbook_environment() -> Environment:
    """Build the textbook's environment: its atmosphere without wind, and gravity of 32.17 ft/s^2."""
    return Environment(
        atmosphere=TextbookAtmosphere(), wind=SteadyWind(jnp.zeros(3)), earth=FlatEarth(jnp.asarray(32.17 * FOOT_M))
    )


def textbook_state(x: TextbookState, u: TextbookControls) -> AircraftState:
    """Convert the textbook's state vector to an aircraft state; the surfaces are at the commanded deflections."""
    VT, alpha, beta = x[0] * FOOT_M, x[1], x[2]
    direction = [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
    return AircraftState(
        position_n=jnp.stack([x[9], x[10], -x[11]]) * FOOT_M,
        velocity_b=VT * jnp.stack(direction),
        quaternion=quaternion_from_euler(x[3], x[4], x[5]),
        rates_b=x[6:9],
        actuators=Deflections(u[1:] * DEG_RAD),
        engine=EnginePower(x[12]),
    )


def textbook_controls(u: TextbookControls) -> Controls:
    """Convert the textbook's control vector to controls in SI units."""
    return Controls(surfaces=u[1:] * DEG_RAD, throttle=u[0])


def textbook_rates(
    airframe: AbstractAirframe, environment: Environment, x: TextbookState, u: TextbookControls
) -> TextbookState:
    """Return the time derivative of the textbook's state vector, in its units per second: subroutine F."""
    state = textbook_state(x, u)
    rate = state_derivative(airframe, environment, 0.0, state, textbook_controls(u))
    _, (V_dot, alpha_dot, beta_dot) = jax.jvp(flow_angles, (state.velocity_b,), (rate.velocity_b,))
    _, euler_rates = jax.jvp(euler_from_quaternion, (state.quaternion,), (rate.quaternion,))
    north, east, down = rate.position_n / FOOT_M
    return jnp.stack([V_dot / FOOT_M, alpha_dot, beta_dot, *euler_rates, *rate.rates_b, north, east, -down, rate.power])
