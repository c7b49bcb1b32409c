"""The F-16 against published figures: [SL] table 3.5-2, the steady turn of [SL], the static shots of [S119]."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.verification.f16_data import F16_AERO_SHOTS, F16_ENGINE_SHOTS
from anser.verification.textbook import F16_DERIVATIVES, F16_TURN, rates_and_slopes, state_and_controls
from support.checks import assert_passes
from support.reference import reference
from support.textbook import textbook_aircraft, textbook_environment, textbook_rates


def test_derivatives_equal_the_textbook_table():
    comparisons = assert_passes(F16_DERIVATIVES, 13)
    # Half a unit of the seventh digit of 12.62679 is 4e-7 of it: no tolerance is wider.
    np.testing.assert_allclose([c.tolerance / abs(c.expected) for c in comparisons], 4e-7, rtol=1e-12)


def test_the_exact_inertia_changes_the_roll_acceleration():
    # The program behind the table rounds the inertia ratios to four digits. With the inertia itself P_dot is another by
    # 2.0e-4, hundreds of times the tolerance above: the agreement is no accident of loose bounds.
    table = reference("textbook_checks")["derivative_table_3_5_2"]
    inputs = jnp.asarray(state_and_controls(table))
    airframe = textbook_aircraft(table["xcg"], rounded_inertia=False)
    rates = jax.jit(textbook_rates)(airframe, textbook_environment(), inputs[:13], inputs[13:])
    assert rates[6] / table["rates"]["P_dot"] - 1 == pytest.approx(-2.0e-4, abs=5e-6)


def test_the_turn_example_is_steady():
    tolerance = {c.group: c.tolerance for c in assert_passes(F16_TURN, 11)}
    # In plain figures: 1e-4 ft/s^2 is 3e-6 g; the engine's 6e-4 percent/s are 3e-6 of its range per second.
    assert tolerance["VT_dot"] < 1e-4
    assert max(tolerance[f"{name}_dot"] for name in ("alpha", "beta", "phi", "theta", "psi")) < 5e-7
    assert max(tolerance[f"{name}_dot"] for name in ("P", "Q", "R")) < 1.1e-6
    assert tolerance["pow_dot"] < 6e-4


def test_the_turn_example_reveals_a_wrong_state():
    # One percent of the rudder is five thousand times the tolerance of the yaw acceleration.
    example = reference("textbook_checks")["turn_example_3_6_2"]
    inputs = state_and_controls(example)
    inputs[16] *= 1.01
    rates = jax.jit(textbook_rates)(
        textbook_aircraft(0.35), textbook_environment(), jnp.asarray(inputs[:13]), jnp.asarray(inputs[13:])
    )
    yaw = next(c.tolerance for c in assert_passes(F16_TURN, 11) if c.group == "R_dot")
    assert abs(float(rates[8])) > 1e3 * yaw


def test_single_precision_leaves_the_aileron_of_the_turn_uncertain():
    """Reason for the wider tolerance of the trim tables: 4e-7 of the sideslip rate's terms, as aileron."""
    inputs = state_and_controls(reference("textbook_checks")["turn_example_3_6_2"])
    _, slopes = rates_and_slopes(textbook_aircraft(0.35), textbook_environment(), jnp.asarray(inputs))
    _, alpha, beta, phi, theta, _, P, _, R = inputs[:9]
    g, V = 32.17, 502.0
    # [SL] coordinate the turn by its kinematics: gravity across the aircraft is the acceleration of the turn.
    coordination = np.zeros(17)
    coordination[1:5] = [
        V * np.cos(beta) * (R * np.sin(alpha) + P * np.cos(alpha)),
        V * np.sin(beta) * (R * np.cos(alpha) - P * np.sin(alpha)),
        g * np.cos(theta) * np.cos(phi),
        -g * np.sin(theta) * np.sin(phi),
    ]
    coordination[6], coordination[8] = V * np.cos(beta) * np.sin(alpha), -V * np.cos(beta) * np.cos(alpha)
    equations = np.vstack([np.asarray(slopes)[[0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 12]], coordination])
    unknowns = [1, 2, 3, 4, 6, 7, 8, 12, 13, 14, 15, 16]
    aileron_by_beta_dot = np.linalg.inv(equations[:, unknowns])[10, 2]
    beta_dot = 4e-7 * np.abs(slopes[2]) @ np.abs(inputs)
    assert beta_dot == pytest.approx(5.8e-8, rel=0.02)
    assert abs(aileron_by_beta_dot * beta_dot) == pytest.approx(1.5e-5, rel=0.02)


def test_aerodynamics_equal_static_shots():
    comparisons = assert_passes(F16_AERO_SHOTS, 90)
    assert {c.tolerance for c in comparisons} == {1e-6}


def test_thrust_equals_static_shots():
    comparisons = assert_passes(F16_ENGINE_SHOTS, 36)
    assert np.max([c.tolerance for c in comparisons]) == 1e-3
