"""Linear models of the textbook's F-16: outputs of the pull-up, and modes as the centre of mass moves aft.

Source: [SL] sec. 3.7, 3.8. The printed matrices and eigenvalues are checks of `anser verify`: see
`tests/verification/test_linear_models.py`.
"""

import numpy as np
import pytest

from anser.analysis import modes_of
from anser.steady import trim_target
from anser.units import FOOT_M, RAD_DEG
from anser.verification.linear_models import linear_flight, printed_block, printed_tolerances
from support.textbook import textbook_aircraft, textbook_environment

SPEED = 502 * FOOT_M
LONGITUDINAL = ["VT", "alpha", "theta", "Q", "pow"]
INPUTS = ["throttle", "elevator_deg", "aileron_deg", "rudder_deg"]


def flight(x_cg, pitch_rate=0.0):
    return linear_flight(
        textbook_aircraft(x_cg), textbook_environment(), trim_target(SPEED, 0.0, pitch_rate=pitch_rate)
    )


@pytest.mark.long
def test_the_pull_up_is_the_printed_flight_with_the_printed_outputs():
    """Angle of attack, load factor and its rows of C and D, as quoted by the test suite of archimedes."""
    point, model = flight(0.30, 0.3)
    # The power is beyond what the engine has: the textbook's table prints throttle 1.023, (105.1 + 117.38) / 217.38.
    assert float(point.excess) == pytest.approx(float(point.power) / 100 - 1, abs=1e-12)
    assert (float(point.power) + 117.38) / 217.38 == pytest.approx(1.023, abs=0.0005)
    assert float(point.alpha) * RAD_DEG == pytest.approx(17.2208, abs=0.5e-4)
    assert float(model.y[model.outputs.index("n_z")]) == pytest.approx(5.4267, abs=0.5e-4)
    rates = dict(zip(model.states, np.asarray(model.x_dot), strict=True))
    assert rates["theta"] == pytest.approx(0.3, abs=1e-9)
    for name in ("V", "alpha", "beta", "P", "Q", "R"):
        assert abs(rates[name]) < 1e-9
    printed_C, printed_D = np.array([[0.0208, 15.2, 0.0, 1.45, 0.0]]), np.array([[0.0, 0.0333, 0.0, 0.0]])
    assert np.all(np.abs(printed_block(model, "C", ["n_z"], LONGITUDINAL) - printed_C) < printed_tolerances(printed_C))
    assert np.all(np.abs(printed_block(model, "D", ["n_z"], INPUTS) - printed_D) < printed_tolerances(printed_D))


ALWAYS = {"roll", "spiral", "Dutch roll", "engine", "altitude", "heading"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("x_cg", "longitudinal"),
    [
        (0.30, {"short period": 2, "phugoid": 2}),
        (0.34, dict.fromkeys((f"{a} ({b} real)" for a in ("short period", "phugoid") for b in ("first", "second")), 1)),
        (0.35, {"short period (real)": 1, "third oscillatory mode": 2, "phugoid (real)": 1}),
        (0.38, {"short period (first real)": 1, "short period (second real)": 1, "phugoid": 2}),
    ],
)
def test_modes_are_named_as_the_centre_of_mass_moves_aft(x_cg, longitudinal):
    """The short period splits, one half merges with half a phugoid, and finally the phugoid is whole again."""
    _, model = flight(x_cg)
    modes = modes_of(model)
    assert {mode.name: mode.order for mode in modes if mode.name not in ALWAYS} == longitudinal
    assert {mode.name for mode in modes} >= ALWAYS
    by_name = {mode.name: mode for mode in modes}
    assert by_name["Dutch roll"].order == 2
    assert by_name["heading"].eigenvalue == 0
    # With its centre of mass behind the neutral point, a little before 0.34, the aircraft diverges in one real mode.
    unstable = [mode for mode in modes if mode.eigenvalue.real > 0]
    assert [mode.order for mode in unstable] == ([] if x_cg == 0.30 else [1])
    for mode in modes:
        assert sum(share for _, share in mode.shares) == pytest.approx(1.0)
