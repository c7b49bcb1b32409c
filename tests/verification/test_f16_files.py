"""The built-in s119 F-16 equals NASA's DAVE-ML files."""

import numpy as np
import pytest

from anser.aircraft_files import load_airframe
from anser.numerics.arrays import as_array
from anser.verification import f16_data

COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


@pytest.fixture(scope="module")
def compared():
    """[S119] F16_aero, F16_prop at 10,000 random states: files with exact pi, built-in model, files with rounded pi."""
    airframe, of_files = load_airframe("f16", "s119", x_cg_over_c=0.35), f16_data.f16_of_files()
    states = as_array(f16_data.random_states())
    exact = f16_data.with_degrees_per_radian(of_files, 180.0 / np.pi)
    from_files, built_in = f16_data.compare_models(airframe, exact, states)
    rounded, _ = f16_data.compare_models(airframe, of_files, states)
    return from_files, built_in, rounded


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_coefficients_agree_at_ten_thousand_states(compared, name):
    from_files, built_in, _ = compared
    assert from_files[name].shape == (10_000,)
    np.testing.assert_allclose(built_in[name], from_files[name], rtol=0.0, atol=1e-12)


def test_thrust_agrees(compared):
    from_files, built_in, _ = compared
    np.testing.assert_allclose(built_in["thrust"], from_files["thrust"], rtol=0.0, atol=1e-12 * 28_885.0)


def test_the_files_pi_is_rounded(compared):
    """3.14159265 changes CZ only, by |CZ0| beta^2 2.3e-9."""
    from_files, built_in, rounded = compared
    assert 1e-10 < np.max(np.abs(rounded["CZ"] - built_in["CZ"])) < 2e-9
    for name in (*COEFFICIENTS[:2], *COEFFICIENTS[3:]):
        np.testing.assert_array_equal(rounded[name], from_files[name])


def test_the_random_states_exceed_the_tables_on_every_side():
    alpha, beta = np.rad2deg(f16_data.random_states()[:, 1:3].T)
    assert alpha.min() < -10.0
    assert alpha.max() > 45.0
    assert np.abs(beta).max() > 30.0


def test_mass_and_inertia_equal_those_of_the_files():
    built_in, of_files = load_airframe("f16", "s119").mass_properties, f16_data.f16_of_files()
    np.testing.assert_allclose(of_files.mass_properties.mass, built_in.mass, rtol=1e-14)
    np.testing.assert_allclose(of_files.mass_properties.inertia_b, built_in.inertia_b, rtol=1e-14)
    assert float(of_files.centre_b[0]) == pytest.approx(0.1 * 11.32 * 0.3048, rel=1e-12)


@pytest.mark.long
def test_the_check_passes():
    comparisons = f16_data.F16_FILES.measure()
    assert not [(c.group, c.point, c.error, c.tolerance) for c in comparisons if not c.passes]
    assert {*COEFFICIENTS, "thrust", "altitudeMsl_ft"} <= {c.group for c in comparisons}
