"""Propeller engines: electric motor with fixed pitch, and piston engine with constant efficiency."""

import jax.numpy as jnp

from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.engines import AbstractLaggedEngine, thrust_at_point
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

_TWO_PI = 2.0 * jnp.pi
_TINY = 1e-12
"""Lower limit of the argument of a square root, for finite gradients."""


class ElectricPropeller(AbstractLaggedEngine):
    """Electric motor, and a propeller with coefficients quadratic in the advance ratio.

    The motor voltage is proportional to the power (percent), which is the lagged throttle, not a mechanical power.

    Source: R. W. Beard, T. W. McLain, *Small Unmanned Aircraft*, chapter 4 with the authors' addendum on propellers:

    - advance ratio J = V / (n D) at n revolutions per second;
    - thrust rho n^2 D^4 C_T(J), propeller torque rho n^2 D^5 C_Q(J);
    - motor torque K_Q ((V_in - K_V Omega) / R - i0) at Omega = 2 pi n.

    Omega (at least 0) follows from the balance of the torques. A slow propeller at high airspeed brakes (negative
    thrust) and drives the motor.
    """

    diameter: Scalar  #: Propeller diameter D, m.
    #: Polynomials C_T and C_Q: coefficients of 1, J, J^2.
    thrust_polynomial: Vector3
    torque_polynomial: Vector3
    motor_constant: Scalar  #: Motor constant: K_V in V s / rad, equal to K_Q in N m / A.
    resistance: Scalar  #: Resistance R, ohm.
    no_load_current: Scalar  #: No-load current i0, A.
    voltage_max: Scalar  #: Motor voltage V_in at a power of 100 percent, V.
    direction: Scalar  #: 1 for a propeller that turns to the right as seen from behind (reaction to the left); else -1.
    lag: Scalar  #: Time constant from throttle to power, s.
    point_b: Vector3  #: Point of thrust application relative to the centre of gravity, m.
    thrust_factor: Scalar  #: Factor on the thrust; 1 for the published values.

    def _torque_terms(self, air_data: AirData) -> tuple[Scalar, Scalar, Scalar]:
        """Return a, b, c of the propeller torque a Omega^2 + b Omega + c (N m), Omega in rad/s."""
        rho, D, V = air_data.density, self.diameter, air_data.V
        C = self.torque_polynomial
        return rho * D**5 / _TWO_PI**2 * C[0], rho * D**4 / _TWO_PI * C[1] * V, rho * D**3 * C[2] * V**2

    def motor_speed(self, power: ScalarLike, air_data: AirData) -> Scalar:
        """Return the angular velocity (rad/s) at which motor and propeller torque balance, at a power (percent)."""
        a, b, c = self._torque_terms(air_data)
        K, R = self.motor_constant, self.resistance
        b = b + K * K / R
        c = c + K * (self.no_load_current - self.voltage_max * power / 100.0 / R)
        root = jnp.sqrt(jnp.maximum(b * b - 4.0 * a * c, _TINY))
        # of the two equivalent formulas, the one without cancellation
        b_is_negative = b < 0.0
        root_if_negative = (root - b) / (2.0 * a)
        root_if_positive = -2.0 * c / (jnp.where(b_is_negative, 1.0, b) + root)
        return jnp.maximum(jnp.where(b_is_negative, root_if_negative, root_if_positive), 0.0)

    def thrust_and_torque(self, power: ScalarLike, air_data: AirData) -> tuple[Scalar, Scalar]:
        """Return the thrust (N), times `thrust_factor`, and the propeller torque (N m) at a power of 0..100 percent."""
        rho, D, V = air_data.density, self.diameter, air_data.V
        n = self.motor_speed(power, air_data) / _TWO_PI
        T, Q = self.thrust_polynomial, self.torque_polynomial
        thrust = rho * D**4 * (T[0] * n * n + T[1] * n * V / D + T[2] * (V / D) ** 2)
        torque = rho * D**5 * (Q[0] * n * n + Q[1] * n * V / D + Q[2] * (V / D) ** 2)
        return self.thrust_factor * thrust, torque

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Compute the thrust along body x (N), negative for a braking propeller, and its moment (N m).

        The moment about the centre of gravity includes the torque reaction. Trim searches may pass a power outside
        0..100 percent; the thrust is then extrapolated linearly.
        """
        available_power = jnp.clip(power, 0.0, 100.0)
        thrust, torque = self.thrust_and_torque(available_power, air_data)
        n = self.voltage_max / self.motor_constant / _TWO_PI
        slope = self.thrust_factor * air_data.density * self.diameter**4 * self.thrust_polynomial[0] * n * n / 100.0
        return thrust_at_point(thrust + slope * (power - available_power), -self.direction * torque, self.point_b)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the power (0..100 percent) whose thrust is nearest to `thrust` (N), in closed form.

        At very low propeller speeds the thrust falls with the speed; the returned power is on the branch of rising
        thrust.
        """
        rho, D, V = air_data.density, self.diameter, air_data.V
        T = self.thrust_polynomial
        half_linear_term = T[1] * V / (2.0 * D)
        constant_term = T[2] * (V / D) ** 2 - thrust / (self.thrust_factor * rho * D**4)
        n = (
            -half_linear_term + jnp.sqrt(jnp.maximum(half_linear_term * half_linear_term - T[0] * constant_term, _TINY))
        ) / T[0]
        omega = _TWO_PI * jnp.maximum(n, 0.0)
        a, b, c = self._torque_terms(air_data)
        torque = a * omega * omega + b * omega + c
        K = self.motor_constant
        voltage = self.resistance * (torque / K + self.no_load_current) + K * omega
        return jnp.clip(100.0 * voltage / self.voltage_max, 0.0, 100.0)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Return False: the polynomials have no limits."""
        return air_data.V < 0.0


_SEA_LEVEL_DENSITY_KG_M3 = 1.225
_FRICTION = 0.132
_LEAST_SHARE = 0.01
"""Lower limit of the power at altitude over the power at sea level, so that `power_for_thrust` stays finite."""


class PistonPropeller(AbstractLaggedEngine):
    """Piston engine with a propeller of constant efficiency, limited by the static thrust at low speed.

    - Shaft power at full throttle without supercharger: P = P0 (1.132 rho / rho0 - 0.132), with the density rho0 at sea
      level. Source: F. Gagg, E. Farrar, *Altitude performance of aircraft engines equipped with gear-driven
      superchargers*, SAE Transactions 29, 1934.
    - Thrust: eta P / sqrt(V^2 + V0^2) with V0 = eta P0 / T0. The limits are eta P / V in fast flight, and the static
      thrust T0 at rest at sea level.
    """

    shaft_power: Scalar  #: P0, shaft power at full throttle at sea level, W.
    efficiency: Scalar  #: eta, propeller efficiency in fast flight.
    static_thrust: Scalar  #: Static thrust T0, N.
    #: Reaction torque about body x per shaft power, N m / W: 1 / angular velocity of a constant-speed propeller.
    #: Positive for a propeller that turns to the left as seen from behind.
    torque_per_power: Scalar
    lag: Scalar  #: Time constant from throttle to power, s.
    point_b: Vector3  #: Point of thrust application relative to the centre of gravity, m.
    thrust_factor: Scalar  #: Factor on the thrust; 1 for the published values.

    def _full_throttle(self, air_data: AirData) -> tuple[Scalar, Scalar]:
        """Return the thrust (N), times `thrust_factor`, and the shaft power (W) at a power setting of 100 percent."""
        share = (1.0 + _FRICTION) * air_data.density / _SEA_LEVEL_DENSITY_KG_M3 - _FRICTION
        power = self.shaft_power * jnp.maximum(share, _LEAST_SHARE)
        slow = self.efficiency * self.shaft_power / self.static_thrust
        return self.thrust_factor * self.efficiency * power / jnp.sqrt(air_data.V**2 + slow**2), power

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Compute the thrust along body x (N) and its moment (N m), both proportional to the power (percent).

        The moment about the centre of gravity includes the torque reaction.
        """
        thrust, shaft_power = self._full_throttle(air_data)
        return thrust_at_point(
            thrust * power / 100.0, self.torque_per_power * shaft_power * power / 100.0, self.point_b
        )

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the power (0..100 percent) whose thrust is nearest to `thrust` (N)."""
        return jnp.clip(100.0 * thrust / self._full_throttle(air_data)[0], 0.0, 100.0)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Return False: the formula has no limits of airspeed, altitude or Mach number."""
        return air_data.V < 0.0
