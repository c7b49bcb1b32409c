"""Reference frames, rotations, flow and path angles, and positions on the Earth.

=============  ========================================================================================================
``rotations``  rotation matrices, quaternions and Euler angles
``wind_axes``  flow angles, path angles, and the bank about the velocity vector
``frames``     transformations between inertial (ECI), Earth-fixed (ECEF) and local (NED) frames
``wgs84``      geodetic coordinates on an ellipsoid, and the flat map of the Earth
``vectors``    lengths and directions with finite gradients at zero
=============  ========================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
