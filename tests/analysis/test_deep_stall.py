"""Deep stall of TP-1538's F-16: onset, motion with the centre of gravity, and absence further forward."""

import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from anser.analysis import deep_stall
from anser.analysis.deep_stalls import _roots, deep_stall_document, deep_stall_onset
from anser.cli.commands import app
from anser.report.aircraft_figures import draw_deep_stall
from support.tp1538_build_up import coefficients

CENTRES_OF_GRAVITY = (0.30, 0.35, 0.365, 0.38, 0.40)


@pytest.fixture(scope="module")
def stall():
    return deep_stall(x_cg_over_c=CENTRES_OF_GRAVITY)


def trims_at(stall, x_cg):
    is_at_centre = stall["trim_x_cg"].values == x_cg
    return dict(zip(stall["trim_alpha"].values[is_at_centre], stall["trim_stable"].values[is_at_centre], strict=True))


def test_the_reference_point_has_no_deep_stall(stall):
    """With the centre of gravity at 0.35, Cm stays below -0.028; the maximum is at 55 deg."""
    curve = stall["pitching_moment"].sel(x_cg=0.35)
    assert trims_at(stall, 0.35) == trims_at(stall, 0.30) == {}
    assert float(curve.max()) == pytest.approx(-0.0283, abs=2e-4)
    assert float(curve["alpha"][int(curve.values.argmax())]) == 55.0


def test_the_deep_stall_appears_near_0_365_at_55_deg_and_moves_to_62_deg(stall):
    x_cg, alpha = deep_stall_onset(stall)
    assert x_cg == pytest.approx(0.3627, abs=5e-4)
    assert alpha == pytest.approx(55.0, abs=0.2)
    stable = [max(a for a, s in trims_at(stall, x).items() if s) for x in (0.365, 0.38, 0.40)]
    np.testing.assert_allclose(stable, [55.4, 58.0, 62.8], atol=0.1)


def test_a_curve_that_ends_before_it_turns_back_has_no_onset(stall):
    whole = stall["branch_x_cg"].values
    fold = int(np.nanargmin(whole))
    assert deep_stall_onset(stall.isel(point=slice(None, fold + 1))) is None
    assert deep_stall_onset(stall.isel(point=slice(fold, None))) is None


def test_a_moment_of_exactly_zero_at_a_grid_angle_is_a_trim():
    alphas = np.array([50.0, 51.0, 52.0])
    assert _roots(alphas, np.array([0.1, 0.0, -0.1])) == [(51.0, True)]
    assert _roots(alphas, np.array([-0.1, 0.0, 0.1])) == [(51.0, False)]
    assert _roots(alphas, np.array([-0.1, 0.1, 0.3])) == [(50.5, False)]
    assert _roots(alphas, np.array([0.1, 0.2, 0.0])) == [(52.0, True)]
    assert _roots(alphas, np.array([0.0, 0.1, 0.2])) == [(50.0, False)]
    assert _roots(alphas, np.array([0.1, 0.0, 0.1])) == [(51.0, False)]
    assert _roots(alphas, np.array([np.nan, 0.1, -0.1])) == [(51.5, True)]


def test_every_point_of_the_followed_curve_is_a_trim_of_the_written_out_build_up(stall):
    alphas, centres = stall["branch_alpha"].values, stall["branch_x_cg"].values
    assert np.isfinite(alphas).all()
    assert alphas.max() > 62.5
    assert alphas.min() < 30.5
    assert (np.diff(alphas) < 0).all()
    for alpha, x_cg in zip(alphas[::7], centres[::7], strict=True):
        Cm = coefficients(alpha, 0.0, 25.0, 0.0, 0.0, 25.0, 0.0, 0.0, 0.0, 300.0, x_cg)[4]
        assert abs(Cm) < 1e-9


def test_the_curve_folds_at_the_merger_of_stable_and_unstable_trims(stall):
    """The slopes of x_cg(alpha) and of Cm against alpha change sign together: CZ is negative throughout."""
    moving_aft = np.gradient(stall["branch_x_cg"].values, stall["branch_alpha"].values) > 0
    stable = stall["branch_slope"].values < 0
    assert np.mean(moving_aft == stable) > 0.97  # the points at the four kinks may differ


def test_descents_balance_the_weight(stall):
    """Steep descents: drag over lift is nearly the tangent of alpha, and the nose is near the horizon."""
    np.testing.assert_allclose(stall["trim_path_angle"], stall["trim_pitch"] - stall["trim_alpha"], atol=1e-9)
    assert (np.abs(stall["trim_pitch"]) < 5.0).all()
    assert ((stall["trim_speed"] > 55.0) & (stall["trim_speed"] < 75.0)).all()


@pytest.mark.long
def test_a_smaller_elevator_deflection_stalls_further_forward():
    half_deflection = deep_stall(x_cg_over_c=(0.35, 0.40), elevator_deg=10.0)
    assert deep_stall_onset(half_deflection)[0] < 0.355
    with pytest.raises(ValueError, match="elevator_deg: arrived 30"):
        deep_stall(elevator_deg=30.0)


def test_the_command_prints_and_draws_the_deep_stall(stall, tmp_path):
    draw_deep_stall(stall, [tmp_path / "one.svg"])
    assert "unstable" in (tmp_path / "one.svg").read_text(encoding="utf-8")
    document = deep_stall_document(stall)
    assert document["appears"]["x_cg_over_c"] == pytest.approx(0.3627, abs=5e-4)
    refused = CliRunner().invoke(app, ["deep-stall", "--cg", "0.9"], catch_exceptions=True)
    assert "--cg: arrived 0.9" in str(refused.exception)
    assert jnp.isfinite(stall["branch_alpha"].values).all()
