"""Dispersions of the F-16 of TP-1538: each factor scales exactly the named part of the build-up."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AircraftState, AirData, Controls
from anser.aircraft.dispersions import dispersed_f16, no_dispersion
from anser.aircraft.engines import EnginePower
from anser.aircraft.f16 import F16_COEFFICIENTS
from anser.aircraft.motion import flat_earth_derivative
from anser.aircraft_files import load_airframe
from anser.environment import standard_environment
from anser.spatial import quaternion_from_euler

NOMINAL = load_airframe("f16", "tp1538", 0.35)
AIR = AirData(*(jnp.asarray(x) for x in (140.0, 0.24, 0.06, 1.1, 1.1e4, 0.42, 1000.0)))
RATES, SURFACES = jnp.array([0.4, -0.2, 0.15]), jnp.array([-0.1, 0.12, -0.2, 0.2])
ROWS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


@jax.jit
def coefficients(airframe):
    c = airframe.coefficients(AIR, RATES, SURFACES)
    return jnp.stack([getattr(c, name) for name in ROWS])


@jax.jit
def derivative(airframe):
    state = AircraftState(
        position_n=jnp.array([0.0, 0.0, -1000.0]),
        velocity_b=jnp.array([138.0, 5.0, 30.0]),
        quaternion=quaternion_from_euler(0.3, 0.2, 0.1),
        rates_b=RATES,
        actuators=airframe.actuators.steady_state(SURFACES),
        engine=EnginePower(jnp.asarray(40.0)),
    )
    controls = Controls(SURFACES + 0.05, jnp.asarray(0.5))
    return flat_earth_derivative(airframe, standard_environment(), 0.0, state, controls)


@jax.jit
def coefficients_with(number, factor):
    changed = no_dispersion().coefficients.at[number].set(factor)
    return coefficients(dispersed_f16(NOMINAL, eqx.tree_at(lambda d: d.coefficients, no_dispersion(), changed)))


@pytest.mark.parametrize("name", F16_COEFFICIENTS)
def test_a_factor_scales_its_own_part_alone_and_linearly(name):
    number = F16_COEFFICIENTS.index(name)
    at = {factor: np.asarray(coefficients_with(number, factor)) for factor in (0.0, 1.0, 3.0)}
    change = at[1.0] - at[0.0]
    assert abs(change[ROWS.index(name[:2])]) > 1e-5
    assert np.flatnonzero(np.abs(change) > 1e-12).tolist() == [ROWS.index(name[:2])]
    np.testing.assert_allclose(at[3.0] - at[1.0], 2 * change, atol=1e-13)


def test_the_parts_add_up_to_the_whole():
    """With zero coefficients, force and moment vanish."""
    nothing = NOMINAL.with_coefficients_scaled(jnp.zeros(len(F16_COEFFICIENTS)))
    np.testing.assert_allclose(coefficients(nothing), 0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("field", "value", "moved"),
    [
        ("mass", 1.1, "velocity_b"),
        ("thrust", 0.9, "velocity_b"),
        ("second_moments", (1.2, 1.0, 1.0), "rates_b"),
        ("second_moments", (1.0, 1.2, 1.0), "rates_b"),
        ("second_moments", (1.0, 1.0, 1.2), "rates_b"),
        ("actuator_bandwidth", 0.8, "actuators"),
        ("cg_shift", 0.03, "rates_b"),
    ],
)
def test_each_deviation_changes_the_flight(field, value, moved):
    dispersion = eqx.tree_at(lambda d: getattr(d, field), no_dispersion(), jnp.asarray(value))
    nominal_rate, changed_rate = derivative(NOMINAL), derivative(dispersed_f16(NOMINAL, dispersion))
    pairs = zip(*(jax.tree.leaves(getattr(d, moved)) for d in (nominal_rate, changed_rate)), strict=True)
    assert any(float(jnp.abs(a - b).max()) > 1e-3 for a, b in pairs)


def test_the_aircraft_without_dispersion_is_unchanged():
    for nominal_leaf, changed_leaf in zip(
        jax.tree.leaves(NOMINAL), jax.tree.leaves(dispersed_f16(NOMINAL, no_dispersion())), strict=True
    ):
        np.testing.assert_array_equal(nominal_leaf, changed_leaf)
