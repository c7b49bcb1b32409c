"""Verification of the Aerosonde: forces, moments and accelerations published with its authors' simulator."""

from collections.abc import Iterator, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from anser.aircraft.air_data import AirData
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.motion import angular_acceleration
from anser.aircraft_files.build import build_airframe, with_derivatives
from anser.aircraft_files.schema import AirframeFile
from anser.aircraft_files.sources import library_file
from anser.verification.checks import Comparison, load_published, make_check

_TOLERANCE = 1e-10
_SPEED_OF_SOUND_M_S = 340.0
"""Speed of sound in the air data, m/s; any value serves, since the coefficients do not depend on the Mach number."""


def _rotation(quaternion: list[float]) -> np.ndarray:
    """Return the rotation matrix R(q) / det R(q) from body to NED axes, as in the authors' simulator."""
    q0, q1, q2, q3 = quaternion
    R = np.array(
        [
            [q0**2 + q1**2 - q2**2 - q3**2, 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)],
            [2 * (q1 * q2 + q0 * q3), q0**2 - q1**2 + q2**2 - q3**2, 2 * (q2 * q3 - q0 * q1)],
            [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), q0**2 - q1**2 - q2**2 + q3**2],
        ]
    )
    return R / np.linalg.det(R)  # the length of the published quaternion is 1 only to 1e-8


def _compare(
    airframe: DerivativeAircraft, case: Mapping[str, Any], density: float, gravity: float
) -> Iterator[Comparison]:
    state, controls = case["state"], case["controls"]
    V, alpha, beta = case.get("V", 25.0), case.get("alpha", 0.0), case.get("beta", 0.0)
    air_quantities = (V, alpha, beta, density, 0.5 * density * V * V, V / _SPEED_OF_SOUND_M_S, 100.0)
    data = AirData(*(jnp.asarray(float(number)) for number in air_quantities))
    velocity_b, rates_b = np.asarray(state["velocity_b_m_s"], float), np.asarray(state["rates_b_rad_s"], float)
    surfaces = jnp.asarray([controls[name] for name in airframe.actuators.names])
    propulsive = airframe.engine.propulsion(100.0 * controls["throttle"], data)
    total = airframe.aerodynamics(data, jnp.asarray(rates_b), surfaces) + propulsive
    mass = float(airframe.mass_properties.mass)
    force_b = np.asarray(total.force_b) + mass * _rotation(state["quaternion"]).T @ np.array([0.0, 0.0, gravity])
    linear = force_b / mass - np.cross(rates_b, velocity_b)
    angular = angular_acceleration(airframe.mass_properties, jnp.asarray(rates_b), total.moment_b)
    quantities = {
        "thrust": ("N", [case["thrust_N"]], [propulsive.force_b[0]]),
        "propeller torque": ("N m", [case["torque_Nm"]], [-propulsive.moment_b[0]]),
        "force": ("N", case["force_moment"][:3], force_b),
        "moment": ("N m", case["force_moment"][3:], total.moment_b),
        "acceleration": ("m/s^2", case["derivatives_uvw_pqr"][:3], linear),
        "angular acceleration": ("rad/s^2", case["derivatives_uvw_pqr"][3:], angular),
    }
    for group, (unit, published, values) in quantities.items():
        for axis, expected, obtained in zip("xyz", published, values, strict=False):
            yield Comparison(group, f"{case['name']}, {axis}", unit, expected, float(obtained), _TOLERANCE)


def _measure() -> Iterator[Comparison]:
    data, file = load_published("aerosonde_checks"), library_file("aerosonde")
    if not isinstance(file, AirframeFile):
        raise TypeError(f"aerosonde: {type(file).__name__}; expected a file of derivatives")
    airframe = with_derivatives(build_airframe(file), file, {"CD0": 0.0})
    density, gravity = data["rho_check_kg_m3"], data["gravity_check_m_s2"]
    for case in data["checks"]:
        yield from _compare(airframe, case, density, gravity)


AEROSONDE_FORCES = make_check("aerosonde-forces", _measure)
