from .rotations import euler_from_quaternion, quaternion_from_euler, rotation_from_quaternion
from .wgs84 import WGS84, Ellipsoid, ecef_from_geodetic, flat_from_geodetic, geodetic_from_ecef, geodetic_from_flat
from .wind_axes import flow_angles, path_angles

__all__ = [
    "WGS84",
    "Ellipsoid",
    "ecef_from_geodetic",
    "euler_from_quaternion",
    "flat_from_geodetic",
    "flow_angles",
    "geodetic_from_ecef",
    "geodetic_from_flat",
    "path_angles",
    "quaternion_from_euler",
    "rotation_from_quaternion",
]
