"""What the air does to the aircraft: speed, flow angles, dynamic pressure, Mach number."""

import equinox as eqx

from anser.environment import Air
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial import flow_angles


class AirData(eqx.Module):
    """Air data of one aircraft (theory section 2).

    True airspeed V (m/s), alpha and beta (rad), density (kg/m^3), dynamic pressure qbar (Pa), Mach number and geometric
    altitude (m).
    """

    V: Scalar
    alpha: Scalar
    beta: Scalar
    density: Scalar
    qbar: Scalar
    mach: Scalar
    altitude: Scalar


def air_data(velocity_air_b: Vector3, altitude: ScalarLike, air: Air) -> AirData:
    """Air data from the air-relative velocity in body axes (m/s), the altitude (m) and the air there."""
    V, alpha, beta = flow_angles(velocity_air_b)
    return AirData(
        V=V,
        alpha=alpha,
        beta=beta,
        density=air.density,
        qbar=0.5 * air.density * V * V,
        mach=V / air.speed_of_sound,
        altitude=altitude + 0.0 * V,
    )
