"""Units of standard variables: wrong units are refused."""

import pytest
from files import FEATURES, NASA

from anser.dave_ml import DaveMlError, read_dave_ml
from anser.dave_ml.model import adapt_model
from anser.dave_ml.standard_units import STANDARD_MEASURES, parse_unit

RIGHT = {
    "totalMass": ("kg", "slug", "lbm", "lbfs2_ft"),
    "angleOfAttack": ("rad", "deg", "rev"),
    "bodyAngularRate_Roll": ("rad_s", "deg_s", "rev_min"),
    "trueAirspeed": ("m_s", "ft_s", "kt", "nmi_h", "km_h"),
    "altitudeMSL": ("m", "ft", "km"),
    "referenceWingArea": ("m2", "ft2", "in2"),
    "referenceWingSpan": ("m", "ft", "in"),
    "bodyMomentOfInertia_Yaw": ("kgm2", "slugft2", "lbmft2"),
    "bodyProductOfInertia_ZX": ("kgm2", "slugft2"),
    "thrustBodyForce_X": ("N", "lbf", "kN"),
    "thrustBodyMoment_Pitch": ("Nm", "ftlbf"),
    "airDensity": ("kg_m3", "slug_ft3"),
    "dynamicPressure": ("Pa", "lbf_ft2", "psf"),
    "mach": ("nd", "", "non-dimensional", "ND"),
    "aeroBodyForceCoefficient_X": ("nd", "", "non-dimensional"),
    "powerLeverAngle": ("pct", "frac"),
}
WRONG = {
    "totalMass": ("", "nd", "lbf", "ft", "lb", "slugft2"),
    "angleOfAttack": ("", "nd", "kt", "rad_s", "_deg", "degrees"),
    "bodyAngularRate_Roll": ("", "deg", "_s", "Hz", "deg_s2"),
    "trueAirspeed": ("", "ft", "ft_s2", "mach"),
    "altitudeMSL": ("", "ft2", "hPa"),
    "referenceWingArea": ("", "ft", "m3"),
    "referenceWingSpan": ("", "ft2", "nd"),
    "bodyMomentOfInertia_Yaw": ("", "slug", "slugft", "lbfft2"),
    "bodyProductOfInertia_ZX": ("", "ft2"),
    "thrustBodyForce_X": ("", "lbm", "lb", "ftlbf"),
    "thrustBodyMoment_Pitch": ("", "lbf", "lbf_ft"),
    "airDensity": ("", "slug", "lbf_ft3"),
    "dynamicPressure": ("", "lbf", "slug_ft3"),
    "mach": ("ft_s", "pct", "deg"),
    "aeroBodyForceCoefficient_X": ("_deg", "pct", "lbf", "rad"),
    "powerLeverAngle": ("", "nd", "deg"),
}


def one_variable(name, units):
    text = f'<DAVEfunc>\n<variableDef name="{name}" varID="v" units="{units}" initialValue="1"/></DAVEfunc>'
    return read_dave_ml(text, "one.dml")


@pytest.mark.parametrize("name", RIGHT)
def test_units_of_the_dimension_are_read_and_convert(name):
    for units in RIGHT[name]:
        value = one_variable(name, units).evaluate_si({}, ("v",))["v"]
        assert float(value) == pytest.approx(parse_unit(units).factor, rel=1e-15)


@pytest.mark.parametrize("name", WRONG)
def test_other_units_are_refused_with_line_variable_and_expected_unit(name):
    for units in WRONG[name]:
        with pytest.raises(DaveMlError, match=r"one\.dml, line 2") as caught:
            one_variable(name, units)
        assert f'units="{units}" of "{name}" (varID "v")' in caught.value.arrived
        assert f'"{RIGHT[name][0]}"' in caught.value.expected


def test_every_measure_accepts_its_own_units():
    for name, measure in STANDARD_MEASURES.items():
        for units in measure.units:
            assert measure.accepts(units), name


def test_a_renamed_variable_needs_the_units_of_its_new_name():
    text = '<DAVEfunc>\n<variableDef name="m" varID="v" units="lbf" initialValue="1"/></DAVEfunc>'
    with pytest.raises(DaveMlError, match=r'line 2, .*units="lbf" of "totalMass" \(varID "v"\); expected a mass'):
        adapt_model(read_dave_ml(text, "one.dml"), {"totalMass": "m"}, {})


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b'bpID="ALPHA1" units="deg"', b'bpID="ALPHA1" units="rad"', "breakpoints .* expected those of its variable"),
        (b'varID="alpha" units="deg"', b'varID="alpha" units="rad"', 'expected those of its variable "alpha", "rad"'),
    ],
)
def test_breakpoints_in_other_units_than_their_variable_are_refused(old, new, says):
    text = NASA["F16_aero"]
    assert old in text
    with pytest.raises(DaveMlError, match=says):
        read_dave_ml(text.replace(old, new, 1), "F16_aero.dml")


def test_a_table_in_other_units_than_its_variable_is_refused():
    text = FEATURES.replace(b'gtID="PLANE">', b'gtID="PLANE" units="ft">')
    with pytest.raises(DaveMlError, match=r'units="ft" of table "PLANE"; expected those of its variable'):
        read_dave_ml(text, "features.dml")
