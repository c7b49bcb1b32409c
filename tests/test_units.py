"""Unit factors compared with their exact decimal definitions and NIST SP 811; constants with [WGS84] TR8350.2."""

import math
from fractions import Fraction

import pytest

from anser import units

# Exact definitions, written out as fractions of whole numbers so that no float arithmetic is shared with the code.
EXACT = {
    "FOOT_M": Fraction(3048, 10_000),
    "NAUTICAL_MILE_M": Fraction(1852),
    "KNOT_M_S": Fraction(1852, 3600),
    "FOOT_PER_MINUTE_M_S": Fraction(508, 100_000),
    "POUND_KG": Fraction(45_359_237, 100_000_000),
    "LBF_N": Fraction(44_482_216_152_605, 10**13),
    "SLUG_KG": Fraction(44_482_216_152_605, 10**13) / Fraction(3048, 10_000),
    "SLUG_FT2_KG_M2": Fraction(44_482_216_152_605, 10**13) * Fraction(3048, 10_000),
    "SLUG_FT3_KG_M3": Fraction(44_482_216_152_605, 10**13) / Fraction(3048, 10_000) ** 4,
    "FT_LBF_N_M": Fraction(44_482_216_152_605, 10**13) * Fraction(3048, 10_000),
    "PSF_PA": Fraction(44_482_216_152_605, 10**13) / Fraction(3048, 10_000) ** 2,
    "RANKINE_K": Fraction(5, 9),
}

# NIST SP 811 (2008) appendix B.8, printed to seven figures: half a unit of the last one is at most 5e-7 of the value.
PRINTED = {
    "SLUG_KG": 14.59390,
    "SLUG_FT3_KG_M3": 515.3788,
    "FT_LBF_N_M": 1.355818,
    "PSF_PA": 47.88026,
    "LBF_N": 4.448222,
    "KNOT_M_S": 0.5144444,
    "DEG_RAD": 0.01745329,
}


@pytest.mark.parametrize("name", EXACT)
def test_factor_is_exact(name):
    # Four roundings of at most half a unit each (1.1e-16) lie between the definition and the float.
    assert getattr(units, name) == pytest.approx(float(EXACT[name]), rel=5e-16, abs=0.0)


@pytest.mark.parametrize("name", PRINTED)
def test_factor_agrees_with_nist(name):
    assert getattr(units, name) == pytest.approx(PRINTED[name], rel=5e-7, abs=0.0)


def test_degrees_and_radians():
    assert math.pi == 180.0 * units.DEG_RAD
    assert pytest.approx(1.0, rel=3e-16) == units.DEG_RAD * units.RAD_DEG  # two roundings


def test_all_factors_are_plain_floats():
    values = {name: value for name, value in vars(units).items() if name.isupper() and name != "STANDARD_GRAVITY_M_S2"}
    assert len(values) >= len(EXACT)
    assert all(type(value) is float for value in values.values())
