"""Linear models of the airframe alone: exact derivatives of the equations of motion, in classical states.

Comparisons with printed matrices are checks of `anser verify`: see `tests/verification/test_linear_models.py`.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AircraftState, Controls
from anser.aircraft.actuators import Deflections
from anser.aircraft_files import load_airframe
from anser.analysis.linearization import coordinates_of, linearize, state_at
from anser.environment import Environment, LayeredWind, StandardAtmosphere, standard_environment, wgs84_earth
from support.light_aircraft import light_aircraft
from support.states import condition_of, derivative, make_state

pytestmark = pytest.mark.long


STILL = standard_environment()
F16 = load_airframe()
LIGHT = light_aircraft()
MASS = float(F16.mass_properties.mass)
GRAVITY = float(STILL.gravity)
BODY = ("V", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "altitude", "power")
SURFACES = ("elevator", "aileron", "rudder")


def layered(at_2500_n, per_metre):
    """Wind with a shear of the northward component between 2000 and 3000 m."""
    velocities = at_2500_n + per_metre * (np.array([[2000.0], [3000.0]]) - 2500.0) * np.array([1.0, 0.0, 0.0])
    wind = LayeredWind(jnp.array([2000.0, 3000.0]), jnp.asarray(velocities))
    return Environment(StandardAtmosphere(), wind, STILL.earth)


CALM = layered(np.zeros(3), 0.0)
"""Still air in the form of the sheared wind: a single compilation."""

_direct = eqx.filter_jit(jax.vmap(linearize, in_axes=(None, None, 0, 0)))
_with_actuators = eqx.filter_jit(lambda *arguments: linearize(*arguments, actuators=True))


def _as_float_arrays(tree):
    """Convert leaves to arrays of one type: a single compilation."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), tree)


def direct(airframe, environment, state, controls):
    """Linearize a fleet of one aircraft."""
    fleet = jax.tree.map(lambda leaf: leaf[None], (_as_float_arrays(state), _as_float_arrays(controls)))
    return jax.tree.map(lambda leaf: leaf[0], _direct(airframe, environment, *fleet))


def with_actuators(airframe, environment, state, controls):
    return _with_actuators(airframe, environment, _as_float_arrays(state), _as_float_arrays(controls))


def state_of(x) -> AircraftState:
    return make_state(x[0], x[1], x[2], tuple(x[3:6]), tuple(x[6:9]), tuple(x[11:14]), x[10], x[9])


def rates_by_theory(x, u):
    """Rates of the 14 states in still air by the scalar equations of theory section 2 and the Euler kinematics."""
    V, alpha, beta, phi, theta, _, P, Q, R = x[:9]
    state = state_of(x)
    rate = derivative(F16, STILL, 0.0, state, Controls(jnp.asarray(u[1:]), jnp.asarray(u[0])))
    X, Y, Z = np.asarray(condition_of(F16, STILL, 0.0, state).wrench.force_b) / MASS
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    gx, gy, gz = GRAVITY * np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    X, Y, Z = X + gx, Y + gy, Z + gz
    turn = Q * np.sin(phi) + R * np.cos(phi)
    return np.array(
        [
            X * ca * cb + Y * sb + Z * sa * cb,
            Q - np.tan(beta) * (P * ca + R * sa) + (Z * ca - X * sa) / (V * cb),
            P * sa - R * ca + (-X * ca * sb + Y * cb - Z * sa * sb) / V,
            P + np.tan(theta) * turn,
            Q * np.cos(phi) - R * np.sin(phi),
            turn / np.cos(theta),
            *np.asarray(rate.rates_b),
            -float(rate.position_n[2]),
            float(rate.power),
            *np.asarray(rate.surfaces),
        ]
    )


STEPS = np.array([1e-3, *[1e-6] * 8, 1e-1, 1e-4, *[1e-6] * 3])


def differenced(function, point, j, step):
    forward, backward = point.copy(), point.copy()
    forward[j] += step
    backward[j] -= step
    return (function(forward) - function(backward)) / (2 * step)


def test_derivatives_equal_differences_of_the_scalar_equations():
    """Random attitudes, turns and pull-ups: differentiation in the quaternion against differences of the Euler
    equations.

    The states are at least 1e-3 deg away from the breakpoints of the tables, where the derivative has two values.
    """
    random = np.random.default_rng(5)
    scale = np.array([0, 0, 0.3, 3.1, 1.2, 3.1, 0.8, 0.4, 0.3, 0, 0, 0.3, 0.3, 0.4])
    for V, alpha, altitude, power in ((110, 0.25, 500, 20), (160, 0.06, 3000, 70), (210, 0.03, 7000, 45)):
        x = random.uniform(-scale, scale)
        x[[0, 1, 9, 10]] = V, alpha, altitude, power
        u = np.array([0.3, *random.uniform(-0.3, 0.3, 3)])
        state = state_of(x)
        model = with_actuators(F16, STILL, state, Controls(jnp.asarray(u[1:]), jnp.asarray(u[0])))
        np.testing.assert_allclose(model.x, x, rtol=1e-13)
        np.testing.assert_allclose(model.x_dot, rates_by_theory(x, u), rtol=1e-12, atol=1e-11)
        # Rounding of 4e-13 over the step (1e-6 for angles), and 2e-6 of the derivative for the curvature.
        for j, step in enumerate(STEPS):
            difference = differenced(lambda at: rates_by_theory(at, u), x, j, step)  # noqa: B023 - called at once
            np.testing.assert_allclose(model.A[:, j], difference, rtol=2e-6, atol=4e-13 / step, err_msg=model.states[j])
        for j in range(4):
            difference = differenced(lambda at: rates_by_theory(x, at), u, j, 1e-6)  # noqa: B023 - called at once
            np.testing.assert_allclose(model.B[:, j], difference, rtol=2e-6, atol=4e-7, err_msg=model.inputs[j])


def test_a_model_has_names_and_outputs():
    state = make_state(power=40.0)
    model = with_actuators(F16, STILL, state, Controls(state.surfaces, jnp.asarray(0.5)))
    assert model.states == BODY + SURFACES
    assert model.inputs == ("throttle", *(f"{name}_command" for name in SURFACES))
    assert model.outputs == (*BODY, *SURFACES, "n_z", "gamma", "chi", "mu")
    np.testing.assert_array_equal(model.C[:14], np.eye(14))
    np.testing.assert_array_equal(model.D, 0.0)
    assert float(model.step) == 0.0
    outputs = dict(zip(model.outputs, np.asarray(model.y), strict=True))
    assert outputs["V"] == pytest.approx(160.0, rel=1e-14)
    assert outputs["power"] == 40.0
    force_b = condition_of(F16, STILL, 0.0, state).wrench.force_b
    assert outputs["n_z"] == pytest.approx(-float(force_b[2]) / (MASS * GRAVITY), rel=1e-12)
    # sin gamma = climb rate over airspeed; the climb rate is the rate of the tenth state
    assert np.sin(outputs["gamma"]) * 160.0 == pytest.approx(float(model.x_dot[9]), rel=1e-12)


def test_surfaces_act_directly_without_actuators():
    state = make_state(surfaces=(-0.05, 0.02, -0.03))
    controls = Controls(state.surfaces, jnp.asarray(0.4))
    model = direct(LIGHT, CALM, state, controls)
    assert model.states == BODY
    assert model.inputs == ("throttle", *SURFACES)

    def accelerations(surfaces):
        deflected = dataclasses.replace(state, actuators=Deflections(jnp.asarray(surfaces)))
        return np.asarray(derivative(LIGHT, CALM, 0.0, deflected, controls).rates_b)

    # Moments are linear in the surfaces: the only error is rounding, 1e-14 over 1e-3 rad.
    differences = [differenced(accelerations, np.asarray(state.surfaces), k, 1e-3) for k in range(3)]
    np.testing.assert_allclose(model.B[6:9, 1:], np.stack(differences, axis=1), rtol=1e-10, atol=1e-10)
    # The deflections are those of the controls, independent of the state's.
    elsewhere = dataclasses.replace(state, actuators=Deflections(jnp.zeros(3)))
    for leaf, expected in zip(
        jax.tree.leaves(direct(LIGHT, CALM, elsewhere, controls)), jax.tree.leaves(model), strict=True
    ):
        np.testing.assert_array_equal(leaf, expected)


def test_state_and_coordinates_are_inverse_in_wind():
    environment = standard_environment(wind_n=jnp.array([12.0, -20.0, 1.0]))
    state = make_state(euler=(2.5, -0.7, -3.0), beta=-0.3)
    coordinates = coordinates_of(environment, state)
    restored = state_at(environment, coordinates, state)
    for a, b in zip(jax.tree.leaves(restored), jax.tree.leaves(state), strict=True):
        # The quaternion's sign follows the angles here and the components there: both are the same attitude.
        sign = np.sign(np.dot(np.ravel(a), np.ravel(b))) if a.shape == (4,) else 1.0
        np.testing.assert_allclose(sign * a, b, rtol=1e-13, atol=1e-13)


def test_steady_wind_has_no_effect_and_shear_has_the_predicted_effect():
    state = make_state(160.0, 0.1, 0.0, (0.0, 0.3, 0.0), (0.0, 0.0, 0.0), altitude=2500.0)
    controls = Controls(state.surfaces, jnp.asarray(0.4))

    def in_wind(at_2500_n, per_metre):
        environment = layered(at_2500_n, per_metre)
        moving = state_at(environment, coordinates_of(STILL, state), state)
        return direct(LIGHT, environment, moving, controls)

    still = direct(LIGHT, CALM, state, controls)
    np.testing.assert_allclose(still.x, coordinates_of(STILL, state)[:11], rtol=1e-15)
    steady = in_wind(np.array([15.0, 5.0, 0.0]), 0.0)
    for name in ("A", "B", "C", "D", "x", "x_dot"):
        np.testing.assert_allclose(getattr(steady, name), getattr(still, name), rtol=1e-9, atol=1e-11, err_msg=name)
    # A tailwind that grows by s with altitude takes s V sin(gamma) from the northward airspeed: its part along the path
    # is lost to V, d(V_dot)/dV = -s sin(gamma) cos(gamma).
    s, gamma = 0.02, 0.2
    growing = in_wind(np.array([15.0, 5.0, 0.0]), s)
    lost = -s * np.sin(gamma) * np.cos(gamma)
    assert float(growing.x_dot[0] - still.x_dot[0]) == pytest.approx(160.0 * lost, rel=1e-9)
    assert float(growing.A[0, 0] - still.A[0, 0]) == pytest.approx(lost, rel=1e-9)


@pytest.mark.parametrize("pitch_deg", [89.5, -89.5])
def test_near_the_vertical_the_coordinates_are_flagged(pitch_deg):
    upright = make_state(alpha=0.0, euler=(0.0, np.deg2rad(60.0), 0.0))
    vertical = make_state(alpha=0.0, euler=(0.0, np.deg2rad(pitch_deg), 0.0))
    controls = Controls(upright.surfaces, jnp.asarray(0.4))
    assert direct(LIGHT, CALM, upright, controls).regular
    flagged = direct(LIGHT, CALM, vertical, controls)
    assert not flagged.regular
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(flagged))


def test_a_round_earth_is_refused():
    state = make_state()
    round_earth = standard_environment(earth=wgs84_earth(0.6, 0.3))
    with pytest.raises(TypeError, match="RotatingEarth; expected a FlatEarth"):
        linearize(F16, round_earth, state, Controls(state.surfaces, jnp.asarray(0.4)))


@pytest.mark.parametrize("V", [50.0, 60.0])
def test_any_airframe(V):
    """Entries of the light aircraft's matrices that its constant derivatives give by hand."""
    altitude = 500.0
    state = make_state(V, 0.03, 0.0, (0.2, 0.05, 1.0), altitude=altitude)
    model = direct(LIGHT, CALM, state, Controls(state.surfaces, jnp.asarray(0.4)))
    index = {name: k for k, name in enumerate(model.states)}
    qbar = 0.5 * float(STILL.atmosphere.at(altitude).density) * V**2
    S, b, J = float(LIGHT.wing_area), float(LIGHT.span), np.diag(LIGHT.mass_properties.inertia_b)
    expected = {
        ("P", "P"): -0.410 * qbar * S * b**2 / (2 * V * J[0]),
        ("R", "beta"): 0.071 * qbar * S * b / J[2],
        ("power", "power"): -1 / 0.8,
    }
    for (row_state, column_state), value in expected.items():
        assert float(model.A[index[row_state], index[column_state]]) == pytest.approx(value, rel=1e-12)
    elevator = -0.923 * qbar * S * float(LIGHT.mean_chord) / J[1]
    assert float(model.B[index["Q"], 1]) == pytest.approx(elevator, rel=1e-12)
    assert float(model.B[index["power"], 0]) == pytest.approx(100 / 0.8, rel=1e-12)
