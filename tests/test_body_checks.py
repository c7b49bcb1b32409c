"""Conditions on mass and inertia, compared with bodies of point masses and with eigenvalues."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.airframe_data import body_faults

MASS = {"mass": 1.0}


def quantities(J):
    return {fault.quantity for fault in body_faults(MASS, J)}


def inertia_of_points(points, masses):
    """Inertia matrix of point masses about their centre of mass."""
    at = points - masses @ points / masses.sum()
    second_moments = (at * masses[:, None]).T @ at
    return np.trace(second_moments) * np.eye(3) - second_moments


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 10**9), st.integers(3, 8))
def test_every_body_of_points_is_possible(seed, count):
    """Three points lie in a plane, on the bound of the triangle inequality."""
    draw = np.random.default_rng(seed)
    stretched = draw.normal(size=(count, 3)) * 10.0 ** draw.uniform(-1, 1, 3)
    assert body_faults(MASS, inertia_of_points(stretched, draw.uniform(0.1, 10.0, count)).tolist()) == []


@settings(deadline=None, max_examples=300)
@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_the_faults_agree_with_the_principal_moments(values):
    a, b, c, d, e, f = values
    J = np.array([[a, -d, -e], [-d, b, -f], [-e, -f, c]])
    smallest, middle, greatest = np.linalg.eigvalsh(J)
    margins = np.array([smallest, smallest + middle - greatest])
    if np.abs(margins).min() > 1e-4:  # the check allows minors of -1e-9, products of two moments
        assert (body_faults(MASS, J.tolist()) == []) == bool((margins > 0).all())


@pytest.mark.parametrize(
    ("J", "quantity"),
    [
        ([[-1.0, 0, 0], [0, 2, 0], [0, 0, 2]], "Jxx"),
        ([[1.0, 0, 0], [0, 0, 0], [0, 0, 1]], "Jyy"),
        ([[1.0, 0, 0], [0, 1, 0], [0, 0, float("nan")]], "Jzz"),
        ([[1.0, 0, 0], [0, 1, 0], [0, 0, 2.1]], "Jzz"),
        ([[2.0, 0, -float("inf")], [0, 2, 0], [-float("inf"), 0, 2]], "Jxz"),
        ([[2.0, -2.5, 0], [-2.5, 2, 0], [0, 0, 2]], "Jxy"),
        ([[2.0, 0, 0], [0, 2, 1.8], [0, 1.8, 2]], "Jyz"),
        ([[2.0, -1.2, -1.2], [-1.2, 2, -1.2], [-1.2, -1.2, 2]], "Jxy"),
    ],
)
def test_the_quantity_is_named(J, quantity):
    assert quantities(J) == {quantity}


@pytest.mark.parametrize("value", [0.0, -3.0, float("nan"), float("inf")])
def test_mass_and_dimensions_are_positive(value):
    (fault,) = body_faults({"mass": 2.0, "span": value}, np.eye(3).tolist())
    assert (fault.quantity, fault.expected) == ("span", "a positive number")
