"""Factors from a named unit to its SI unit: multiply to convert input to SI, divide to convert output from SI.

The factors follow from the international foot and avoirdupois pound (1959), the international nautical mile (1929) and
standard gravity, in float64 without further rounding.
"""

import math

from anser.constants import STANDARD_GRAVITY_M_S2

DEG_RAD = math.pi / 180.0
RAD_DEG = 180.0 / math.pi
"""Degrees per radian; unlike the other factors, a multiplier that converts output from SI."""

FOOT_M = 0.3048
NAUTICAL_MILE_M = 1852.0
KNOT_M_S = NAUTICAL_MILE_M / 3600.0
FOOT_PER_MINUTE_M_S = FOOT_M / 60.0

POUND_KG = 0.45359237
LBF_N = POUND_KG * STANDARD_GRAVITY_M_S2
SLUG_KG = LBF_N / FOOT_M
"""Mass that one pound-force accelerates at one foot per second squared, kg."""

SLUG_FT2_KG_M2 = SLUG_KG * FOOT_M**2
SLUG_FT3_KG_M3 = SLUG_KG / FOOT_M**3
FT_LBF_N_M = FOOT_M * LBF_N
PSF_PA = LBF_N / FOOT_M**2

RANKINE_K = 5.0 / 9.0
