"""The F-16 of TP-1538: its build-up by another interpolation, and its reduction to the textbook's tables."""

import json
from importlib import resources

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import F16TP1538, AirData
from anser.aircraft_files import load_airframe
from anser.units import DEG_RAD, FOOT_M, SLUG_KG
from support.tp1538_build_up import AXES, DATA, TABLES
from support.tp1538_build_up import coefficients as written_out

X_CG = 0.30
AIRFRAME = load_airframe("f16", "tp1538")
TEXTBOOK = load_airframe("f16", "textbook")
ROWS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


def flow(alpha_deg, beta_deg=0.0, V=150.0, mach=0.45) -> AirData:
    values = (V, alpha_deg * DEG_RAD, beta_deg * DEG_RAD, 1.1, 0.55 * V * V, mach, 1000.0)
    return AirData(*(jnp.asarray(value, dtype=float) for value in values))


def _vector(airframe, alpha, beta, surfaces_deg, rates, V):
    air = AirData(V, alpha * DEG_RAD, beta * DEG_RAD, V * 0 + 1.1, 0.55 * V * V, V * 0 + 0.45, V * 0 + 1000.0)
    c = airframe.coefficients(air, rates, surfaces_deg * DEG_RAD)
    return jnp.stack([getattr(c, name) for name in ROWS])


many = jax.jit(jax.vmap(_vector, in_axes=(None, 0, 0, 0, 0, 0)))


def table(airframe, alphas, betas, surfaces_deg, rates=None, V=150.0):
    """Coefficients at rows of conditions; a single number holds for all."""
    alphas, betas = np.broadcast_arrays(np.asarray(alphas, float), np.asarray(betas, float))
    count = alphas.size
    surfaces = np.broadcast_to(np.asarray(surfaces_deg, float), (count, np.shape(surfaces_deg)[-1]))
    rates = np.broadcast_to(np.zeros(3) if rates is None else np.asarray(rates, float), (count, 3))
    return np.asarray(many(airframe, alphas.ravel(), betas.ravel(), surfaces, rates, np.broadcast_to(V, count)))


def test_the_aircraft_equals_that_of_the_report():
    assert isinstance(AIRFRAME, F16TP1538)
    np.testing.assert_allclose(AIRFRAME.mass_properties.mass, 636.94 * SLUG_KG, rtol=1e-14)
    assert AIRFRAME.actuators.names == ("elevator", "aileron", "rudder", "leading_edge_flap")
    assert AIRFRAME.actuators.is_commanded == (True, True, True, False)
    assert len(DATA["tables"]) == 43


@pytest.mark.parametrize("x_cg", [0.25, X_CG, 0.40])
def test_the_build_up_equals_that_of_the_report(x_cg):
    """4000 random states against the formulas written out with SciPy's interpolation; rounding only."""
    random = np.random.default_rng(1538)
    count = 4000
    alphas = np.concatenate([random.uniform(-20, 45, count // 2), random.uniform(45, 90, count // 2)])
    betas = random.uniform(-30, 30, count)
    lef = np.where(alphas > 45, 25.0, random.uniform(0, 25, count))
    surfaces = np.column_stack([random.uniform(-1, 1, (count, 3)) * [25, 21.5, 30], lef])
    rates, V = random.uniform(-2, 2, (count, 3)), random.uniform(40, 300, count)
    computed = table(load_airframe("f16", "tp1538", x_cg), alphas, betas, surfaces, rates, V)
    expected = written_out(alphas, betas, *surfaces.T, *rates.T, V / FOOT_M, x_cg)
    np.testing.assert_allclose(computed, expected, rtol=0, atol=2e-14)


@pytest.mark.parametrize(("name", "row"), [("Cx", 0), ("Cz", 2), ("Cl", 3), ("Cn", 5)])
def test_interpolation_passes_through_every_printed_value(name, row):
    axes = [AXES[axis] for axis in DATA["tables"][name]["axes"]]
    alphas, betas, elevators = (x.ravel() for x in np.meshgrid(*axes, indexing="ij"))
    surfaces = np.column_stack([elevators, *np.zeros((2, elevators.size)), np.full(elevators.size, 25.0)])
    at_reference = load_airframe("f16", "tp1538", 0.35)
    values = table(at_reference, alphas, betas, surfaces)[:, row]
    if name in ("Cl", "Cn"):
        values = values - np.interp(alphas, AXES["alpha1"], TABLES[f"delta{name}beta"]) * betas
    np.testing.assert_allclose(values, TABLES[name].ravel(), atol=1e-13)


def test_flap_increments_go_to_zero_where_they_were_not_measured():
    """Tables with the flap at 0 end at 45 deg; from 50 deg on they have no influence, with continuity in between."""
    up, down = (table(AIRFRAME, [44.999, 45.001, 47.5, 50.0, 70.0], 7.0, (5.0, 10.0, 10.0, x)) for x in (0.0, 25.0))
    np.testing.assert_array_equal(up[3:], down[3:])
    np.testing.assert_allclose(up[0], up[1], atol=2e-4)
    np.testing.assert_allclose((up - down)[2], 0.5 * (up - down)[1], rtol=2e-3, atol=1e-6)


# --- reduction to the textbook: static flap schedule at low speed, [SL] appendix A made from these tables ---

SHORT = np.arange(-10.0, 46.0, 5.0)
SIDESLIP = np.arange(0.0, 31.0, 5.0)
BETAS = np.arange(-30.0, 31.0, 10.0)
PRINTED = json.loads(resources.files("anser.aircraft").joinpath("data/f16.json").read_text(encoding="utf-8"))["tables"]
HALF_DIGIT = 0.5e-3 + 1e-9


def lef_of(alphas):
    """Static flap schedule at the textbook's Mach number, deg."""
    return np.clip(1.38 * np.asarray(alphas) + 0.43, 0.0, 25.0)


def reduced(alphas, betas, elevator=0.0, aileron=0.0, rudder=0.0, rates=None):
    """Coefficients about the reference point with the flap on schedule."""
    alphas, betas = np.broadcast_arrays(alphas, betas)
    surfaces = np.column_stack(
        [np.full(alphas.size, x) for x in (elevator, aileron, rudder)] + [lef_of(alphas.ravel())]
    )
    return table(load_airframe("f16", "tp1538", 0.35), alphas, betas, surfaces, rates).reshape(*alphas.shape, 6)


def textbook(name):
    return np.array(PRINTED[name]["values"], dtype=float)


def last_digit(values):
    """Half of the last printed digit of each value, for three significant digits as in [SL]."""
    digits = np.floor(np.log10(np.maximum(np.abs(values), 1e-9)))
    return 0.5 * 10.0 ** np.clip(digits - 2, -3, None) + 1e-9


@pytest.mark.parametrize("name", ["CXq", "CYr", "CYp", "CZq", "Clr"])
def test_damping_reduces_to_the_textbook_in_all_twelve_values(name):
    rates, length = np.zeros(3), AIRFRAME.mean_chord if name[2] == "q" else AIRFRAME.span
    rates["pqr".index(name[2])] = 2 * 150.0 / float(length)
    change = reduced(SHORT, 0.0, rates=rates) - reduced(SHORT, 0.0)
    expected = textbook(name)
    assert (np.abs(change[:, ROWS.index(name[:2])] - expected) <= last_digit(expected)).all()


@pytest.mark.parametrize(("name", "agree"), [("Cl0", 83), ("Cn0", 83)])
def test_moments_of_sideslip_reduce_to_the_textbook(name, agree):
    """Antisymmetrised, with the increments of beta (without them 65 and 70 of 84 agree); rounded twice: 0.6 digits."""
    alphas, betas = np.meshgrid(SHORT, SIDESLIP, indexing="ij")
    row = ROWS.index(name[:2])
    odd = 0.5 * (reduced(alphas, betas) - reduced(alphas, -betas))[..., row]
    assert np.sum(np.abs(odd - textbook(name)) <= 0.6e-3) == agree


@pytest.mark.parametrize(("name", "agree"), [("Clda", 83), ("Cnda", 83), ("Cldr", 82), ("Cndr", 81)])
def test_aileron_and_rudder_reduce_to_the_textbook(name, agree):
    """Per 20 deg of aileron and 30 deg of rudder, as the textbook declares its own derivatives."""
    alphas, betas = np.meshgrid(SHORT, BETAS, indexing="ij")
    full = {"aileron": 20.0} if name.endswith("a") else {"rudder": 30.0}
    change = (reduced(alphas, betas, **full) - reduced(alphas, betas))[..., ROWS.index(name[:2])]
    assert np.sum(np.abs(change - textbook(name)) <= HALF_DIGIT) == agree


def test_ailerons_are_as_strong_as_those_of_the_textbook():
    """Rolling moment of 20 deg, both aircraft as flown, where the textbook keeps the tables (83 of 84 entries)."""
    alphas, betas = np.meshgrid(SHORT, BETAS, indexing="ij")
    of_tunnel = (reduced(alphas, betas, aileron=20.0) - reduced(alphas, betas))[..., ROWS.index("Cl")]
    at_reference = load_airframe("f16", "textbook", 0.35)
    full, none = (table(at_reference, alphas, betas, (0.0, aileron, 0.0)) for aileron in (20.0, 0.0))
    of_textbook = (full - none)[:, ROWS.index("Cl")].reshape(alphas.shape)
    assert np.sum(np.abs(of_tunnel - of_textbook) <= HALF_DIGIT) == 83
    # 21.5 deg is where the ailerons stop
    np.testing.assert_allclose(AIRFRAME.actuators.upper[1] / DEG_RAD, 21.5)


def test_axial_force_reduces_to_the_textbook_within_a_digit():
    """At the textbook's elevator deflections, which lie between those of the tunnel."""
    for k, elevator in enumerate((-24.0, -12.0, 0.0, 12.0, 24.0)):
        np.testing.assert_allclose(reduced(SHORT, 0.0, elevator)[:, 0], textbook("CX0")[:, k], atol=1e-3 + 1e-9)


def test_pitching_moment_reduces_to_the_textbook_below_the_stall():
    """Up to 30 deg within 0.001; above, the textbook is smoothed."""
    for k, elevator in enumerate((-24.0, -12.0, 0.0, 12.0, 24.0)):
        moments = reduced(SHORT, 0.0, elevator)[:, 4]
        np.testing.assert_allclose(moments[:9], textbook("Cm0")[:9, k], atol=1.5e-3)


# --- what jax needs, and properties ---


def test_the_pitch_damping_of_lift_is_not_the_flap_increment_of_lift():
    """A well-known public code multiplies the pitch rate by the increment of CZ: a large error at alpha -10 deg."""
    rate = np.array([0.0, 0.3, 0.0])
    air = (-10.0, 0.0, (0.0, 0.0, 0.0, 0.0))
    change = (table(AIRFRAME, *air, rate) - table(AIRFRAME, *air))[0, 2]
    at = list(AXES["alpha1"]).index(-10.0)
    q = 0.3 * float(AIRFRAME.mean_chord) / 300.0
    assert change == pytest.approx(q * (TABLES["Czq"][at] + TABLES["deltaCzq_lef"][at]), abs=1e-12)


@settings(deadline=None, max_examples=40)
@given(
    alpha=st.floats(-20, 90),
    beta=st.floats(-30, 30),
    lef=st.floats(0, 25),
    surfaces=st.tuples(st.floats(-25, 25), st.floats(-21.5, 21.5), st.floats(-30, 30)),
    shares=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)),
)
def test_coefficients_are_linear_in_aileron_rudder_flap_and_rates(alpha, beta, lef, surfaces, shares):
    """Half of aileron, rudder, flap or rates gives the mean of zero and full: only the elevator is nonlinear."""
    e, a, r = surfaces
    angles = (np.array([alpha]), np.array([beta]))
    rates = 2.0 * np.array(shares)
    for zero, full, zero_rates, full_rates in (
        ((e, 0, r, lef), (e, a, r, lef), rates, rates),
        ((e, a, 0, lef), (e, a, r, lef), rates, rates),
        ((e, a, r, 0), (e, a, r, lef), rates, rates),
        ((e, a, r, lef), (e, a, r, lef), 0 * rates, rates),
    ):
        endpoints = [table(AIRFRAME, *angles, s, w) for s, w in ((zero, zero_rates), (full, full_rates))]
        middle = table(AIRFRAME, *angles, np.add(zero, full) / 2, (zero_rates + full_rates) / 2)
        np.testing.assert_allclose(middle, np.add(*endpoints) / 2, atol=1e-12)


def test_tables_are_clamped_beyond_the_ends_and_reported():
    for inside, outside in (((90.0, 3.0), (120.0, 3.0)), ((-20.0, 3.0), (-35.0, 3.0)), ((10.0, 30.0), (10.0, 40.0))):
        np.testing.assert_allclose(
            table(AIRFRAME, *inside, (0, 0, 0, 25.0))[0, :3], table(AIRFRAME, *outside, (0, 0, 0, 25.0))[0, :3]
        )
        assert bool(AIRFRAME.outside_tables(flow(*outside)))
        assert not bool(AIRFRAME.outside_tables(flow(inside[0] * 0.999, inside[1] * 0.999)))
    assert bool(TEXTBOOK.outside_tables(flow(60.0)))
    assert not bool(AIRFRAME.outside_tables(flow(60.0)))


def test_gradients_are_finite_everywhere_at_breakpoints_and_at_rest():
    def sizes(x):
        air = AirData(x[0], x[1], x[2], x[0] * 0 + 1.0, 0.5 * x[0] ** 2, x[0] / 330.0, x[0] * 0 + 1000.0)
        wrench = AIRFRAME.aerodynamics(air, x[3:6], x[6:10])
        state = AIRFRAME.actuators.steady_state_in_flow(x[6:10], air)
        rate = AIRFRAME.actuators.rate(state, x[6:10], air)
        return jnp.concatenate([wrench.force_b, wrench.moment_b, rate.position, rate.alpha_lag[None]])

    points = [
        [V, a * DEG_RAD, b * DEG_RAD, 0.1, -0.2, 0.3, e * DEG_RAD, 0.1, -0.1, 0.2]
        for V in (0.0, 150.0)
        for a in (-20.0, 0.0, 17.3, 45.0, 90.0)
        for b in (-30.0, 0.0, 6.0)
        for e in (-25.0, 0.0, 25.0)
    ]
    slopes = jax.jit(jax.vmap(jax.jacfwd(sizes)))(jnp.array(points))
    assert bool(jnp.isfinite(slopes).all())


@pytest.mark.long
def test_batches_and_compiled_code_equal_single_evaluations():
    alphas, betas = np.linspace(-20, 90, 23), np.linspace(-30, 30, 23)
    together = table(AIRFRAME, alphas, betas, (4.0, -5.0, 6.0, 11.0), (0.2, 0.1, -0.3))
    for k in (0, 7, 22):
        c = AIRFRAME.coefficients(
            flow(alphas[k], betas[k]), jnp.array([0.2, 0.1, -0.3]), jnp.array([4.0, -5.0, 6.0, 11.0]) * DEG_RAD
        )
        np.testing.assert_allclose([getattr(c, name) for name in ROWS], together[k], atol=1e-13)
