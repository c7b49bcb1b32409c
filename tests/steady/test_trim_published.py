"""Trim compared with the figures printed in [SL] section 3.6, with the constants of its program."""

import numpy as np
import pytest

from anser.units import RAD_DEG
from anser.verification import textbook
from anser.verification.textbook import F16_TRIM, TextbookFlight, trim_published
from support.checks import assert_passes
from support.reference import reference

TURN = reference("textbook_checks")["turn_example_3_6_2"]


def test_trim_equals_tables_3_6_2_and_3_6_3():
    comparisons = assert_passes(F16_TRIM, 68)
    level = [c for c in comparisons if c.point.startswith("table 3.6-2")]
    assert len(level) == 24
    # Half a unit of three digits everywhere: 0.05 deg above 10 deg, 0.005 deg below, 0.0005 deg below 1 deg.
    assert sorted({round(c.tolerance, 9) for c in level}) == [0.0005, 0.005, 0.05]


def _as_many(*flights: TextbookFlight) -> list[TextbookFlight]:
    """The flights padded with the first to the number in the check, so that nothing is compiled again."""
    return [*flights, *[flights[0]] * (12 - len(flights))]


def test_the_turn_example_equals_the_trim():
    points, euler = trim_published(_as_many(TextbookFlight(TURN["xcg"], 502.0, 0.3)))
    _, alpha, beta, phi, theta, _, P, Q, R, _, _, _, power = TURN["state"]
    # Their minimizer leaves beta_dot at 2.6e-8 rad/s, a side force of 4e-7 g; sideslip gives 5 g per rad: 8e-8 rad. The
    # other angles follow.
    np.testing.assert_allclose([points.alpha[0], points.beta[0]], [alpha, beta], atol=1e-7)
    np.testing.assert_allclose(euler[0, :2], [phi, theta], atol=3e-7)
    np.testing.assert_allclose(points.state.rates_b[0], [P, Q, R], atol=3e-8)
    np.testing.assert_allclose(points.power[0], power, atol=3e-5)
    assert float(points.controls.throttle[0]) == pytest.approx(TURN["controls"]["throttle"], abs=1.5e-7)
    # That sideslip is balanced by 2e-5 deg of aileron and rudder.
    expected = [TURN["controls"][f"{name}_deg"] for name in ("elevator", "aileron", "rudder")]
    np.testing.assert_allclose(points.state.surfaces[0] * RAD_DEG, expected, atol=2e-5)


def test_pull_up_is_the_one_of_table_3_6_3():
    """502 ft/s, sea level, 0.3 rad/s: P = R = 0 and no bank; aileron and rudder identify this pull-up."""
    points, euler = trim_published(
        _as_many(TextbookFlight(0.30, 502.0, 0.0, 0.3), TextbookFlight(0.35, 502.0, 0.0, 0.3))
    )
    np.testing.assert_array_equal(points.state.rates_b[0], [0.0, 0.3, 0.0])
    np.testing.assert_allclose(euler[0, 0], 0.0, atol=1e-12)
    assert float(points.beta[0]) == pytest.approx(4.1e-5, abs=0.05e-5)
    elevator, aileron, rudder = np.asarray(points.state.surfaces[0]) * RAD_DEG
    assert elevator == pytest.approx(-7.082, abs=0.0005)
    # Half the last digit, and what the sideslip rate that single precision resolves takes (see `f16_trim`). The
    # velocity turned about the level line to its right, P and R not 0, gives -5.6e-4 and 0.01661.
    assert aileron == pytest.approx(-6.2e-4, abs=2e-5)
    assert rudder == pytest.approx(0.01655, abs=3e-5)
    # The tolerances are those of one and the same error: a sideslip 1.4e-7 rad beyond puts both on the printed digits.
    # Roll and yaw acceleration per rad and per deg of the printed A and B of this flight.
    A = reference("textbook_checks")["pull_up_linearization"]
    L_beta, N_beta = A["A_lat"][2][0], A["A_lat"][3][0]
    per_rad = -np.linalg.solve(np.array(A["B"])[7:9, 2:4], [L_beta, N_beta])
    moved = np.array([aileron, rudder]) + 1.4e-7 * per_rad
    np.testing.assert_allclose(moved, [-6.2e-4, 0.01655], atol=0.5e-5)
    assert 1.4e-7 * abs(A["A_lat"][0][0]) < 5.8e-8
    # The centre of gravity acts: 5 % of the chord further aft takes 5.9 deg less of elevator.
    aft = np.asarray(points.state.surfaces[1]) * RAD_DEG
    assert aft[0] - elevator == pytest.approx(5.89, abs=0.01)


def test_a_flight_without_trim_is_named():
    with pytest.raises(RuntimeError, match=r"no trim found for TextbookFlight\(x_cg=0.35, V_ft_s=nan"):
        trim_published(_as_many(TextbookFlight(0.35, float("nan"), 0.0)))


def test_a_wrong_printed_figure_fails_the_check():
    printed = [{"V_ft_s": 300, "throttle": 0.122, "alpha_deg": 8.48, "elevator_deg": -0.591}]
    computed = [{"throttle": 0.12197, "alpha_deg": 8.49255, "elevator_deg": -0.59104}]
    assert [c.passes for c in textbook._compare_level(printed, computed)] == [True, False, True]
