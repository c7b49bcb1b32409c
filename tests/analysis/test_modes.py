"""Modes: their figures, and names that follow the eigenvectors wherever the classical modes go.

Those of the trimmed F-16 stand in `test_linearize_published.py`.
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
    """Model of level flight with a given A; the path's angles are those of the body less alpha and plus beta."""
    outputs = (*STATES, "n_z", "gamma", "chi", "mu")
    C = np.zeros((15, 11))
    C[:11] = np.eye(11)
    for row, columns in (
        ("gamma", {"theta": 1.0, "alpha": -1.0}),
        ("chi", {"psi": 1.0, "beta": 1.0}),
        ("mu", {"phi": 1.0}),
    ):
        for column, value in columns.items():
            C[outputs.index(row), STATES.index(column)] = value
    x = np.zeros(11)
    x[1] = alpha
    arrays = (A, np.zeros((11, 1)), C, np.zeros((15, 1)), x, np.zeros(1), np.zeros(15), np.zeros(11))
    return LinearModel(
        *(jnp.asarray(a) for a in arrays), jnp.asarray(step), jnp.asarray(regular), STATES, ("throttle",), outputs
    )


# --- figures


def test_figures_of_a_pair():
    mode = Mode("", complex(-0.3, 4.0), 2, ())
    assert mode.natural_frequency == pytest.approx(math.hypot(0.3, 4.0))
    assert mode.damping_ratio == pytest.approx(0.3 / math.hypot(0.3, 4.0))
    assert mode.period == pytest.approx(math.pi / 2)
    assert mode.eigenvalues == (complex(-0.3, 4.0), complex(-0.3, -4.0))
    # after the time to half, half is left
    assert math.exp(-0.3 * mode.time_to_half) == pytest.approx(0.5)
    assert math.exp(-0.3 * mode.time_constant) == pytest.approx(math.exp(-1))


def test_figures_of_real_modes():
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


def test_sampled_extremes():
    A = np.eye(11)
    A[6, 6], A[7, 7], A[8, 8] = 0.0, -0.5, 1.0 + 1e-13
    fastest, alternating, *rest = modes_of(model_of(A, step=0.01))
    assert fastest.eigenvalue.real == -math.inf
    assert (fastest.damping_ratio, fastest.time_constant) == (1.0, 0.0)
    assert alternating.eigenvalue == pytest.approx(complex(math.log(0.5), math.pi) / 0.01)
    assert alternating.order == 1
    assert all(mode.eigenvalue == 0 for mode in rest)  # 1 but for rounding


def test_shares_do_not_depend_on_units():
    random = np.random.default_rng(3)
    A = np.diag(-np.arange(1.0, 12.0)) + 0.3 * random.standard_normal((11, 11))
    scale = np.diag(10.0 ** random.uniform(-3, 3, 11))
    # Path angle, course and rates about the velocity mix states, so those that are mixed keep their units.
    for mixed in (1, 2, 3, 4, 5, 6, 8):
        scale[mixed, mixed] = 1.0
    plain, scaled = modes_of(model_of(A, alpha=0.3)), modes_of(model_of(scale @ A @ np.linalg.inv(scale), alpha=0.3))
    for a, b in zip(plain, scaled, strict=True):
        assert sum(share for _, share in a.shares) == pytest.approx(1.0)
        for (_, one), (_, other) in zip(a.shares, b.shares, strict=True):
            assert one == pytest.approx(other, abs=1e-9)


def test_wind_axes_at_an_angle_of_attack():
    names, matrix = wind_axis_states(model_of(np.eye(11), alpha=0.5))
    assert names == ("V", "alpha", "beta", "mu", "gamma", "chi", "P_w", "Q", "R_w", "altitude", "power")
    # a roll about the velocity: P = cos(alpha), R = sin(alpha)
    roll = np.zeros(11)
    roll[[6, 8]] = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(matrix @ roll, np.eye(11)[6], atol=1e-15)


def test_a_defective_matrix_gets_no_names_for_what_it_mixes():
    """Altitude as the integral of speed that nothing holds: one eigenvector for two eigenvalues."""
    A = np.diag([0.0, -1.0, -2.0, -3.0, -4.0, -5.0, -6.0, -7.0, -8.0, 0.0, -9.0])
    A[9, 0] = 1.0
    modes = modes_of(model_of(A))
    assert [mode.name for mode in modes if mode.eigenvalue == 0] == ["unnamed", "unnamed"]
    assert "engine" in [mode.name for mode in modes]


def test_the_vertical_is_refused():
    with pytest.raises(ValueError, match="within 1 deg of the vertical"):
        modes_of(model_of(np.eye(11), regular=False))


# --- names by shares alone


def candidate(pair=False, sound=True, **shares) -> ModeCandidate:
    names = ("V", "alpha", "beta", "mu", "gamma", "chi", "P_w", "Q", "R_w", "altitude", "power")
    return ModeCandidate(pair, {name: shares.get(name, 0.0) for name in names}, sound)


ROLL, SPIRAL = candidate(P_w=0.9, R_w=0.1), candidate(mu=0.9, R_w=0.1)
DUTCH = candidate(pair=True, beta=0.5, R_w=0.45, P_w=0.05)
SHORT, PHUGOID = candidate(pair=True, alpha=0.5, Q=0.5), candidate(pair=True, V=0.45, gamma=0.5, altitude=0.05)
FAST, SLOW = candidate(alpha=0.5, Q=0.5), candidate(V=0.5, gamma=0.3, Q=0.2)


@pytest.mark.parametrize(
    ("modes", "names"),
    [
        ([ROLL, DUTCH, SHORT, PHUGOID, SPIRAL], ["roll", "Dutch roll", "short period", "phugoid", "spiral"]),
        ([FAST, FAST, PHUGOID], ["short period (first real)", "short period (second real)", "phugoid"]),
        ([SHORT, SLOW, SLOW], ["short period", "phugoid (first real)", "phugoid (second real)"]),
        (
            [FAST, candidate(pair=True, V=0.3, gamma=0.3, alpha=0.2, Q=0.2), SLOW],
            ["short period (real)", "third oscillatory mode", "phugoid (real)"],
        ),
        # two claim to be what is left of the phugoid: neither is named
        (
            [FAST, candidate(pair=True, V=0.3, gamma=0.3, alpha=0.2, Q=0.2), SLOW, SLOW],
            ["short period (real)", "third oscillatory mode", "unnamed", "unnamed"],
        ),
        (
            [DUTCH, candidate(pair=True, mu=0.5, P_w=0.4, beta=0.1)],
            ["Dutch roll", "lateral phugoid"],
        ),
        # steep turn: path angle and bank swing together, speed goes its own way
        (
            [SHORT, candidate(pair=True, gamma=0.5, mu=0.33, V=0.15, altitude=0.02), candidate(V=0.7, mu=0.3)],
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
            [candidate(sound=False, P_w=0.9), candidate(pair=True, sound=False, alpha=0.5, Q=0.5)],
            ["unnamed", "unnamed"],
        ),
        ([candidate(power=1.0), candidate(chi=1.0), candidate(altitude=0.8)], ["engine", "heading", "altitude"]),
    ],
)
def test_classical_names(modes, names):
    assert classical_names(modes) == names


def test_names_under_an_autopilot_are_the_states():
    modes = [candidate(Q=0.8, alpha=0.2), candidate(alpha=0.4, Q=0.35), candidate(sound=False, V=1.0)]
    assert state_names(modes) == ["Q", "alpha and Q", "unnamed"]
