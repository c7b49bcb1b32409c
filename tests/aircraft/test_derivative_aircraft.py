"""An aircraft of derivatives: the Aerosonde's published figures, the Navion written twice, stall, tables, gradients."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import AirData, DerivativeAircraft
from anser.aircraft.air_data import air_data
from anser.aircraft.dispersions import BodyDispersion, DerivativeDispersion, dispersed_derivative_aircraft
from anser.aircraft_files import load_airframe
from anser.airframe_data import COEFFICIENTS, DERIVATIVE_ARGUMENTS, derivative_index
from anser.environment import StandardAtmosphere
from anser.numerics import make_axes, make_tables
from anser.verification.aerosonde import AEROSONDE_FORCES
from support.light_aircraft import light_aircraft

AEROSONDE = load_airframe("aerosonde")
assert isinstance(AEROSONDE, DerivativeAircraft)
SURFACES = AEROSONDE.actuators.names
AIR = AirData(*(jnp.asarray(x) for x in (25.0, 0.1, 0.06, 1.1, 343.75, 0.07, 1000.0)))
RATES, DEFLECTIONS = jnp.array([0.4, -0.2, 0.15]), jnp.array([-0.1, 0.12, -0.2])


def at(alpha, beta=0.0, V=25.0):
    return dataclasses.replace(AIR, alpha=jnp.asarray(alpha), beta=jnp.asarray(beta), V=jnp.asarray(V))


coefficients = eqx.filter_jit(lambda aircraft, data, rates, surfaces: aircraft.coefficients(data, rates, surfaces))
aerodynamics = eqx.filter_jit(lambda aircraft, data, rates, surfaces: aircraft.aerodynamics(data, rates, surfaces))
flow = jax.jit(lambda velocity_b: air_data(velocity_b, 100.0, StandardAtmosphere().at(100.0)))
separation = jax.jit(lambda alpha: AEROSONDE.flow_separation(alpha))


def coefficient(aircraft, name, data=AIR, rates=RATES, surfaces=DEFLECTIONS):
    return float(coefficients(aircraft, data, rates, surfaces)[COEFFICIENTS.index(name)])


def test_coefficients_equal_the_authors_figures():
    """42 figures of three states, [BM] appendix E; the errors are rounding: see the check's explanation."""
    comparisons = AEROSONDE_FORCES.measure()
    assert len(comparisons) == 42
    assert max(abs(comparison.error) for comparison in comparisons) < 1e-12
    assert all(comparison.passes for comparison in comparisons)


def with_values(aircraft, **values):
    changed = aircraft.derivatives
    for name, value in values.items():
        changed = changed.at[derivative_index(name, SURFACES)].set(value)
    return eqx.tree_at(lambda a: a.derivatives, aircraft, changed)


@functools.cache
def navion():
    """The light aircraft of the tests by derivatives; drag CD0 + K (CL^2 - CL0^2) at zero rates and deflections."""
    light = light_aircraft()
    K = 0.33 / (2 * 0.41 * 4.44)
    zero = eqx.tree_at(lambda a: a.derivatives, AEROSONDE, jnp.zeros_like(AEROSONDE.derivatives))
    aircraft = with_values(
        zero,
        CL0=0.41, CL_alpha=4.44, CL_q=3.8, CL_elevator=0.355, CD0=0.05 - K * 0.41**2,
        CY_beta=-0.564, CY_rudder=0.157, Cl_beta=-0.074, Cl_p=-0.41, Cl_r=0.107, Cl_aileron=-0.134, Cl_rudder=0.0107,
        Cm_alpha=-0.683, Cm_q=-9.96, Cm_elevator=-0.923, Cn_beta=0.071, Cn_p=-0.0575, Cn_r=-0.125, Cn_aileron=-0.0035,
        Cn_rudder=-0.072,
    )  # fmt: skip
    return eqx.tree_at(
        lambda a: (a.span, a.wing_area, a.mean_chord, a.induced_drag, a.stall_alpha),
        aircraft,
        (light.span, light.wing_area, light.mean_chord, jnp.asarray(K), jnp.asarray(100.0)),
    ), light


@given(V=st.floats(20.0, 80.0), alpha=st.floats(-0.15, 0.2), beta=st.floats(-0.3, 0.3), seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_the_aircraft_equals_a_hand_written_one(V, alpha, beta, seed):
    """Two formulations agree, except for drag: the hand-written one includes the lift of rates and elevator."""
    mine, light = navion()
    direction = [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
    data = flow(V * np.asarray(direction))
    random = np.random.default_rng(seed)
    rates, surfaces = random.normal(size=3) * [1.0, 0.0, 1.0], random.normal(size=3) * [0.0, 1.0, 1.0]
    mine, expected = (aerodynamics(airframe, data, rates, surfaces) for airframe in (mine, light))
    scale = float(data.qbar) * float(light.wing_area)
    np.testing.assert_allclose(mine.force_b, expected.force_b, atol=1e-12 * scale)
    np.testing.assert_allclose(mine.moment_b, expected.moment_b, atol=1e-12 * scale * 10)


@pytest.mark.parametrize(
    "name", [coefficient_name + column for coefficient_name in COEFFICIENTS for column in DERIVATIVE_ARGUMENTS]
)
def test_each_derivative_changes_one_coefficient(name):
    """A changed derivative changes one coefficient, by the argument."""
    V, b, c = 25.0, float(AEROSONDE.span), float(AEROSONDE.mean_chord)
    p, q, r = np.asarray(RATES) * [b, c, b] / (2 * V)
    argument = dict(zip(DERIVATIVE_ARGUMENTS, (1.0, 0.1, 0.06, p, q, r, 0.01, 0.0036), strict=True))[name[2:]]
    straight = eqx.tree_at(lambda a: (a.stall_alpha, a.induced_drag), AEROSONDE, (jnp.asarray(100.0), jnp.asarray(0.0)))
    changed = with_values(straight, **{name: 1.0 + float(straight.derivatives[derivative_index(name, SURFACES)])})
    before, after = (np.asarray(coefficients(each, AIR, RATES, DEFLECTIONS)) for each in (straight, changed))
    expected = np.zeros(6)
    expected[COEFFICIENTS.index(name[:2])] = argument
    np.testing.assert_allclose(after - before, expected, atol=1e-12)


def test_the_lift_far_beyond_the_stall_is_that_of_a_flat_plate():
    """[BM] equation 4.9: half of the attached lift remains at alpha0."""
    still = jnp.zeros(3)
    for alpha in (0.9, 1.5, -1.2, 3.0):
        plate = 2.0 * np.sign(np.sin(alpha)) * np.sin(alpha) ** 2 * np.cos(alpha)
        assert coefficient(AEROSONDE, "CL", at(alpha), still, still) == pytest.approx(plate, abs=1e-6)
    assert float(separation(0.47)) == pytest.approx(0.5)
    assert float(separation(0.0)) == pytest.approx(2 * np.exp(-23.5), rel=1e-3)


def test_the_blending_function_equals_the_source():
    M, a0 = 50.0, 0.47
    for alpha in np.linspace(-1.0, 1.0, 41):
        x, y = np.exp(-M * (alpha - a0)), np.exp(M * (alpha + a0))
        sigma = (1 + x + y) / ((1 + x) * (1 + y))
        assert float(separation(alpha)) == pytest.approx(sigma, rel=1e-6, abs=1e-12)


def test_moments_move_with_the_centre_of_gravity():
    """r x F: with the centre 0.1 m behind the reference, lift gives a nose-up moment."""
    moved = eqx.tree_at(lambda a: a.cg_offset_b, AEROSONDE, jnp.array([-0.1, 0.0, 0.02]))
    nominal, shifted = (
        jax.device_get(aerodynamics(airframe, AIR, RATES, DEFLECTIONS)) for airframe in (AEROSONDE, moved)
    )
    lever = np.array([0.1, 0.0, -0.02])  # the reference point seen from the centre
    np.testing.assert_allclose(shifted.moment_b - nominal.moment_b, np.cross(lever, nominal.force_b), atol=1e-10)
    assert float(shifted.moment_b[1]) > float(nominal.moment_b[1])


def with_table(name, over, points, values):
    """The Aerosonde with a table instead of one derivative."""
    index = derivative_index(name, SURFACES)
    bare = eqx.tree_at(lambda a: a.derivatives, AEROSONDE, AEROSONDE.derivatives.at[index].set(0.0))
    tables = make_tables(make_axes(points, clamp=True), [(tuple(range(len(points))), [values])])
    inputs = ("alpha", "beta", *SURFACES)
    return dataclasses.replace(
        bare,
        tables=tables,
        table_factors=jnp.ones(1),
        table_derivatives=(index,),
        table_arguments=tuple(inputs.index(argument) for argument in over),
    )


@functools.cache
def linear_tables():
    """A constant derivative, and a whole coefficient over two angles, as tables."""
    constant = with_table("Cm_q", ("alpha",), [np.array([-0.5, 0.0, 0.5])], np.full(3, -38.21))
    a, e = np.linspace(-0.5, 0.5, 5), np.linspace(-0.6, 0.6, 3)
    whole = with_table("Cm0", ("alpha", "elevator"), [a, e], 0.0135 - 2.74 * a[:, None] - 0.99 * e[None])
    return constant, with_values(whole, Cm_alpha=0.0, Cm_elevator=0.0)


@given(alpha=st.floats(-0.4, 0.4), elevator=st.floats(-0.5, 0.5))
@settings(max_examples=25, deadline=None)
def test_a_table_of_a_linear_function_equals_derivatives(alpha, elevator):
    """Of a derivative, and of a whole coefficient over two angles."""
    data, surfaces = at(alpha), np.asarray([elevator, *np.asarray(DEFLECTIONS)[1:]])
    expected = coefficient(AEROSONDE, "Cm", data, RATES, surfaces)
    for with_a_table in linear_tables():
        assert coefficient(with_a_table, "Cm", data, RATES, surfaces) == pytest.approx(expected, abs=1e-12)


def test_a_table_of_lift_stalls_as_derivatives_do():
    a = np.linspace(-1.0, 1.0, 21)
    table = with_values(with_table("CL0", ("alpha",), [a], 0.23 + 5.61 * a), CL_alpha=0.0)
    for alpha in (-0.6, 0.0, 0.3, 0.47, 0.8):
        assert coefficient(table, "CL", at(alpha)) == pytest.approx(coefficient(AEROSONDE, "CL", at(alpha)), abs=1e-12)
        assert coefficient(table, "CD", at(alpha)) == pytest.approx(coefficient(AEROSONDE, "CD", at(alpha)), abs=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "outside"),
    [("alpha", 0.0, False), ("alpha", 0.5, True), ("beta", -0.5, True), ("V", 12.9, True), ("V", 40.1, True)],
)
def test_conditions_outside_the_valid_range_are_reported(key, value, outside):
    assert bool(AEROSONDE.outside_tables(dataclasses.replace(AIR, **{key: jnp.asarray(value)}))) is outside


@jax.jit
@functools.partial(jax.jacfwd, argnums=(0, 1, 2))
def slopes(velocity_b, rates, surfaces):
    """Derivatives of forces and moments."""
    wrench = AEROSONDE.aerodynamics(air_data(velocity_b, 100.0, StandardAtmosphere().at(100.0)), rates, surfaces)
    return jnp.concatenate([wrench.force_b, wrench.moment_b])


@jax.jit
@functools.partial(jax.grad, allow_int=True)
def slopes_by_data(airframe):
    return jnp.sum(airframe.aerodynamics(AIR, RATES, DEFLECTIONS).force_b)


@pytest.mark.parametrize(
    "velocity", [(0.0, 0.0, 0.0), (25.0, 0.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, -5.0), (-9.0, 0.0, 0.0)]
)
def test_gradients_are_finite_everywhere(velocity):
    for jacobian in slopes(jnp.asarray(velocity), jnp.zeros(3), jnp.zeros(3)):
        assert np.all(np.isfinite(jacobian))


def test_gradients_by_the_data_are_finite():
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes_by_data(AEROSONDE)))


def test_batches_and_compiled_code_equal_single_evaluations():
    alphas = np.linspace(-0.5, 0.8, 6)
    alone = [AEROSONDE.coefficients(at(alpha, 0.06), RATES, DEFLECTIONS) for alpha in alphas]

    def one(alpha):
        return AEROSONDE.coefficients(dataclasses.replace(AIR, alpha=alpha), RATES, DEFLECTIONS)

    np.testing.assert_allclose(jax.jit(jax.vmap(one))(alphas), alone, rtol=1e-12)
    np.testing.assert_allclose(jax.jit(one)(alphas[2]), alone[2], rtol=1e-12)


def no_dispersion(aircraft):
    unity = jnp.ones(())
    body = BodyDispersion(unity, unity, jnp.ones(3), unity, jnp.zeros(()))
    return DerivativeDispersion(jnp.ones_like(aircraft.derivatives), None, body)


def _second_moments(inertia_b):
    """Integrals of x^2, y^2, z^2 over the mass."""
    Jxx, Jyy, Jzz = np.diag(inertia_b)
    return 0.5 * np.array([Jyy + Jzz - Jxx, Jxx + Jzz - Jyy, Jxx + Jyy - Jzz])


def test_a_dispersion_changes_the_named_quantity():
    unchanged = dispersed_derivative_aircraft(AEROSONDE, no_dispersion(AEROSONDE))
    for a, b in zip(jax.tree.leaves(unchanged), jax.tree.leaves(AEROSONDE), strict=True):
        np.testing.assert_array_equal(a, b)
    index = derivative_index("Cm_alpha", SURFACES)
    d = no_dispersion(AEROSONDE)
    d = eqx.tree_at(
        lambda d: (
            d.derivatives,
            *(getattr(d.body, n) for n in ("thrust", "mass", "second_moments", "actuator_bandwidth", "cg_shift")),
        ),
        d,
        (
            d.derivatives.at[index].set(0.5),
            jnp.asarray(0.8),
            jnp.asarray(1.1),
            jnp.array([1.21, 1.0, 1.44]),
            jnp.asarray(2.0),
            jnp.asarray(0.1),
        ),
    )
    dispersed = dispersed_derivative_aircraft(AEROSONDE, d)
    assert float(dispersed.derivatives[index]) == pytest.approx(-1.37)
    assert float(dispersed.mass_properties.mass) == pytest.approx(12.1)
    J, nominal_b = np.asarray(dispersed.mass_properties.inertia_b), np.asarray(AEROSONDE.mass_properties.inertia_b)
    of_x, of_y, of_z = 1.21 * _second_moments(nominal_b) * [1.0, 1.0 / 1.21, 1.44 / 1.21]
    expected = np.diag([of_y + of_z, of_x + of_z, of_x + of_y])
    expected[0, 2] = expected[2, 0] = 1.32 * nominal_b[0, 2]
    np.testing.assert_allclose(J, expected, rtol=1e-14)
    np.testing.assert_allclose(J @ np.asarray(dispersed.mass_properties.inertia_inverse_b), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(dispersed.actuators.time_constant, 0.025)
    assert float(dispersed.cg_offset_b[0]) == pytest.approx(-0.1 * 0.18994)
    thrusts = [float(a.engine.propulsion(70.0, AIR).force_b[0]) for a in (AEROSONDE, dispersed)]
    assert thrusts[1] == pytest.approx(0.8 * thrusts[0])
