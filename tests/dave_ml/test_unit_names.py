"""Units by S-119 names, compared with factors of the international units."""

import pytest
from files import NASA, model

from anser.dave_ml.standard_units import parse_unit

KNOWN = {
    "ft": (0.3048, "m"),
    "ft2": (0.3048**2, "m^2"),
    "ft_s": (0.3048, "m s^-1"),
    "ft_s2": (0.3048, "m s^-2"),
    "deg": (0.017453292519943295, "rad"),
    "_deg": (57.29577951308232, "rad^-1"),
    "rad_s": (1.0, "s^-1 rad"),
    "lbf": (4.4482216152605, "m kg s^-2"),
    "ftlbf": (1.3558179483314004, "m^2 kg s^-2"),
    "slug": (14.593902937206364, "kg"),
    "slugft2": (1.3558179483314004, "m^2 kg"),
    "slug_ft3": (515.3788183931961, "m^-3 kg"),
    "lbf_ft2": (47.88025898033584, "m^-1 kg s^-2"),
    "psf": (47.88025898033584, "m^-1 kg s^-2"),
    "psi": (6894.757293168361, "m^-1 kg s^-2"),
    "nmi_h": (1852.0 / 3600.0, "m s^-1"),
    "h_nmi": (3600.0 / 1852.0, "m^-1 s"),
    "kt": (1852.0 / 3600.0, "m s^-1"),
    "hp": (745.6998715822702, "m^2 kg s^-3"),
    "kgm2": (1.0, "m^2 kg"),
    "Nm": (1.0, "m^2 kg s^-2"),
    "min": (60.0, "s"),
    "rev_min": (0.10471975511965977, "s^-1 rad"),
    "pct": (0.01, ""),
    "frac": (1.0, ""),
    "nd": (1.0, ""),
    "": (1.0, ""),
    "deg_ft": (0.017453292519943295 / 0.3048, "m^-1 rad"),
    "ft/s": (0.3048, "m s^-1"),
}
"""Factors of the international foot, pound and nautical mile and of standard gravity; NIST SP 811, appendix B.8."""


@pytest.mark.parametrize("name", KNOWN)
def test_known_units(name):
    factor, si = KNOWN[name]
    assert parse_unit(name).factor == pytest.approx(factor, rel=1e-14)
    assert parse_unit(name).offset == 0.0
    assert set(parse_unit(name).si.split()) == set(si.split())


@pytest.mark.parametrize(
    ("name", "value", "kelvin"), [("degC", 15.0, 288.15), ("degF", 59.0, 288.15), ("degR", 518.67, 288.15)]
)
def test_temperatures(name, value, kelvin):
    unit = parse_unit(name)
    assert unit.factor * value + unit.offset == pytest.approx(kelvin, rel=1e-14)


@pytest.mark.parametrize(
    "name", ["lb", "furlong", "ft_s_s", "s_r", "ft_d", "nim_h", "FT", "m-2", "x" * 5000, "m" * 39 + "!"]
)
def test_other_names_are_refused(name):
    with pytest.raises(ValueError, match="known are m, km"):
        parse_unit(name)


def test_nasas_units_that_do_not_convert():
    def converts(name, key):
        try:
            model(name).evaluator.unit(key)
        except ValueError:
            return False
        return True

    strange = {
        model(name).definition.variables[key].units
        for name in NASA
        for key in model(name).definition.variables
        if not converts(name, key)
    }
    # "r" for radian, "d" for degree and "lb" for pound-force are none of S-119, "nim" is a slip: internal, all of them
    assert strange == {"lb", "s_r", "ft_d", "nim_h"}
