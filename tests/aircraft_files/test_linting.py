"""What looks wrong in an aircraft file is found, and nothing in one that is right."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft_files.findings import collect_findings
from anser.aircraft_files.sources import library_file, validate_airframe
from support.aerosonde_file import AEROSONDE, changed


def test_nothing_is_found_in_the_library():
    assert collect_findings(library_file("aerosonde")) == ()


@pytest.mark.parametrize(
    ("pair", "location", "words"),
    [
        (("Cm_q = -38.21", "Cm_q = 38.21"), "aerodynamics.Cm_q", "damping is negative"),
        (("Cl_p = -0.51", "Cl_p = 0.51"), "aerodynamics.Cl_p", "damping is negative"),
        (("Cm_alpha = -2.74", "Cm_alpha = 2.74"), "aerodynamics.Cm_alpha", "unstable in pitch"),
        (("Cn_beta = 0.073", "Cn_beta = -0.073"), "aerodynamics.Cn_beta", "turns away from the flow"),
        (("Cl_r = 0.25\n", "Cl_r = 0.25\nCm_beta = 0.1\n"), "aerodynamics.Cm_beta", "mirror image"),
        (("CL_alpha = 5.61", "CL_alpha = 0.098"), "aerodynamics.CL_alpha", "is it given per deg, not per rad?"),
        (("limit_deg = 30.0", "limit_deg = 0.52"), "surface[0].limit_deg", "is it in rad?"),
        (("rate_limit_deg_s = 200.0", "rate_limit_deg_s = 3.5"), "surface[0].rate_limit_deg_s", "is it in rad/s?"),
        (("beta_deg = [-25.0, 25.0]", "beta_deg = [-0.4, 0.4]"), "validity.beta_deg", "are these rad?"),
        (("mass_kg = 11.0", "mass_kg = 1100.0"), "validity.airspeed_m_s", "at none of these airspeeds"),
        (("airspeed_m_s = [13.0, 40.0]", "airspeed_m_s = [8.0, 40.0]"), "validity.airspeed_m_s[0]", "only from about"),
        (("voltage_V = 44.4", "voltage_V = 11.1"), "engine", "at no valid airspeed"),
        (("mean_chord_m = 0.18994", "mean_chord_m = 0.6"), "geometry.mean_chord_m", "area over span"),
    ],
)  # fmt: skip
def test_the_linter_finds_what_was_put_there(pair, location, words):
    found = collect_findings(validate_airframe(changed(pair), "test"))
    assert [words for one in found if one.location == location and words in one.text] == [words]


def table_of(values, points=tuple(range(-30, 31, 5)), over="beta", name="Cl"):
    return f'\n[[table]]\nreplaces = "{name}"\nover = ["{over}"]\nbreakpoints_deg = [{list(points)}]\nvalues = {list(values)}\n'


def with_rolling(values, **more):
    pairs = [("Cl_beta = -0.13\n", "")]
    return validate_airframe(changed(*pairs, text=AEROSONDE + table_of(values, **more)), "test")


@given(where=st.integers(1, 11), size=st.floats(0.02, 0.2), sign=st.sampled_from([-1, 1]))
@settings(max_examples=10, deadline=None)
@pytest.mark.long
def test_the_linter_finds_a_point_out_of_line(where, size, sign):
    points = np.arange(-30, 31, 5)
    smooth = -0.13 * np.radians(points) + 0.02 * np.radians(points) ** 3
    assert not [one for one in collect_findings(with_rolling(smooth.tolist())) if one.location.startswith("table")]
    wrong = smooth.copy()
    wrong[where] += sign * size
    found = {
        one.location
        for one in collect_findings(with_rolling(wrong.tolist()))
        if one.location.startswith("table[0].values")
    }
    assert f"table[0].values[{where}] (Cl)" in found
    assert found <= {f"table[0].values[{k}] (Cl)" for k in (where, 12 - where)}


def test_the_linter_finds_gaps_and_ends_inside_the_limits():
    points = (-20, -15, -10, -5, 0, 5, 10, 40)
    values = (-0.002 * np.array(points)).tolist()
    texts = [
        one.text for one in collect_findings(with_rolling(values, points=points)) if one.location.startswith("table")
    ]
    assert any("a gap in beta from 10 to 40 deg" in text for text in texts)
    assert any("beta begins at -20 deg, but the data are said to hold from -25 deg" in text for text in texts)
    assert not any("beta ends" in text for text in texts)
