"""The dispersed F-16: each factor changes exactly the named quantity."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import F16, AirData
from anser.aircraft.dispersions import dispersed_f16, no_dispersion
from anser.aircraft.f16 import F16_COEFFICIENTS, TABLE_COEFFICIENTS, F16Coefficients
from anser.aircraft_files import load_airframe
from support.states import air_at

NOMINAL = load_airframe("f16", "textbook")
assert isinstance(NOMINAL, F16)
FIELDS = [field.name for field in dataclasses.fields(F16Coefficients)]
AIR = AirData(*(jnp.asarray(x) for x in (140.0, 0.17, 0.06, 1.1, 1.1e4, 0.42, 1000.0)))
RATES, SURFACES = jnp.array([0.4, -0.2, 0.15]), jnp.array([-0.1, 0.12, -0.2])

TAKEN_AWAY = {
    "p": ("CYp", "Clp", "Cnp"),
    "q": ("CXq", "CZq", "Cmq"),
    "r": ("CYr", "Clr", "Cnr"),
    "elevator": ("CZde",),
    "aileron": ("CYda", "Clda", "Cnda"),
    "rudder": ("CYdr", "Cldr", "Cndr"),
    "beta": ("CYb",),
    "all but the flow": ("CX0", "CZ0", "Cm0", "Cl0", "Cn0"),
}
"""Inputs on which the coefficients depend: without the input, exactly the contribution is missing."""


@jax.jit
def coefficients(airframe, air=AIR, rates=RATES, surfaces=SURFACES):
    c = airframe.coefficients(air, rates, surfaces)
    return jnp.stack([getattr(c, name) for name in FIELDS])


def scaled(name, factor):
    """The nominal aircraft with one scaled coefficient."""
    index = F16_COEFFICIENTS.index(name)
    dispersion = no_dispersion()
    changed = dispersion.coefficients.at[index].set(factor)
    return dispersed_f16(NOMINAL, eqx.tree_at(lambda d: d.coefficients, dispersion, changed))


def changed(field, value):
    return dispersed_f16(NOMINAL, eqx.tree_at(lambda d: getattr(d, field), no_dispersion(), jnp.asarray(value)))


def contribution(name, omitted_input):
    """Nominal coefficient less the coefficient without one input, the c.g. at the reference."""
    at_reference = eqx.tree_at(lambda a: a.x_cg, NOMINAL, NOMINAL.x_cg_reference)
    index = FIELDS.index(name[:2])
    zero = jnp.zeros(3)
    if omitted_input == "all but the flow":
        return coefficients(at_reference, AIR, zero, zero)[index] if name != "Cm0" else None
    rates, surfaces, air = RATES, SURFACES, AIR
    if omitted_input in "pqr":
        rates = rates.at["pqr".index(omitted_input)].set(0.0)
    elif omitted_input == "beta":
        air = eqx.tree_at(lambda a: a.beta, AIR, jnp.zeros(()))
    else:
        surfaces = surfaces.at[("elevator", "aileron", "rudder").index(omitted_input)].set(0.0)
    complete, reduced = coefficients(at_reference), coefficients(at_reference, air, rates, surfaces)
    return complete[index] - reduced[index]


def test_every_coefficient_is_tested_and_named_once():
    tested = [name for names in TAKEN_AWAY.values() for name in names]
    assert sorted(tested) == sorted(F16_COEFFICIENTS)
    assert len(set(F16_COEFFICIENTS)) == len(F16_COEFFICIENTS) == no_dispersion().coefficients.size
    assert [len(names) for names in TABLE_COEFFICIENTS] == [cells.shape[-1] for cells in NOMINAL.tables.cells]


def test_the_aircraft_without_dispersion_is_unchanged():
    for ours, nominal in zip(
        jax.tree.leaves(dispersed_f16(NOMINAL, no_dispersion())), jax.tree.leaves(NOMINAL), strict=True
    ):
        np.testing.assert_array_equal(ours, nominal)


@pytest.mark.parametrize(("what", "name"), [(what, name) for what, names in TAKEN_AWAY.items() for name in names])
def test_a_factor_scales_its_contribution_alone(what, name):
    """The change is 0.3 of the contribution, up to rounding of coefficients of order one (1e-15 each)."""
    nominal, changed_coefficients = coefficients(NOMINAL), coefficients(scaled(name, 1.3))
    change = dict(zip(FIELDS, np.asarray(changed_coefficients - nominal), strict=True))
    scaled_field = name[:2]
    lever = float(NOMINAL.x_cg_reference - NOMINAL.x_cg)
    # forces act on moments through the lever of the c.g.
    expected = dict.fromkeys(FIELDS, 0.0) | {scaled_field: change[scaled_field]}
    if scaled_field == "CZ":
        expected["Cm"] = change[scaled_field] * lever
    if scaled_field == "CY":
        expected["Cn"] = -change[scaled_field] * lever * float(NOMINAL.mean_chord / NOMINAL.span)
    for field, value in expected.items():
        assert change[field] == pytest.approx(value, abs=1e-14), field
    assert abs(change[scaled_field]) > 1e-5
    share = contribution(name, what)
    if name in ("CX0", "Cm0"):  # functions of the elevator: compared at its own deflection
        at_reference = eqx.tree_at(lambda a: a.x_cg, NOMINAL, NOMINAL.x_cg_reference)
        only_elevator = SURFACES.at[1:].set(0.0)
        share = coefficients(at_reference, AIR, jnp.zeros(3), only_elevator)[FIELDS.index(scaled_field)]
    assert change[scaled_field] == pytest.approx(0.3 * float(share), abs=1e-14)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.floats(0.1, 10.0), min_size=3, max_size=3))
def test_positive_second_moments_give_a_possible_body(factors):
    """Positive principal moments within the triangle inequality; the nominal F-16 has a margin of 3.4 %."""
    properties = changed("second_moments", factors).mass_properties
    J, inverse = np.asarray(properties.inertia_b), np.asarray(properties.inertia_inverse_b)
    np.testing.assert_array_equal(J, J.T)
    smallest, middle, greatest = np.linalg.eigvalsh(J)
    assert 0 < smallest <= middle <= greatest < smallest + middle
    # relative to the largest entries of the sums, Jzz / Jxx <= 130 of them
    np.testing.assert_allclose(J @ inverse, np.eye(3), atol=1e-13)
    nominal = np.asarray(NOMINAL.mass_properties.inertia_b)
    root = np.sqrt(factors)
    nominal_moments, dispersed_moments = (0.5 * np.trace(matrix) * np.eye(3) - matrix for matrix in (nominal, J))
    np.testing.assert_allclose(dispersed_moments, nominal_moments * np.outer(root, root), atol=1e-15 * np.trace(J))


def test_factors_scale_thrust_mass_and_actuators():
    at = (jnp.asarray(70.0), air_at(3000.0, 0.5))
    nominal = NOMINAL.engine.propulsion(*at).force_b
    np.testing.assert_allclose(changed("thrust", 0.8).engine.propulsion(*at).force_b, 0.8 * nominal, rtol=1e-15)
    assert float(changed("mass", 1.2).mass_properties.mass) == pytest.approx(1.2 * float(NOMINAL.mass_properties.mass))
    # a first-order lag: half the bandwidth, half the rate for the same error
    slow = changed("actuator_bandwidth", 0.5).actuators
    moving = (slow.steady_state(jnp.zeros(3)), jnp.full(3, 0.01), at[1])
    half = 0.5 * NOMINAL.actuators.rate(*moving).position
    np.testing.assert_allclose(slow.rate(*moving).position, half, rtol=1e-15)
    np.testing.assert_array_equal(slow.rate_limit, NOMINAL.actuators.rate_limit)


def test_a_cg_shift_changes_the_moment_by_arm_times_force():
    """Moment about a c.g. moved aft by d: M' = M + d x F, with the former c.g. at d forward along body x."""
    shift = 0.07
    nominal = NOMINAL.aerodynamics(AIR, RATES, SURFACES)
    shifted = changed("cg_shift", shift).aerodynamics(AIR, RATES, SURFACES)
    np.testing.assert_array_equal(shifted.force_b, nominal.force_b)
    # the reference point moves forward, seen from the c.g.
    arm_b = np.array([shift * float(NOMINAL.mean_chord), 0.0, 0.0])
    expected = np.asarray(nominal.moment_b) + np.cross(arm_b, np.asarray(nominal.force_b))
    np.testing.assert_allclose(shifted.moment_b, expected, rtol=1e-12)


def test_dispersions_support_batches():
    draws = np.random.default_rng(1).uniform(0.8, 1.2, (5, 3))
    dispersions = jax.vmap(lambda x: eqx.tree_at(lambda d: d.second_moments, no_dispersion(), x))(jnp.asarray(draws))
    fleet = jax.jit(jax.vmap(dispersed_f16, in_axes=(None, 0)))(NOMINAL, dispersions)
    for k, factors in enumerate(draws):
        single = changed("second_moments", factors).mass_properties.inertia_b
        np.testing.assert_allclose(fleet.mass_properties.inertia_b[k], single, rtol=1e-15)
