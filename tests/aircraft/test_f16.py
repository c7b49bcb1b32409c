"""The F-16 as built from its data: variants, ends of the tables, symmetry, and what jax needs of it."""

import copy
import json
from importlib import resources

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import AirData
from anser.aircraft.f16 import f16_from_data
from anser.units import DEG_RAD, FOOT_M, LBF_N, RAD_DEG, SLUG_KG

DATA = json.loads(resources.files("anser.aircraft").joinpath("data/f16.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def f16():
    return {variant: f16_from_data(DATA, variant) for variant in DATA["variants"]}


def flow(alpha_deg=5.0, beta_deg=0.0, V=150.0, altitude=1000.0, mach=0.45) -> AirData:
    values = (V, alpha_deg * DEG_RAD, beta_deg * DEG_RAD, 1.1, 0.55 * V * V, mach, altitude)
    return AirData(*(jnp.asarray(float(value)) for value in values))


@eqx.filter_jit
def coefficients(airframe, air_data, rates_b, surfaces):
    return airframe.coefficients(air_data, rates_b, surfaces)


def vector(airframe, air_data, rates_b=(0.0, 0.0, 0.0), surfaces_deg=(0.0, 0.0, 0.0)):
    c = coefficients(airframe, air_data, jnp.array(rates_b), jnp.array(surfaces_deg) * DEG_RAD)
    return np.array([c.CX, c.CY, c.CZ, c.Cl, c.Cm, c.Cn])


def test_textbook_mass_properties_are_those_of_the_theory_page(f16):
    # Theory section 4 prints six digits.
    properties = f16["textbook"].mass_properties
    J = properties.inertia_b
    np.testing.assert_allclose(properties.mass, 9295.44, rtol=1e-6)
    np.testing.assert_allclose([J[0, 0], J[1, 1], J[2, 2], -J[0, 2]], [12874.8, 75673.6, 85552.1, 1331.4], rtol=3e-5)
    np.testing.assert_allclose(properties.spin_momentum_b, [216.9, 0, 0], rtol=2e-4)
    np.testing.assert_allclose(properties.inertia_inverse_b @ J, jnp.eye(3), atol=1e-14)
    np.testing.assert_allclose(f16["textbook"].span, 9.144, rtol=1e-12)
    np.testing.assert_allclose(f16["textbook"].wing_area, 27.87, rtol=1e-4)
    np.testing.assert_allclose(f16["textbook"].mean_chord, 3.45, rtol=1e-3)


def test_variants_carry_their_own_mass_and_spin(f16):
    np.testing.assert_allclose(f16["s119"].mass_properties.mass, 637.1595 * SLUG_KG, rtol=1e-12)
    assert float(f16["s119"].x_cg) == 0.25
    assert not f16["s119"].mass_properties.spin_momentum_b.any()
    assert float(f16["textbook"].x_cg) == 0.30
    assert float(f16_from_data(DATA, x_cg_over_c=0.38).x_cg) == 0.38


def test_interpolation_passes_through_every_tabulated_value(f16):
    # At a node of all axes the coefficient is the table entry itself; at reference speed zero rate. No x_cg lever.
    airframe = f16_from_data(DATA, x_cg_over_c=0.35)
    tables = {name: np.asarray(table["values"]) for name, table in DATA["tables"].items()}
    axes = DATA["axes"]
    for i, alpha_deg in enumerate(axes["alpha_deg"]):
        for j, elevator_deg in enumerate(DATA["variants"]["textbook"]["elevator_axis_deg"]):
            coefficients = vector(airframe, flow(alpha_deg), surfaces_deg=(elevator_deg, 0.0, 0.0))
            assert coefficients[0] == pytest.approx(tables["CX0"][i, j], abs=1e-12)
            assert coefficients[4] == pytest.approx(tables["Cm0"][i, j], abs=1e-12)
        for j, beta_deg in enumerate(axes["abs_beta_deg"]):
            for sign in (1, -1):
                coefficients = vector(airframe, flow(alpha_deg, sign * beta_deg))
                assert coefficients[3] == pytest.approx(sign * tables["Cl0"][i, j], abs=1e-12)
                assert coefficients[5] == pytest.approx(sign * tables["Cn0"][i, j], abs=1e-12)
                assert coefficients[2] == pytest.approx(tables["CZ0"][i] * (1 - (beta_deg * DEG_RAD) ** 2), abs=1e-12)
        for j, beta_deg in enumerate(axes["beta_deg"]):
            still = vector(airframe, flow(alpha_deg, beta_deg))
            aileron = vector(airframe, flow(alpha_deg, beta_deg), surfaces_deg=(0.0, 20.0, 0.0)) - still
            rudder = vector(airframe, flow(alpha_deg, beta_deg), surfaces_deg=(0.0, 0.0, 30.0)) - still
            for k, change in ((0, aileron), (1, rudder)):
                assert change[3] == pytest.approx(tables[("Clda", "Cldr")[k]][i, j], abs=1e-12)
                assert change[5] == pytest.approx(tables[("Cnda", "Cndr")[k]][i, j], abs=1e-12)


def test_damping_derivatives_equal_the_tabulated_ones(f16):
    # Theory section 4: p = P b/2V, q = Q c/2V, r = R b/2V; alpha 10 deg is the fifth node.
    airframe = f16_from_data(DATA, x_cg_over_c=0.35)
    at = {
        name: DATA["tables"][name]["values"][4] for name in DATA["tables"] if name[1] in "XYZlmn" and name[2] in "pqr"
    }
    air = flow(10.0)
    half_span, half_chord = float(airframe.span) / 300.0, float(airframe.mean_chord) / 300.0
    steady = vector(airframe, air)
    for axis, names in enumerate((("CYp", "Clp", "Cnp"), ("CXq", "CZq", "Cmq"), ("CYr", "Clr", "Cnr"))):
        rates = [0.0, 0.0, 0.0]
        rates[axis] = 0.2
        change = vector(airframe, air, rates) - steady
        coefficient_names = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
        length = half_chord if axis == 1 else half_span
        expected = {name[:2]: at[name] * 0.2 * length for name in names}
        np.testing.assert_allclose(
            change, [expected.get(coefficient_name, 0.0) for coefficient_name in coefficient_names], atol=1e-14
        )


def test_the_centre_of_gravity_shifts_moments_by_lever_times_force(f16):
    aft, reference = (f16_from_data(DATA, x_cg_over_c=x) for x in (0.40, 0.35))
    case = (flow(12.0, 4.0), (0.3, 0.1, -0.2), (3.0, 5.0, -4.0))
    a, b = vector(aft, *case), vector(reference, *case)
    np.testing.assert_allclose(a[:4], b[:4], atol=1e-15)
    np.testing.assert_allclose(a[4] - b[4], -0.05 * b[2], atol=1e-14)
    np.testing.assert_allclose(a[5] - b[5], 0.05 * b[1] * 11.32 / 30.0, atol=1e-14)


def test_the_founding_variant_equals_its_thesis(f16):
    # Theory section 9 item 10: CXq(-5 deg) = +0.11; its elevator table ends at 25 deg, its aileron refers to 21.5 deg.
    founding, textbook = f16["founding"], f16["textbook"]
    pitching = (0.0, 0.4, 0.0)
    change = [vector(a, flow(-5.0), pitching)[0] - vector(a, flow(-5.0))[0] for a in (founding, textbook)]
    per_rate = 0.4 * float(textbook.mean_chord) / 300.0
    np.testing.assert_allclose(np.array(change) / per_rate, [0.11, -0.11], atol=1e-12)
    np.testing.assert_allclose(founding.tables.axes.breakpoints[2, :5], [-25, -12.5, 0, 12.5, 25], rtol=0)
    assert vector(founding, flow(5.0), surfaces_deg=(25.0, 0, 0))[0] == pytest.approx(-0.072, abs=1e-12)
    full = vector(founding, flow(5.0), surfaces_deg=(0, 21.5, 0)) - vector(founding, flow(5.0))
    assert full[3] == pytest.approx(DATA["tables"]["Clda"]["values"][3][3], abs=1e-12)


def test_tables_are_clamped_in_s119_and_extrapolated_in_the_textbook(f16):
    outside, end, inside = (vector(f16["s119"], flow(alpha_deg))[0] for alpha_deg in (50.0, 45.0, 40.0))
    assert outside == end
    assert end != inside
    outside, end, inside = (vector(f16["textbook"], flow(alpha_deg))[0] for alpha_deg in (50.0, 45.0, 40.0))
    assert outside == pytest.approx(2 * end - inside, abs=1e-12)


@settings(deadline=None, max_examples=25)
@given(
    alpha_deg=st.floats(-10, 45),
    beta_deg=st.floats(-30, 30),
    P=st.floats(-1, 1),
    Q=st.floats(-1, 1),
    R=st.floats(-1, 1),
    elevator_deg=st.floats(-25, 25),
)
def test_a_mirrored_flight_has_mirrored_forces(f16, alpha_deg, beta_deg, P, Q, R, elevator_deg):
    # With aileron and rudder at zero (their tables carry the tunnel's small asymmetry) left and right are equal.
    forces = vector(f16["textbook"], flow(alpha_deg, beta_deg), (P, Q, R), (elevator_deg, 0.0, 0.0))
    mirrored_forces = vector(f16["textbook"], flow(alpha_deg, -beta_deg), (-P, Q, -R), (elevator_deg, 0.0, 0.0))
    np.testing.assert_allclose(mirrored_forces, forces * [1, -1, 1, -1, 1, -1], atol=1e-13)


def test_the_wrench_is_dynamic_pressure_times_area_times_coefficients(f16):
    air, rates, surfaces_deg = flow(8.0, 3.0), (0.2, 0.1, -0.1), (-4.0, 3.0, 2.0)
    c = vector(f16["textbook"], air, rates, surfaces_deg)
    wrench = eqx.filter_jit(f16["textbook"].aerodynamics)(air, jnp.array(rates), jnp.array(surfaces_deg) * DEG_RAD)
    scale = float(air.qbar) * 300 * FOOT_M**2
    np.testing.assert_allclose(wrench.force_b, scale * c[:3], rtol=1e-12)
    np.testing.assert_allclose(wrench.moment_b, scale * c[3:] * np.array([30, 11.32, 30]) * FOOT_M, rtol=1e-12)
    thrust = f16["textbook"].engine.propulsion(50.0, flow(V=0.0, altitude=0.0, mach=0.0))
    np.testing.assert_allclose(thrust.force_b, [12680 * LBF_N, 0, 0], rtol=1e-12)
    assert not thrust.moment_b.any()


@pytest.mark.parametrize(
    ("where", "outside"),
    [
        ({}, False),
        ({"alpha_deg": 45.1}, True),
        ({"alpha_deg": -10.1}, True),
        ({"beta_deg": 30.1}, True),
        ({"beta_deg": -30.1}, True),
        ({"alpha_deg": 44.9, "beta_deg": 29.9}, False),
        ({"altitude": 50001 * FOOT_M}, True),
        ({"altitude": -1.0}, True),
        ({"mach": 1.01}, True),
        ({"mach": 0.99, "altitude": 49999 * FOOT_M}, False),
    ],
)
def test_conditions_outside_the_tables_are_reported(f16, where, outside):
    assert bool(f16["textbook"].outside_tables(flow(**where))) is outside


def test_coefficients_stay_finite_at_rest(f16):
    assert np.isfinite(vector(f16["textbook"], flow(V=0.0), (1.0, 1.0, 1.0))).all()


# Zero sideslip and table nodes of every axis are where a look-up with a bad branch has no slope.
KINKS = [(5.0, 0.0, (0.0, 0.0, 0.0)), (-10.0, -30.0, (-24.0, 20.0, 30.0)), (45.0, 10.0, (12.0, 0.0, 0.0))]


@eqx.filter_jit
@eqx.filter_grad
def slopes(arguments):
    """Derivatives of the sum of forces and moments by every input."""
    airframe, air_data, rates_b, surfaces = arguments
    wrench = airframe.aerodynamics(air_data, rates_b, surfaces) + airframe.engine.propulsion(50.0, air_data)
    return jnp.sum(wrench.force_b) + jnp.sum(wrench.moment_b)


@pytest.mark.long
@pytest.mark.parametrize(("alpha_deg", "beta_deg", "surfaces_deg"), KINKS)
def test_gradients_are_finite_at_kinks(f16, alpha_deg, beta_deg, surfaces_deg):
    arguments = (f16["textbook"], flow(alpha_deg, beta_deg), jnp.zeros(3), jnp.array(surfaces_deg) * DEG_RAD)
    gradient = slopes(arguments)
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    assert jnp.any(gradient[2] != 0)


def test_the_gradient_within_a_cell_equals_the_difference_quotient(f16):
    # Bilinear within a cell: the central difference is exact up to rounding 1e-16/1e-4 and the curvature of beta^2.
    airframe = f16["textbook"]

    def Cm(alpha):
        return airframe.coefficients(flow_at(alpha), jnp.zeros(3), jnp.array([0.1, 0.0, 0.0])).Cm

    def flow_at(alpha):
        return eqx.tree_at(lambda a: a.alpha, flow(), alpha)

    alpha, h = jnp.asarray(7.3 * DEG_RAD), 1e-4
    value = jax.jit(Cm)
    difference = (float(value(alpha + h)) - float(value(alpha - h))) / (2 * h)
    np.testing.assert_allclose(jax.jit(jax.grad(Cm))(alpha), difference, rtol=1e-9)


def test_batches_equal_single_evaluations(f16):
    alphas = np.array([-3.0, 4.0, 21.0, 44.0])
    batch = jax.tree.map(lambda *x: jnp.stack(x), *(flow(alpha, 2.0) for alpha in alphas))
    batch_coefficients = jax.jit(jax.vmap(f16["textbook"].coefficients, in_axes=(0, None, None)))(
        batch, jnp.zeros(3), jnp.full(3, 0.1)
    )
    for k, alpha in enumerate(alphas):
        single = vector(f16["textbook"], flow(alpha, 2.0), surfaces_deg=(0.1 * RAD_DEG,) * 3)
        np.testing.assert_allclose(batch_coefficients.Cm[k], single[4], atol=1e-15)
        np.testing.assert_allclose(batch_coefficients.Cn[k], single[5], atol=1e-15)


def test_new_airframe_data_do_not_recompile():
    # Every number of the airframe is an array: a fleet of different variants is one compiled function. The textbook
    # and founding tables have equal shapes.
    traces = []

    @jax.jit
    def lift(airframe):
        traces.append(1)
        return airframe.coefficients(flow(), jnp.zeros(3), jnp.zeros(3)).CZ

    lifts = [float(lift(f16_from_data(DATA, variant, x))) for variant, x in (("textbook", 0.3), ("founding", 0.35))]
    assert len(traces) == 1
    assert np.isfinite(lifts).all()


def test_an_unknown_variant_is_refused_with_the_known_names():
    with pytest.raises(ValueError, match=r"'textbok': known are textbook, s119, founding"):
        f16_from_data(DATA, "textbok")


def test_replaced_table_entries_are_checked():
    data = copy.deepcopy(DATA)
    data["tables"]["CXq"]["values"][1] = -0.12
    with pytest.raises(ValueError, match=r"founding: CXq\[1\] is -0.12, expected -0.11"):
        f16_from_data(data, "founding")
