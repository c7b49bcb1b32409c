"""Motion of the rigid body: conservation laws, a second formulation of the same mechanics, wind (theory section 2)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft.motion import angular_acceleration, flat_earth_derivative, moment_for_acceleration
from anser.aircraft_files import load_airframe
from anser.environment import AbstractAtmosphere, Air, Environment, FlatEarth, SteadyWind, standard_environment
from anser.numerics import rk4_step
from anser.shapes import ScalarLike
from anser.spatial import flow_angles, path_angles, rotation_from_quaternion
from anser.spatial.rotations import rotate, rotate_back
from anser.spatial.wind_axes import bank_about_velocity
from support.light_aircraft import light_aircraft
from support.states import condition_of, derivative, make_controls, make_state, states

F16 = load_airframe()
STILL = standard_environment()
CONTROLS = make_controls()


class Vacuum(AbstractAtmosphere):
    """No air: only gravity and thrust act."""

    def at(self, altitude: ScalarLike) -> Air:
        unity = jnp.ones_like(jnp.asarray(altitude))
        return Air(density=0 * unity, pressure=0 * unity, temperature=200 * unity, speed_of_sound=300 * unity)


SPACE = Environment(atmosphere=Vacuum(), wind=SteadyWind(jnp.zeros(3)), earth=FlatEarth(jnp.asarray(9.8)))


def _angular_momentum_n(state):
    properties = F16.mass_properties
    momentum_b = properties.inertia_b @ state.rates_b + properties.spin_momentum_b
    return rotate_back(rotation_from_quaternion(state.quaternion), momentum_b)


def test_torque_free_rotation_conserves_angular_momentum_and_energy():
    # Thrust acts through the centre of gravity; the spinning engine only couples the axes. A tumble with all three
    # rates, two turns: momentum in NED, rotational energy and the quaternion's length are integrals of the motion.
    start = make_state(rates=(2.0, 0.6, -0.9))

    @jax.jit
    def tumble(state):
        def f(t, y):
            return flat_earth_derivative(F16, SPACE, t, y, CONTROLS)

        return jax.lax.scan(lambda y, _: (rk4_step(f, 0.0, y, 0.005),) * 2, state, length=2000)[1]

    path = tumble(start)
    J = F16.mass_properties.inertia_b
    momentum = jax.vmap(_angular_momentum_n)(path)
    energy = 0.5 * jnp.einsum("ti,ij,tj->t", path.rates_b, J, path.rates_b)
    assert float(jnp.ptp(path.rates_b[:, 1])) > 0.5  # it does tumble
    # Runge-Kutta's global error at a step of 0.01 rad: (0.01)^4 times 20 rad, 2e-7 at worst.
    initial = _angular_momentum_n(start)
    np.testing.assert_allclose(momentum, np.tile(initial, (2000, 1)), atol=2e-7 * float(jnp.linalg.norm(initial)))
    np.testing.assert_allclose(energy, energy[0], rtol=2e-7)
    np.testing.assert_allclose(jnp.linalg.norm(path.quaternion, axis=1), 1.0, atol=2e-7)


def test_free_fall_accelerates_by_gravity_only():
    state = make_state(power=0.0)
    thrust_b = F16.engine.propulsion(0.0, condition_of(F16, SPACE, 0.0, state).air_data).force_b
    rate = derivative(F16, SPACE, 0.0, state, CONTROLS)
    R_bn = rotation_from_quaternion(state.quaternion)
    spin = jnp.cross(state.rates_b, state.velocity_b)
    acceleration_n = rotate_back(R_bn, rate.velocity_b + spin - thrust_b / F16.mass_properties.mass)
    np.testing.assert_allclose(acceleration_n, [0.0, 0.0, 9.8], atol=1e-12)


def _wind_axis_rates(F, g, m, V, alpha, beta, mu, gamma, P, Q, R):
    """Theory section 2, word for word: V_dot, alpha_dot, beta_dot, mu_dot, gamma_dot, chi_dot."""
    sa, ca, sb, cb, tb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta), np.tan(beta)
    s_mu, c_mu, s_gam, c_gam, t_gam = np.sin(mu), np.cos(mu), np.sin(gamma), np.cos(gamma), np.tan(gamma)
    F_X, F_Y, F_Z = F
    return [
        (F_X * ca * cb + F_Y * sb + F_Z * sa * cb) / m - g * s_gam,
        Q - tb * (P * ca + R * sa) + (F_Z * ca - F_X * sa) / (m * V * cb) + g * c_gam * c_mu / (V * cb),
        P * sa - R * ca + (-F_X * ca * sb + F_Y * cb - F_Z * sa * sb) / (m * V) + g * c_gam * s_mu / V,
        (P * ca + R * sa) / cb
        - g / V * c_gam * c_mu * tb
        + (
            F_X * (sa * tb + sa * s_mu * t_gam - ca * sb * c_mu * t_gam)
            + F_Y * cb * c_mu * t_gam
            - F_Z * (ca * tb + ca * s_mu * t_gam + sa * sb * c_mu * t_gam)
        )
        / (m * V),
        (F_X * (sa * c_mu + ca * sb * s_mu) - F_Y * cb * s_mu - F_Z * (ca * c_mu - sa * sb * s_mu)) / (m * V)
        - g * c_gam / V,
        (F_X * (sa * s_mu - ca * sb * c_mu) + F_Y * cb * c_mu - F_Z * (ca * s_mu + sa * sb * c_mu)) / (m * V * c_gam),
    ]


@jax.jit
def _flight_angles_and_rates(state, rate):
    """V, alpha, beta, mu, gamma, chi of a state in still air, and the rates by the chain rule."""

    def angles(state):
        R_bn = rotation_from_quaternion(state.quaternion)
        V, alpha, beta = flow_angles(state.velocity_b)
        gamma, chi = path_angles(rotate_back(R_bn, state.velocity_b))
        return jnp.stack([V, alpha, beta, bank_about_velocity(R_bn, alpha, beta), gamma, chi])

    return jax.jvp(angles, (state,), (rate,))


@settings(deadline=None, max_examples=30)
@given(state=states)
def test_body_axes_and_wind_axes_agree(state):
    # Two formulations of one mechanics; they share the forces only.
    rate = derivative(F16, STILL, 0.0, state, CONTROLS)
    (V, alpha, beta, mu, gamma, _), rates = _flight_angles_and_rates(state, rate)
    force_b = np.asarray(condition_of(F16, STILL, 0.0, state).wrench.force_b)
    expected = _wind_axis_rates(
        force_b, float(STILL.gravity), float(F16.mass_properties.mass), V, alpha, beta, mu, gamma, *state.rates_b
    )
    # Rounding: rates of up to 100 m/s^2 and 10 rad/s; near the vertical tan(gamma) and 1/cos(gamma) magnify it.
    np.testing.assert_allclose(rates, expected, atol=1e-10 * (1 + abs(np.tan(gamma)) ** 2), rtol=1e-9)


@settings(deadline=None, max_examples=30)
@given(state=states)
def test_kinetic_energy_grows_by_the_power_of_the_forces(state):
    rate = derivative(F16, STILL, 0.0, state, CONTROLS)
    wrench = condition_of(F16, STILL, 0.0, state).wrench
    properties = F16.mass_properties
    growth = properties.mass * state.velocity_b @ rate.velocity_b + state.rates_b @ properties.inertia_b @ rate.rates_b
    weight_b = rotate(rotation_from_quaternion(state.quaternion), jnp.array([0.0, 0.0, 1.0]))
    weight_b = weight_b * properties.mass * STILL.gravity
    power = (wrench.force_b + weight_b) @ state.velocity_b + wrench.moment_b @ state.rates_b
    # 1e7 W at 1e-16 each, several hundred operations.
    np.testing.assert_allclose(growth, power, rtol=1e-9, atol=1e-3)


@settings(deadline=None, max_examples=30)
@given(
    rates=st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    acceleration=st.lists(st.floats(-10, 10), min_size=3, max_size=3),
)
def test_the_moment_for_an_acceleration_is_the_inverse(rates, acceleration):
    rates_b, required = jnp.array(rates), jnp.array(acceleration)
    moment_b = moment_for_acceleration(F16.mass_properties, rates_b, required)
    np.testing.assert_allclose(angular_acceleration(F16.mass_properties, rates_b, moment_b), required, atol=1e-12)


@settings(deadline=None, max_examples=20)
@given(state=states, wind=st.tuples(st.floats(-30, 30), st.floats(-30, 30), st.floats(-5, 5)))
def test_a_steady_wind_only_translates_the_aircraft(state, wind):
    # The same motion through the air: accelerations equal in NED, ground speed larger by the wind.
    wind_n = jnp.array(wind)
    R_bn = rotation_from_quaternion(state.quaternion)
    carried = eqx.tree_at(lambda s: s.velocity_b, state, state.velocity_b + rotate(R_bn, wind_n))
    still = derivative(F16, STILL, 0.0, state, CONTROLS)
    windy = derivative(F16, standard_environment(wind_n=wind_n), 0.0, carried, CONTROLS)
    np.testing.assert_allclose(windy.position_n, still.position_n + wind_n, atol=1e-11)
    np.testing.assert_allclose(windy.rates_b, still.rates_b, atol=1e-9)
    shift_b = -jnp.cross(state.rates_b, rotate(R_bn, wind_n))
    np.testing.assert_allclose(windy.velocity_b, still.velocity_b + shift_b, atol=1e-10)


def test_air_data_and_forces_are_those_of_the_state():
    state = make_state(beta=0.05)
    condition = condition_of(F16, STILL, 0.0, state)
    np.testing.assert_allclose(condition.air_data.V, 160.0, rtol=1e-14)
    np.testing.assert_allclose([condition.air_data.alpha, condition.air_data.beta], [0.1, 0.05], rtol=1e-13)
    np.testing.assert_allclose(condition.wrench.force_b, condition.aerodynamic.force_b + condition.propulsive.force_b)
    np.testing.assert_allclose(
        condition.wrench.moment_b, condition.aerodynamic.moment_b + condition.propulsive.moment_b
    )


@pytest.mark.long
@pytest.mark.parametrize("airframe", [F16, light_aircraft()], ids=["f16", "light"])
def test_gradients_are_finite_on_the_symmetry_plane_and_at_nodes(airframe):
    # Straight level flight at beta = 0, alpha and elevator on nodes, surfaces at their command: every kink at once.
    state = make_state(alpha=0.0, euler=(0, 0, 0), rates=(0, 0, 0), surfaces=(0, 0, 0), power=50.0, altitude=3048.0)
    controls = make_controls((0.0, 0.0, 0.0), 0.77)

    def total(arguments):
        airframe, environment, state, controls = arguments
        rate = flat_earth_derivative(airframe, environment, 0.0, state, controls)
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(rate))

    gradient = eqx.filter_jit(eqx.filter_grad(total))((airframe, STILL, state, controls))
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    assert all(jnp.any(leaf != 0) for leaf in (gradient[2].velocity_b, gradient[2].surfaces, gradient[3].surfaces))


@pytest.mark.long
def test_batches_equal_single_evaluations():
    fleet = [make_state(V=V, beta=beta) for V, beta in ((90.0, 0.1), (160.0, 0.0), (240.0, -0.2))]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *fleet)
    batch_rates = jax.jit(jax.vmap(flat_earth_derivative, in_axes=(None, None, None, 0, None)))(
        F16, STILL, 0.0, batch, CONTROLS
    )
    for k, state in enumerate(fleet):
        single = derivative(F16, STILL, 0.0, state, CONTROLS)
        for a, b in zip(jax.tree.leaves(batch_rates), jax.tree.leaves(single), strict=True):
            np.testing.assert_allclose(a[k], b, rtol=1e-12, atol=1e-12)


def test_compiled_code_equals_plain_evaluation():
    airframe, state = light_aircraft(), make_state()
    plain = flat_earth_derivative(airframe, STILL, 0.0, state, CONTROLS)
    compiled = derivative(airframe, STILL, 0.0, state, CONTROLS)
    for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(compiled), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
