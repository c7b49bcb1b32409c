"""The linear models' checks pass; a changed model fails."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser.steady import trim_target
from anser.units import FOOT_M
from anser.verification.checks import load_published
from anser.verification.linear_models import LINEAR_CHECKS, linear_flight, printed_block, printed_tolerances
from anser.verification.textbook import textbook_aircraft, textbook_environment
from support.checks import assert_passes

PULL_UP, MODES, _ = LINEAR_CHECKS  # the third is tested in test_linearize_sampled.py, with the same compiled programs
PRINTED = load_published("textbook_checks")["pull_up_linearization"]


@pytest.mark.long
def test_the_pull_up_equals_the_printed_matrices():
    # The flight is not near a breakpoint of the tables: alpha 17.2 deg, elevator -7.1 deg; sideslip is 0.0023 deg, but
    # there the tables are odd and have no kink.
    assert_passes(PULL_UP, 5 * 5 + 4 * 4 + 9 * 4)


@pytest.mark.long
def test_the_five_modes_of_level_flight_agree():
    assert_passes(MODES, 3 * 5)


def test_the_tolerance_is_half_the_last_digit():
    printed = np.array([[-235.0, 0.0, -0.0007, 1087.0], [0.0, 0.0, 0.0, 0.0]])
    np.testing.assert_allclose(printed_tolerances(printed), [[0.5, 0.5e-4, 0.5e-4, 0.5], [5e-13] * 4], rtol=1e-12)


@pytest.mark.long
def test_a_changed_centre_of_mass_is_detected():
    aircraft = eqx.tree_at(lambda a: a.f16.x_cg, textbook_aircraft(0.30), jnp.asarray(0.31, dtype=float))
    _, model = linear_flight(aircraft, textbook_environment(), trim_target(502 * FOOT_M, 0.0, pitch_rate=0.3))
    states, printed = PRINTED["state_order"][:5], np.array(PRINTED["A_lon"])
    exceeds = np.abs(printed_block(model, "A", states, states) - printed) > printed_tolerances(printed)
    assert exceeds[3, 1]  # the pitch stiffness
