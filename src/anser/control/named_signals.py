"""What an aircraft measures, by the names of ANSI/AIAA S-119: the inputs of control laws that come in files."""

import jax.numpy as jnp

from anser.environment import StandardAtmosphere
from anser.sensing import Belief
from anser.shapes import Scalar
from anser.spatial import euler_from_quaternion, rotate


def named_signals(belief: Belief) -> dict[str, Scalar]:
    """Flight condition by standard names, SI units and radians.

    Body rates are those relative to the rotating Earth, in body axes: the inertial ones less the rotation of the Earth.
    The participants of the NESC check-cases feed them to the control laws. The equivalent airspeed refers to the
    density of the standard atmosphere at sea level. Source: ANSI/AIAA S-119-2011, annex A.
    """
    state, now = belief.state, belief.now
    data = now.air_data
    roll, pitch, yaw = euler_from_quaternion(state.quaternion)
    rates_b = state.rates_b + rotate(now.R_bn, now.earth.transport_rate_n)
    density_ratio = data.density / StandardAtmosphere().at(jnp.zeros_like(data.density)).density
    return {
        "altitudeMsl": data.altitude,
        "trueAirspeed": data.V,
        "equivalentAirspeed": data.V * jnp.sqrt(density_ratio),
        "mach": data.mach,
        "dynamicPressure": data.qbar,
        "angleOfAttack": data.alpha,
        "angleOfSideslip": data.beta,
        "eulerAngle_Roll": roll,
        "eulerAngle_Pitch": pitch,
        "eulerAngle_Yaw": yaw,
        "bodyAngularRate_Roll": rates_b[0],
        "bodyAngularRate_Pitch": rates_b[1],
        "bodyAngularRate_Yaw": rates_b[2],
    }
