"""Findings for errors in aircraft files, and none for correct files."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft_files.findings import collect_findings
from anser.aircraft_files.sources import library_file, validate_airframe
from support.aerosonde_file import AEROSONDE, changed


def test_the_library_is_without_findings():
    assert collect_findings(library_file("aerosonde")) == ()


@pytest.mark.parametrize(
    ("pair", "location", "message"),
    [
        (("Cm_q = -38.21", "Cm_q = 38.21"), "aerodynamics.Cm_q", "damping is negative"),
        (("Cl_p = -0.51", "Cl_p = 0.51"), "aerodynamics.Cl_p", "damping is negative"),
        (("Cm_alpha = -2.74", "Cm_alpha = 2.74"), "aerodynamics.Cm_alpha", "unstable in pitch"),
        (("Cn_beta = 0.073", "Cn_beta = -0.073"), "aerodynamics.Cn_beta", "turns away from the flow"),
        (("Cl_r = 0.25\n", "Cl_r = 0.25\nCm_beta = 0.1\n"), "aerodynamics.Cm_beta", "mirror image"),
        (("CL_alpha = 5.61", "CL_alpha = 0.098"), "aerodynamics.CL_alpha", "is it given per deg, not per rad?"),
        (("limit_deg = 30.0", "limit_deg = 0.52"), "surface[0].limit_deg", "is it in rad?"),
        (("limit_deg = 30.0", "lower_deg = -0.5\nupper_deg = 0.52"), "surface[0].upper_deg", "is it in rad?"),
        (("rate_limit_deg_s = 200.0", "rate_limit_deg_s = 3.5"), "surface[0].rate_limit_deg_s", "is it in rad/s?"),
        (("beta_deg = [-25.0, 25.0]", "beta_deg = [-0.4, 0.4]"), "validity.beta_deg", "are these rad?"),
        (("mass_kg = 11.0", "mass_kg = 1100.0"), "validity.airspeed_m_s", "at none of these airspeeds"),
        (("airspeed_m_s = [13.0, 40.0]", "airspeed_m_s = [8.0, 40.0]"), "validity.airspeed_m_s[0]", "only from about"),
        (("voltage_V = 44.4", "voltage_V = 11.1"), "engine", "at no valid airspeed"),
        (("mean_chord_m = 0.18994", "mean_chord_m = 0.6"), "geometry.mean_chord_m", "area over span"),
    ],
)  # fmt: skip
def test_the_linter_finds_each_error(pair, location, message):
    findings = collect_findings(validate_airframe(changed(pair), "test"))
    assert [message for f in findings if f.location == location and message in f.text] == [message]


def table_of(values, points=tuple(range(-30, 31, 5)), over="beta", name="Cl"):
    return f'\n[[table]]\nreplaces = "{name}"\nover = ["{over}"]\nbreakpoints_deg = [{list(points)}]\nvalues = {list(values)}\n'


def with_rolling(values, **options):
    pairs = [("Cl_beta = -0.13\n", "")]
    return validate_airframe(changed(*pairs, text=AEROSONDE + table_of(values, **options)), "test")


def test_negative_drag_of_a_table_is_located_in_the_table():
    table = table_of([-0.1, -0.1], points=(-30, 30), over="alpha", name="CD")
    text = AEROSONDE.replace("instead = { CD0 = 0.0 }\n", "") + table
    file = validate_airframe(changed(("CD0 = 0.043\n", ""), text=text), "test")
    findings = [finding for finding in collect_findings(file) if "a drag coefficient of" in finding.text]
    assert [finding.location for finding in findings] == ["table[0] (CD)"]


@given(index=st.integers(1, 11), size=st.floats(0.02, 0.2), sign=st.sampled_from([-1, 1]))
@settings(max_examples=10, deadline=None)
@pytest.mark.long
def test_the_linter_finds_a_point_out_of_line(index, size, sign):
    points = np.arange(-30, 31, 5)
    smooth = -0.13 * np.radians(points) + 0.02 * np.radians(points) ** 3
    assert not [f for f in collect_findings(with_rolling(smooth.tolist())) if f.location.startswith("table")]
    wrong = smooth.copy()
    wrong[index] += sign * size
    locations = {
        f.location for f in collect_findings(with_rolling(wrong.tolist())) if f.location.startswith("table[0].values")
    }
    assert f"table[0].values[{index}] (Cl)" in locations
    assert locations <= {f"table[0].values[{k}] (Cl)" for k in (index, 12 - index)}


def test_the_linter_finds_gaps_and_ends_inside_the_limits():
    points = (-20, -15, -10, -5, 0, 5, 10, 40)
    values = (-0.002 * np.array(points)).tolist()
    texts = [f.text for f in collect_findings(with_rolling(values, points=points)) if f.location.startswith("table")]
    assert any("a gap in beta from 10 to 40 deg" in text for text in texts)
    assert any("beta begins at -20 deg, but the data are said to hold from -25 deg" in text for text in texts)
    assert not any("beta ends" in text for text in texts)
