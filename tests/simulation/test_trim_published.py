"""Trim against the figures printed in [SL] section 3.6, with the constants of its program (see `support.textbook`)."""

import numpy as np
import pytest

from anser.units import RAD_DEG
from anser.verification import f16_trim
from anser.verification.f16_trim import F16_TRIM, Steady, trim_published
from support.checks import assert_passes
from support.reference import reference

TURN = reference("textbook_checks")["turn_example_3_6_2"]


def test_trim_equals_tables_3_6_2_and_3_6_3():
    comparisons = assert_passes(F16_TRIM, 57)
    level = [c for c in comparisons if c.where.startswith("table 3.6-2")]
    assert len(level) == 24
    # Half a unit of three digits everywhere: 0.05 deg above 10 deg, 0.005 deg below, 0.0005 deg below 1 deg.
    assert sorted({round(c.tolerance, 9) for c in level}) == [0.0005, 0.005, 0.05]


def _eleven_and(flight: Steady) -> list[Steady]:
    """As many flights as the check trims, so that nothing is compiled again."""
    return [flight] * 11


def test_turn_example_is_what_trim_finds():
    points, euler = trim_published(_eleven_and(Steady(TURN["xcg"], 502.0, 0.3)))
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


def test_a_flight_without_trim_is_named():
    with pytest.raises(RuntimeError, match=r"no trim found for Steady\(x_cg=0.35, V_ft_s=nan"):
        trim_published(_eleven_and(Steady(0.35, float("nan"), 0.0)))


def test_a_wrong_figure_is_told():
    rows = [{"V_ft_s": 300, "throttle": 0.122, "alpha_deg": 8.48, "elevator_deg": -0.591}]
    found = [{"throttle": 0.12197, "alpha_deg": 8.49255, "elevator_deg": -0.59104}]
    assert [c.passes for c in f16_trim._level(rows, found)] == [True, False, True]
