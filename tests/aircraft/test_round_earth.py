"""Motion over the round Earth: invariants, a second formulation, the flat Earth as its limit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from anser.aircraft import air_data_and_forces, motion_derivative
from anser.aircraft.motion import (
    earth_fixed_derivative,
    earth_fixed_state,
    local_state,
    to_local_state,
    to_motion_state,
)
from anser.aircraft_files import load_airframe, load_body
from anser.environment import FlatEarth, standard_environment, wgs84_earth
from anser.environment.earth import spherical_earth
from anser.numerics import rk4_step
from anser.numerics.linear import cross
from anser.spatial import rotation_from_quaternion
from anser.spatial.frames import eci_from_ecef, rotation_ecef_from_eci, velocity_eci_from_ecef
from anser.spatial.rotations import quaternion_derivative, rotate, rotate_back
from support.states import derivative, make_controls, make_state, states

generic = settings(deadline=None, max_examples=20)
EARTH = wgs84_earth(0.6, -2.0)
ROUND = standard_environment(earth=EARTH)
F16 = load_airframe("f16")
CONTROLS = make_controls()

_derivative = jax.jit(earth_fixed_derivative)
_to, _from = jax.jit(earth_fixed_state), jax.jit(local_state)


@generic
@given(states)
def test_the_round_trip_between_local_and_earth_fixed_states_is_exact(state):
    back = _from(EARTH, _to(EARTH, state))
    np.testing.assert_allclose(back.position_n, state.position_n, atol=2e-8)  # rounding of 6.4e6 m, twice
    np.testing.assert_allclose(back.rates_b, state.rates_b, atol=1e-15)
    turn = abs(np.sum(np.asarray(back.quaternion) * np.asarray(state.quaternion)))
    assert turn == pytest.approx(1.0, abs=1e-14)
    for name in ("velocity_b", "surfaces", "power"):
        np.testing.assert_array_equal(getattr(back, name), getattr(state, name))


@jax.jit
def _in_travelling_axes(state):
    """The same motion in local NED axes: [SL] eq. 1.7-18 with axes that travel with the aircraft."""
    condition = air_data_and_forces(F16, ROUND, 0.0, state)
    force = condition.wrench.force_b / F16.mass_properties.mass
    return (
        condition.earth.chart_scale * rotate_back(condition.R_bn, state.velocity_b),
        force + rotate(condition.R_bn, condition.earth.apparent_gravity_n) - cross(state.rates_b, state.velocity_b),
        quaternion_derivative(state.quaternion, state.rates_b),
    )


@jax.jit
def _seen_derivative(state):
    moving = earth_fixed_state(EARTH, state)
    rate = earth_fixed_derivative(F16, ROUND, 0.0, moving, CONTROLS)
    return jax.jvp(lambda y: local_state(EARTH, y), (moving,), (rate,))[1]


@generic
@given(states)
def test_two_formulations_agree(state):
    """Earth-fixed motion, transformed to local axes by the chain rule, equals the motion in local axes."""
    local_rate = _seen_derivative(state)
    expected = _in_travelling_axes(state)
    # Through the derivative of a rotation: 6.4e6 m times 1e-16 over the arm of the velocity.
    for rate, expected_rate, rounding in zip(
        (local_rate.position_n, local_rate.velocity_b, local_rate.quaternion),
        expected,
        (1e-10, 1e-10, 1e-12),
        strict=True,
    ):
        same = expected_rate.shape == (3,) or np.asarray(_seen_sign(state)) @ np.asarray(state.quaternion) > 0.0
        np.testing.assert_allclose(np.asarray(rate) * (1.0 if same else -1.0), expected_rate, atol=rounding)


@jax.jit
def _seen_sign(state):
    return local_state(EARTH, earth_fixed_state(EARTH, state)).quaternion


@jax.jit
def _tumble(environment, start, body):
    """Free flight of 30 s without air forces; start and end."""

    def one(y, _):
        return rk4_step(lambda t, x: earth_fixed_derivative(body, environment, t, x, CONTROLS), 0.0, y, 0.01), None

    return jax.lax.scan(one, start, length=3000)[0]


def test_energy_and_momenta_without_air_forces_are_conserved():
    """Energy, the orbit's polar angular momentum and the tumbling's inertial angular momentum are conserved."""
    earth, body = EARTH, load_body("undamped-brick")
    start = _to(earth, make_state(V=300.0, rates=(0.2, 0.5, 0.3), altitude=9000.0))
    end = _tumble(ROUND, start, body)
    J = body.mass_properties.inertia_b

    def conserved(state, time):
        position_i = eci_from_ecef(state.position_e, time, 0.0)
        R_be = rotation_from_quaternion(state.quaternion)
        velocity_i = velocity_eci_from_ecef(state.position_e, rotate_back(R_be, state.velocity_b), time, 0.0)
        r = jnp.linalg.norm(position_i)
        gm, j2, a = earth.gravitational_parameter, earth.oblateness_j2, earth.ellipsoid.a
        potential = gm / r * (1 - j2 * (a / r) ** 2 * 0.5 * (3 * (position_i[2] / r) ** 2 - 1))
        spin_i = rotate_back(rotation_ecef_from_eci(time, 0.0), rotate_back(R_be, J @ state.rates_b))
        energy = 0.5 * jnp.sum(velocity_i**2) - potential
        polar = jnp.cross(position_i, velocity_i)[2]
        return jnp.stack([energy, polar, *spin_i, jnp.linalg.norm(state.quaternion)])

    compiled = jax.jit(conserved)
    initial, final = compiled(start, 0.0), compiled(end, 30.0)
    # 3000 steps that each round by 1e-16 of 6e7 J/kg and 2e9 m^2/s; a spin error of the fourth order of 0.6 rad/s * 0.01 s.
    np.testing.assert_allclose(final, initial, rtol=1e-10)
    assert float(jnp.linalg.norm(end.position_e - start.position_e)) > 5000.0


def test_a_huge_sphere_at_rest_is_flat():
    """With R to infinity and GM = g R^2 the derivative is that of the flat Earth, up to terms of order 1/R."""
    g, radius = 9.81, 1e13
    sphere = eqx.tree_at(
        lambda e: e.gravitational_parameter, spherical_earth(radius, 0.3, 0.4), jnp.asarray(g * radius**2)
    )
    state = make_state(altitude=3000.0)
    flat = derivative(F16, standard_environment(earth=FlatEarth(jnp.asarray(g))), 0.0, state, CONTROLS)
    curved = _derivative(F16, standard_environment(earth=sphere), 0.0, _to(sphere, state), CONTROLS)
    # The altitude of the state itself is known to 1e-3 m at this radius: density changes by 1e-7.
    np.testing.assert_allclose(curved.velocity_b, flat.velocity_b, atol=1e-4)
    np.testing.assert_allclose(curved.rates_b, flat.rates_b, atol=1e-4)


def test_the_motion_state_depends_on_the_class_of_earth():
    state = make_state()
    assert to_motion_state(standard_environment(), state) is state
    assert to_local_state(standard_environment(), state) is state
    moving = jax.jit(to_motion_state)(ROUND, state)
    rate = jax.jit(motion_derivative)(F16, ROUND, 0.0, moving, CONTROLS)
    np.testing.assert_allclose(rate.velocity_b, _derivative(F16, ROUND, 0.0, moving, CONTROLS).velocity_b, rtol=1e-13)
    with pytest.raises(TypeError, match="RotatingEarth, not a FlatEarth"):
        earth_fixed_derivative(F16, standard_environment(), 0.0, moving, CONTROLS)


@pytest.mark.long
def test_results_support_gradients_and_batches():
    moving = _to(EARTH, make_state())

    def total(y):
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(earth_fixed_derivative(F16, ROUND, 0.0, y, CONTROLS)))

    for leaf in jax.tree.leaves(jax.jit(jax.grad(total))(moving)):
        assert np.all(np.isfinite(leaf))
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), moving)
    batch_rates = jax.jit(jax.vmap(earth_fixed_derivative, in_axes=(None, None, None, 0, None)))(
        F16, ROUND, 0.0, batch, CONTROLS
    )
    single = _derivative(F16, ROUND, 0.0, moving, CONTROLS)
    for a, b in zip(jax.tree.leaves(batch_rates), jax.tree.leaves(single), strict=True):
        np.testing.assert_allclose(a[0], b, rtol=1e-12, atol=1e-12)


def test_the_motion_at_the_pole_is_regular():
    """Motion through the pole: the Earth-fixed state and derivative are finite although north is undefined."""
    earth = wgs84_earth(89.9 * np.pi / 180, 0.0)
    environment = standard_environment(earth=earth)
    moving = _to(earth, make_state())
    at_pole = eqx.tree_at(lambda y: y.position_e, moving, jnp.array([0.5, 0.2, 6356752.3 + 3000.0]))
    rate = _derivative(F16, environment, 0.0, at_pole, CONTROLS)
    for leaf in (rate.position_e, rate.velocity_b, rate.quaternion):
        assert np.all(np.isfinite(leaf))
