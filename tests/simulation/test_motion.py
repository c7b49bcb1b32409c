"""One step of one aircraft with constant controls: order, an independent integrator, wind, JAX."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import Controls
from anser.aircraft.motion import flat_earth_derivative
from anser.aircraft_files import load_airframe
from anser.environment import standard_environment
from anser.simulation.vehicle import advance
from anser.spatial import rotation_from_quaternion
from anser.spatial.rotations import rotate
from support.light_aircraft import light_aircraft
from support.states import make_controls, make_state
from support.trims import SAMPLES, fly, target_deg, trim

STILL = standard_environment()
F16, LIGHT = load_airframe(), light_aircraft()


def _doublet(point, elevator, aileron):
    """Controls of a trim with elevator and aileron pulled, pushed, released: one second each, then eight seconds."""
    hold = point.controls.surfaces
    deflection = jnp.array([elevator, aileron, 0.0])
    return [Controls(hold + sign * deflection, point.controls.throttle) for sign in (1, -1, 0)], (1.0, 1.0, 8.0)


def _last(path):
    return jax.tree.map(lambda leaf: leaf[-1], path)


def _fly_doublet(airframe, environment, state, doublet, step):
    for controls, duration in zip(*doublet, strict=True):
        state = _last(fly(airframe, environment, state, controls, step, round(duration / SAMPLES / step)))
    return state


@jax.jit
def _adaptive(airframe, environment, state, controls, duration):
    """Dormand-Prince 8(7), error per step below 1e-11: an independent code and method."""
    term = diffrax.ODETerm(lambda t, y, _: flat_earth_derivative(airframe, environment, t, y, controls))
    solution = diffrax.diffeqsolve(
        term,
        diffrax.Dopri8(),
        0.0,
        duration,
        0.01,
        state,
        stepsize_controller=diffrax.PIDController(rtol=1e-11, atol=1e-11, dtmax=0.05),
        saveat=diffrax.SaveAt(t1=True),
        max_steps=20_000,
    )
    return _last(solution.ys)


def _adaptive_doublet(airframe, environment, state, doublet):
    for controls, duration in zip(*doublet, strict=True):
        state = _adaptive(airframe, environment, state, controls, duration)
    return state


def _assert_close(actual, expected, position, velocity, angle):
    """Compare states within tolerances in m, m/s, and rad (attitude, rates, surfaces)."""
    np.testing.assert_allclose(actual.position_n, expected.position_n, atol=position)
    np.testing.assert_allclose(actual.velocity_b, expected.velocity_b, atol=velocity)
    for name in ("quaternion", "rates_b", "surfaces"):
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), atol=angle, err_msg=name)


@pytest.fixture(scope="module")
def f16_case():
    point = trim(F16, STILL, target_deg(170.0, 2000.0, 2.0, 30.0, 2.0))
    return point, _doublet(point, 0.03, 0.02)


def test_the_f16_agrees_with_an_adaptive_integrator(f16_case):
    point, doublet = f16_case
    reference = _adaptive_doublet(F16, STILL, point.state, doublet)
    stepped, finer = (_fly_doublet(F16, STILL, point.state, doublet, step) for step in (0.01, 0.0025))
    # The kinks of the tables leave order two of four: 5 mm and 2e-6 rad after 1.7 km, a tenth at a quarter of the step.
    _assert_close(stepped, reference, position=1e-2, velocity=2e-3, angle=5e-6)
    _assert_close(finer, reference, position=1e-3, velocity=2e-4, angle=5e-7)
    np.testing.assert_allclose(stepped.power, reference.power, atol=1e-6)
    # The doublet was one: the place is not that of the trim continued.
    constant = _last(fly(F16, STILL, point.state, point.controls, 0.01, 100))
    assert float(jnp.linalg.norm(constant.position_n - stepped.position_n)) > 10.0


@pytest.mark.long
def test_a_smooth_airframe_agrees_with_an_adaptive_integrator_at_fourth_order():
    # The light aircraft's model has no kinks, and the doublet keeps its actuators off their limits.
    point = trim(LIGHT, STILL, target_deg(55.0, 1000.0, 0.0, 30.0, 2.0))
    doublet = _doublet(point, 0.02, 0.02)
    reference = _adaptive_doublet(LIGHT, STILL, point.state, doublet)
    flights = [_fly_doublet(LIGHT, STILL, point.state, doublet, step) for step in (0.025, 0.0125, 0.00625)]
    errors = np.array(
        [float(jnp.linalg.norm(final_state.position_n - reference.position_n)) for final_state in flights]
    )
    # The next order still shows at the largest step, where it adds 0.14.
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 4.0, atol=0.25)
    # 7e-9 m expected; the reference itself is good to 2e-11 m.
    _assert_close(flights[-1], reference, position=2e-8, velocity=2e-9, angle=1e-10)


def test_the_quaternion_keeps_its_length(f16_case):
    point, _ = f16_case
    path = fly(F16, STILL, point.state, make_controls((0.0, 0.3, 0.1)), 0.01, 50)
    assert float(jnp.max(jnp.abs(path.rates_b))) > 0.5
    np.testing.assert_allclose(jnp.linalg.norm(path.quaternion, axis=1), 1.0, atol=1e-15)


def test_steady_wind_shifts_the_flight_exactly(f16_case):
    # Galileo: the same flight through the air, carried along; rounding only. Level wind: air that moves up carries the
    # aircraft into other air.
    point, doublet = f16_case
    wind_n = jnp.array([15.0, -25.0, 0.0])
    windy = standard_environment(wind_n=wind_n)
    velocity_b = point.state.velocity_b + rotate(rotation_from_quaternion(point.state.quaternion), wind_n)
    start = eqx.tree_at(lambda s: s.velocity_b, point.state, velocity_b)
    still = _fly_doublet(F16, STILL, point.state, doublet, 0.01)
    carried = _fly_doublet(F16, windy, start, doublet, 0.01)
    np.testing.assert_allclose(carried.position_n, still.position_n + 10.0 * wind_n, atol=1e-7)
    np.testing.assert_allclose(carried.quaternion, still.quaternion, atol=1e-10)
    np.testing.assert_allclose(carried.rates_b, still.rates_b, atol=1e-10)


def test_surfaces_stop_at_their_limits_in_flight(f16_case):
    point, _ = f16_case
    path = fly(F16, STILL, point.state, make_controls((1.0, -1.0, 1.0)), 0.01, 10)
    np.testing.assert_allclose(
        _last(path).surfaces, F16.actuators.limit_command(jnp.array([1.0, -1.0, 1.0])), atol=1e-4
    )
    assert (np.abs(path.surfaces) <= np.asarray(F16.actuators.upper) + 1e-15).all()


def test_gradient_through_flight_equals_difference_quotient():
    # Smooth airframe: the central difference is good to its curvature times 1e-4 squared.
    state = make_state(V=55.0, alpha=0.02, beta=0.01, surfaces=(0.0, 0.0, 0.0))

    def altitude_after(elevator):
        controls = Controls(jnp.zeros(3).at[0].set(elevator), jnp.asarray(0.5))
        flown, _ = jax.lax.scan(lambda s, _: (advance(LIGHT, STILL, 0.0, s, controls, 0.02), None), state, length=50)
        return -flown.position_n[2]

    # Forward: half the compile time; the reverse pass through the equations of motion is tested with the rigid body.
    altitude_and_slope = jax.jit(lambda elevator: jax.jvp(altitude_after, (elevator,), (1.0,)))
    h = 1e-4
    expected = (altitude_and_slope(0.01 + h)[0] - altitude_and_slope(0.01 - h)[0]) / (2 * h)
    np.testing.assert_allclose(altitude_and_slope(0.01)[1], expected, rtol=1e-6)


@pytest.mark.long
def test_a_batch_equals_single_steps():
    fleet = [make_state(V=V, beta=beta) for V, beta in ((50.0, 0.1), (70.0, -0.05))]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *fleet)
    controls = make_controls((0.0, 0.02, 0.0))
    advanced = jax.jit(jax.vmap(advance, in_axes=(None, None, None, 0, None, None)))(
        LIGHT, STILL, 0.0, batch, controls, 0.01
    )
    for k, state in enumerate(fleet):
        single = jax.tree.map(lambda leaf: leaf[0], fly(LIGHT, STILL, state, controls, 0.01, 1))
        for a, b in zip(jax.tree.leaves(advanced), jax.tree.leaves(single), strict=True):
            np.testing.assert_allclose(a[k], b, rtol=1e-12, atol=1e-12)
