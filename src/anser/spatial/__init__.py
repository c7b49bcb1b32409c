"""Directions and places: rotations and attitude, wind axes, the WGS-84 ellipsoid and the frames around it.

A rotation is named for the frames it joins: ``R_bn`` takes vectors from NED (n) to body (b); w is wind axes, e
Earth-fixed, i inertial.
"""

from anser.spatial.frames import (
    ecef_from_eci,
    ecef_from_ned_point,
    eci_from_ecef,
    ned_from_ecef_point,
    rotation_ecef_from_eci,
    rotation_ned_from_ecef,
    velocity_ecef_from_eci,
    velocity_eci_from_ecef,
)
from anser.spatial.rotations import (
    compose,
    euler_from_quaternion,
    euler_from_rotation,
    normalize,
    quaternion_derivative,
    quaternion_from_euler,
    quaternion_from_rotation,
    quaternion_multiply,
    rotate,
    rotate_back,
    rotation_from_euler,
    rotation_from_quaternion,
)
from anser.spatial.safe import safe_atan2, safe_hypot, safe_norm
from anser.spatial.wgs84 import (
    WGS84,
    Ellipsoid,
    ecef_from_geodetic,
    flat_from_geodetic,
    flat_stretch,
    geodetic_from_ecef,
    geodetic_from_flat,
    places_from_flat,
    radii_of_curvature,
)
from anser.spatial.wind_axes import (
    attitude_from_path,
    bank_about_velocity,
    flow_angles,
    path_angles,
    rotation_wind_from_body,
)

__all__ = [
    "WGS84",
    "Ellipsoid",
    "attitude_from_path",
    "bank_about_velocity",
    "compose",
    "ecef_from_eci",
    "ecef_from_geodetic",
    "ecef_from_ned_point",
    "eci_from_ecef",
    "euler_from_quaternion",
    "euler_from_rotation",
    "flat_from_geodetic",
    "flat_stretch",
    "flow_angles",
    "geodetic_from_ecef",
    "geodetic_from_flat",
    "ned_from_ecef_point",
    "normalize",
    "path_angles",
    "places_from_flat",
    "quaternion_derivative",
    "quaternion_from_euler",
    "quaternion_from_rotation",
    "quaternion_multiply",
    "radii_of_curvature",
    "rotate",
    "rotate_back",
    "rotation_ecef_from_eci",
    "rotation_from_euler",
    "rotation_from_quaternion",
    "rotation_ned_from_ecef",
    "rotation_wind_from_body",
    "safe_atan2",
    "safe_hypot",
    "safe_norm",
    "velocity_ecef_from_eci",
    "velocity_eci_from_ecef",
]
