"""Physical constants with sources, least distances from goals, and bounds of the integration step; SI units."""

# [WGS84] NIMA TR8350.2: the two defining parameters of the ellipsoid; `anser.spatial.Ellipsoid` derives the others.
WGS84_A_M = 6378137.0
WGS84_F = 1.0 / 298.257223563

# [WGS84]; J2 is the value of the NESC check-cases ([NESC], theory section 2).
EARTH_ROTATION_RAD_S = 7.292115e-5
EARTH_GM_M3_S2 = 3.986004418e14
EARTH_J2 = 1.08262982e-3

# Somigliana normal gravity, theory section 1: coefficients of the first release of WGS 84. With the coefficients of
# later releases (9.7803253359, 0.00193185265241), gravity differs by less than 2e-6 m/s^2.
SOMIGLIANA_EQUATOR_M_S2 = 9.7803267714
SOMIGLIANA_K = 0.00193185138639

# CGPM 1901; the constant of the atmosphere's hydrostatic equation ([USSA76] table 2).
STANDARD_GRAVITY_M_S2 = 9.80665

# [USSA76] table 2 and part 1.2.5. The standard fixes the gas constant at 8.31432, unlike newer measurements: its
# printed base pressures and the air of the NESC check-cases result only from this value.
GAS_CONSTANT_J_MOL_K = 8.31432
AIR_MOLAR_MASS_KG_MOL = 0.0289644
AIR_HEAT_RATIO = 1.4
SEA_LEVEL_PRESSURE_PA = 101325.0
SEA_LEVEL_TEMPERATURE_K = 288.15
GEOPOTENTIAL_RADIUS_M = 6356766.0
"""Earth radius for the conversion from geometric to geopotential altitude, m, [USSA76] part 1.2.4."""

SURFACE_STAND_OFF_MIN_M = 150.0
AIRBORNE_STAND_OFF_MIN_M = 100.0
"""Least permitted distances of an aircraft from a goal on the surface and from an airborne goal, m.

No scenario can change these distances: the scope of the product fixes them.
"""

STEP_MIN_S, STEP_MAX_S = 0.001, 0.05
"""Least and greatest integration step, s: Runge-Kutta of order 4 is unstable beyond 2.8 time constants of a surface."""
