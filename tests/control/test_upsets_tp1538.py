"""Recovery of the F-16 of TP-1538 from beyond the stall, and one unrecoverable deep stall with the reason."""

import numpy as np
import pytest

from anser.analysis import deep_stall
from support.tp1538_build_up import coefficients
from support.upsets_tp1538 import UPSETS, flown, held, recovery_s

DEEP = "deep stall: alpha 63, c.g. 0.40"
RECOVER = [name for name in UPSETS if name != DEEP]
FEW = ("alpha 55, sinking", "inverted, alpha 50, rotating")


@pytest.mark.long
def test_selected_upsets_are_recovered():
    """Measured: at most 15.1 s and 1,061 m, with surfaces limited at their individual stops."""
    for name, history in flown({name: UPSETS[name] for name in FEW}, steps=2500).items():
        assert recovery_s(history) < 20.0, name
        assert history["altitude"].min() > UPSETS[name][8] - 1100.0


@pytest.fixture(scope="module")
def histories():
    return flown()


@pytest.mark.long
def test_eleven_of_twelve_upsets_are_recovered(histories):
    assert len(UPSETS) == 12
    assert [name for name in UPSETS if np.isfinite(recovery_s(histories[name]))] == RECOVER


@pytest.mark.long
@pytest.mark.parametrize("name", RECOVER)
def test_an_upset_ends_in_level_flight_above_the_ground(histories, name):
    """Measured: at most 29.4 s and 2.2 km for the flat spin; 22.4 s and 1.6 km for the other upsets."""
    history = histories[name]
    assert recovery_s(history) < 34.0
    assert history["altitude"].min() > UPSETS[name][8] - 2550.0
    assert history["V"][-1] == pytest.approx(160.0, abs=3.0)
    assert np.isfinite(history["surfaces_deg"]).all()


@pytest.mark.long
def test_the_deep_stall_is_not_left_by_the_autopilot(histories):
    history = histories[DEEP]
    assert np.isinf(recovery_s(history))
    assert history["alpha_deg"].min() > 30.0


@pytest.mark.long
def test_no_elevator_pitches_down_out_of_the_deep_stall():
    """With the c.g. at 0.40 the full elevator gives nose-up moments from 30 to 62.8 deg, and alpha stays there."""
    up = deep_stall(x_cg_over_c=(0.40,))["pitching_moment"].sel(alpha=slice(30.5, 62.5))
    assert (up.values > 0.0).all()
    any_elevator = [
        min(coefficients(alpha, 0.0, e, 0.0, 0.0, 25.0, 0.0, 0.0, 0.0, 300.0, 0.40)[4] for e in range(-25, 26, 5))
        for alpha in range(35, 60, 3)
    ]
    assert min(any_elevator) > 0.0
    alpha_deg = held(UPSETS[DEEP])
    assert alpha_deg.min() > 35.0
    assert held((*UPSETS[DEEP][:-1], 0.30)).min() < 15.0


@pytest.mark.long
def test_the_same_start_recovers_with_the_cg_forward():
    V, alpha, beta, mu, gamma, P, Q, R, altitude, _ = UPSETS[DEEP]
    history = flown({"forward": (V, alpha, beta, mu, gamma, P, Q, R, altitude, 0.30)})["forward"]
    assert recovery_s(history) < 20.0
