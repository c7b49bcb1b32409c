"""Modes: figures, and names that follow the eigenvectors.

Modes of the trimmed F-16: see `test_linearize_published.py`.
"""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from anser.analysis import modes_of
from anser.analysis.linearization import LinearModel
from anser.analysis.modes import Mode, ModeCandidate, classical_names, state_names, wind_axis_states

STATES = ("V", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "altitude", "power")


def model_of(A, step=0.0, alpha=0.0, regular=True) -> LinearModel:
    """Model of level flight with a given A; the path angles are the body angles minus alpha and plus beta."""
    outputs = (*STATES, "n_z", "gamma", "chi", "mu")
    C = np.zeros((15, 11))
    C[:11] = np.eye(11)
    for output, coefficients in (
        ("gamma", {"theta": 1.0, "alpha": -1.0}),
        ("chi", {"psi": 1.0, "beta": 1.0}),
        ("mu", {"phi": 1.0}),
    ):
        for state, value in coefficients.items():
            C[outputs.index(output), STATES.index(state)] = value
    x = np.zeros(11)
    x[1] = alpha
    arrays = (A, np.zeros((11, 1)), C, np.zeros((15, 1)), x, np.zeros(1), np.zeros(15), np.zeros(11))
    return LinearModel(
        *(jnp.asarray(a) for a in arrays), jnp.asarray(step), jnp.asarray(regular), STATES, ("throttle",), outputs
    )


# --- figures


def test_a_pair_has_its_figures():
    mode = Mode("", complex(-0.3, 4.0), 2, ())
    assert mode.natural_frequency == pytest.approx(math.hypot(0.3, 4.0))
    assert mode.damping_ratio == pytest.approx(0.3 / math.hypot(0.3, 4.0))
    assert mode.period == pytest.approx(math.pi / 2)
    assert mode.eigenvalues == (complex(-0.3, 4.0), complex(-0.3, -4.0))
    # half of the amplitude remains after the time to half
    assert math.exp(-0.3 * mode.time_to_half) == pytest.approx(0.5)
    assert math.exp(-0.3 * mode.time_constant) == pytest.approx(math.exp(-1))


def test_real_modes_have_their_figures():
    growing, standing = Mode("", 0.1 + 0j, 1, ()), Mode("", 0j, 1, ())
    assert math.exp(0.1 * -growing.time_to_half) == pytest.approx(2.0)
    assert (growing.damping_ratio, growing.period) == (-1.0, math.inf)
    assert (standing.damping_ratio, standing.natural_frequency) == (0.0, 0.0)
    assert (standing.time_constant, standing.time_to_half, standing.period) == (math.inf,) * 3


def test_pairs_are_counted_once_and_sampled_ones_are_continuous():
    A = np.diag(np.linspace(-1.0, -3.0, 11))
    A[1, 7], A[7, 1] = 2.0, -2.0  # alpha and Q turn
    modes = modes_of(model_of(A))
    assert sum(mode.order for mode in modes) == 11
    assert [abs(mode.eigenvalue) for mode in modes] == sorted((abs(m.eigenvalue) for m in modes), reverse=True)
    pair = next(mode for mode in modes if mode.order == 2)
    assert pair.eigenvalue == pytest.approx(np.linalg.eigvals(A[np.ix_([1, 7], [1, 7])])[0])
    assert pair.name == "short period"
    values, vectors = np.linalg.eig(A)
    sampled = modes_of(model_of((vectors * np.exp(0.02 * values) @ np.linalg.inv(vectors)).real, step=0.02))
    for a, b in zip(modes, sampled, strict=True):
        assert b.eigenvalue == pytest.approx(a.eigenvalue, rel=1e-9)
    assert next(mode.name for mode in sampled if mode.order == 2) in ("alpha and Q", "Q and alpha")


def test_sampled_extremes_have_finite_figures_or_limits():
    A = np.eye(11)
    A[6, 6], A[7, 7], A[8, 8] = 0.0, -0.5, 1.0 + 1e-13
    fastest, alternating, *neutral_modes = modes_of(model_of(A, step=0.01))
    assert fastest.eigenvalue.real == -math.inf
    assert (fastest.damping_ratio, fastest.time_constant) == (1.0, 0.0)
    assert alternating.eigenvalue == pytest.approx(complex(math.log(0.5), math.pi) / 0.01)
    assert alternating.order == 1
    assert all(mode.eigenvalue == 0 for mode in neutral_modes)  # 1 but for rounding


def test_shares_do_not_depend_on_units():
    random = np.random.default_rng(3)
    A = np.diag(-np.arange(1.0, 12.0)) + 0.3 * random.standard_normal((11, 11))
    scale = np.diag(10.0 ** random.uniform(-3, 3, 11))
    # Path angle, course and rates about the velocity mix states, so the mixed states keep their units.
    for mixed in (1, 2, 3, 4, 5, 6, 8):
        scale[mixed, mixed] = 1.0
    plain, scaled = modes_of(model_of(A, alpha=0.3)), modes_of(model_of(scale @ A @ np.linalg.inv(scale), alpha=0.3))
    for plain_mode, scaled_mode in zip(plain, scaled, strict=True):
        assert sum(share for _, share in plain_mode.shares) == pytest.approx(1.0)
        for (_, plain_share), (_, scaled_share) in zip(plain_mode.shares, scaled_mode.shares, strict=True):
            assert plain_share == pytest.approx(scaled_share, abs=1e-9)


def test_a_roll_about_the_velocity_is_one_wind_axis_state():
    names, matrix = wind_axis_states(model_of(np.eye(11), alpha=0.5))
    assert names == ("V", "alpha", "beta", "mu", "gamma", "chi", "P_w", "Q", "R_w", "altitude", "power")
    # a roll about the velocity: P = cos(alpha), R = sin(alpha)
    roll = np.zeros(11)
    roll[[6, 8]] = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(matrix @ roll, np.eye(11)[6], atol=1e-15)


def test_mixed_modes_of_a_defective_matrix_are_unnamed():
    """Altitude as the integral of an uncontrolled speed: a single eigenvector for two eigenvalues."""
    A = np.diag([0.0, -1.0, -2.0, -3.0, -4.0, -5.0, -6.0, -7.0, -8.0, 0.0, -9.0])
    A[9, 0] = 1.0
    modes = modes_of(model_of(A))
    assert [mode.name for mode in modes if mode.eigenvalue == 0] == ["unnamed", "unnamed"]
    assert "engine" in [mode.name for mode in modes]


def test_a_vertical_condition_is_refused():
    with pytest.raises(ValueError, match="within 1 deg of the vertical"):
        modes_of(model_of(np.eye(11), regular=False))


# --- names by shares alone


def candidate(is_oscillatory=False, is_reliable=True, **shares) -> ModeCandidate:
    names = ("V", "alpha", "beta", "mu", "gamma", "chi", "P_w", "Q", "R_w", "altitude", "power")
    return ModeCandidate(is_oscillatory, {name: shares.get(name, 0.0) for name in names}, is_reliable)


ROLL, SPIRAL = candidate(P_w=0.9, R_w=0.1), candidate(mu=0.9, R_w=0.1)
DUTCH = candidate(is_oscillatory=True, beta=0.5, R_w=0.45, P_w=0.05)
SHORT, PHUGOID = (
    candidate(is_oscillatory=True, alpha=0.5, Q=0.5),
    candidate(is_oscillatory=True, V=0.45, gamma=0.5, altitude=0.05),
)
FAST, SLOW = candidate(alpha=0.5, Q=0.5), candidate(V=0.5, gamma=0.3, Q=0.2)


@pytest.mark.parametrize(
    ("modes", "names"),
    [
        ([ROLL, DUTCH, SHORT, PHUGOID, SPIRAL], ["roll", "Dutch roll", "short period", "phugoid", "spiral"]),
        ([FAST, FAST, PHUGOID], ["short period (first real)", "short period (second real)", "phugoid"]),
        ([SHORT, SLOW, SLOW], ["short period", "phugoid (first real)", "phugoid (second real)"]),
        (
            [FAST, candidate(is_oscillatory=True, V=0.3, gamma=0.3, alpha=0.2, Q=0.2), SLOW],
            ["short period (real)", "third oscillatory mode", "phugoid (real)"],
        ),
        # two candidates for the remnant of the phugoid: both unnamed
        (
            [FAST, candidate(is_oscillatory=True, V=0.3, gamma=0.3, alpha=0.2, Q=0.2), SLOW, SLOW],
            ["short period (real)", "third oscillatory mode", "unnamed", "unnamed"],
        ),
        (
            [DUTCH, candidate(is_oscillatory=True, mu=0.5, P_w=0.4, beta=0.1)],
            ["Dutch roll", "lateral phugoid"],
        ),
        # steep turn: path angle and bank oscillate together, speed is a separate mode
        (
            [
                SHORT,
                candidate(is_oscillatory=True, gamma=0.5, mu=0.33, V=0.15, altitude=0.02),
                candidate(V=0.7, mu=0.3),
            ],
            ["short period", "unnamed", "speed"],
        ),
        (
            [candidate(beta=0.6, R_w=0.4), candidate(R_w=0.7, beta=0.3)],
            ["Dutch roll (first real)", "Dutch roll (second real)"],
        ),
        # a name belongs to one mode
        ([ROLL, ROLL], ["unnamed", "unnamed"]),
        ([candidate(P_w=0.4, mu=0.4, V=0.2)], ["unnamed"]),
        (
            [
                candidate(is_reliable=False, P_w=0.9),
                candidate(is_oscillatory=True, is_reliable=False, alpha=0.5, Q=0.5),
            ],
            ["unnamed", "unnamed"],
        ),
        ([candidate(power=1.0), candidate(chi=1.0), candidate(altitude=0.8)], ["engine", "heading", "altitude"]),
    ],
)
def test_modes_have_classical_names(modes, names):
    assert classical_names(modes) == names


def test_names_under_an_autopilot_are_the_states():
    modes = [candidate(Q=0.8, alpha=0.2), candidate(alpha=0.4, Q=0.35), candidate(is_reliable=False, V=1.0)]
    assert state_names(modes) == ["Q", "alpha and Q", "unnamed"]
