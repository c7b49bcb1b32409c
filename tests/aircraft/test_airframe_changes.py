"""Changed airframes: against the dispersions of each airframe class, and the change in force by time."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import air_data_and_forces
from anser.aircraft.changes import AirframeChange, AirframeChanges, changed_airframe
from anser.aircraft_files.build import build_changes, disperse_airframe
from anser.aircraft_files.deviations import Deviation, SurfaceEffectiveness
from anser.aircraft_files.library import load_airframe, load_body
from anser.config import ScenarioError
from anser.environment import standard_environment
from support.states import make_state

AIRFRAMES = ("f16", "aerosonde", pytest.param("nasa-f16", marks=pytest.mark.long))


SURFACES = jnp.array([-0.1, 0.05, -0.04])
STATE = make_state(V=60.0, alpha=0.08, beta=0.03)
AIR = standard_environment()


def wrench_by_operations(airframe):
    state = eqx.tree_at(lambda s: s.actuators, STATE, airframe.actuators.steady_state(SURFACES))
    state = eqx.tree_at(lambda s: s.engine, state, airframe.engine.steady_state(jnp.asarray(40.0)))
    condition = air_data_and_forces(airframe, AIR, 0.0, state)
    return condition.wrench, condition.air_data


wrench = eqx.filter_jit(wrench_by_operations)


def changes(airframe, *deviations):
    return build_changes(airframe, list(deviations), "test")


def changed(airframe, **keys):
    return changed_airframe(airframe, changes(airframe, (0.0, Deviation(**keys))).at(0.0))


@pytest.mark.parametrize("name", AIRFRAMES)
def test_a_shift_of_the_centre_of_gravity_equals_that_of_the_airframe_s_own_data(name):
    """The wrapper transfers the force; each class moves the reference point of its own coefficients."""
    airframe = load_airframe(name)
    deviation = Deviation(cg_shift=0.05, mass=1.1, second_moment_x=1.2, actuator_bandwidth=0.7)
    by_data = disperse_airframe(airframe, deviation)
    wrapped = changed(airframe, cg_shift=0.05, mass=1.1, second_moment_x=1.2, actuator_bandwidth=0.7)
    (expected, _), (obtained, _) = wrench(by_data), wrench(wrapped)
    np.testing.assert_allclose(obtained.force_b, expected.force_b, rtol=1e-12, atol=1e-9)
    scale = np.abs(np.asarray(expected.moment_b)).max()
    np.testing.assert_allclose(obtained.moment_b, expected.moment_b, rtol=0, atol=1e-12 * scale)
    for a, b in zip(
        jax.tree.leaves((wrapped.mass_properties, wrapped.actuators)),
        jax.tree.leaves((by_data.mass_properties, by_data.actuators)),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, rtol=1e-14)


@pytest.mark.parametrize("name", AIRFRAMES)
def test_drag_and_lift_are_multiplied_and_moments_stay(name):
    airframe = load_airframe(name)
    nominal, data = wrench(airframe)
    iced, _ = wrench(changed(airframe, drag=1.2, lift_slope=0.9))
    thrust_b = np.asarray(airframe.engine.propulsion(40.0, data).force_b)
    sine, cosine = np.sin(float(data.alpha)), np.cos(float(data.alpha))

    def drag_and_lift(force_b):
        x, _, z = np.asarray(force_b) - thrust_b
        return np.array([-(x * cosine + z * sine), x * sine - z * cosine])

    np.testing.assert_allclose(
        drag_and_lift(iced.force_b), np.array([1.2, 0.9]) * drag_and_lift(nominal.force_b), rtol=1e-11
    )
    np.testing.assert_allclose(iced.force_b[1], nominal.force_b[1], rtol=1e-14)
    # two programs: their last digits can differ
    np.testing.assert_allclose(iced.moment_b, nominal.moment_b, rtol=1e-14)


def test_half_the_effectiveness_halves_the_derivatives_of_a_surface():
    airframe = load_airframe("aerosonde")
    column = airframe.derivatives.shape[1] - 3 + airframe.actuators.names.index("elevator")
    halved = eqx.tree_at(lambda a: a.derivatives, airframe, airframe.derivatives.at[:, column].multiply(0.5))
    weak = changed(airframe, surface_effectiveness=SurfaceEffectiveness(elevator=0.5))
    (expected, _), (obtained, _) = wrench(halved), wrench(weak)
    np.testing.assert_allclose(obtained.force_b, expected.force_b, rtol=1e-12)
    np.testing.assert_allclose(obtained.moment_b, expected.moment_b, rtol=1e-11)


@pytest.mark.parametrize("name", AIRFRAMES)
def test_deviations_of_surfaces_and_forces_hold_from_the_start(name):
    airframe = load_airframe(name)
    keys = {"drag": 1.3, "surface_effectiveness": SurfaceEffectiveness(rudder=0.0), "mass": 1.1}
    dispersed = disperse_airframe(airframe, Deviation(**keys))
    (expected, _), (obtained, _) = wrench(changed(airframe, **keys)), wrench(dispersed)
    np.testing.assert_allclose(obtained.force_b, expected.force_b, rtol=1e-12)
    np.testing.assert_allclose(obtained.moment_b, expected.moment_b, rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(dispersed.mass_properties.mass, 1.1 * airframe.mass_properties.mass)
    assert dispersed.symmetric == airframe.symmetric
    assert disperse_airframe(airframe, Deviation(mass=1.1)).__class__ is airframe.__class__


def test_factors_multiply_and_shifts_add_from_their_times_on():
    airframe = load_airframe("f16")
    later = Deviation(drag=1.5, cg_shift=-0.02, thrust=0.5, surface_effectiveness=SurfaceEffectiveness(aileron=0.5))
    schedule = changes(airframe, (20.0, later), (5.0, Deviation(drag=1.2, cg_shift=0.05)))
    for time, drag, shift, thrust, aileron in (
        (4.99, 1.0, 0.0, 1.0, 1.0),
        (5.0, 1.2, 0.05, 1.0, 1.0),
        (20.0, 1.8, 0.03, 0.5, 0.5),
    ):
        change = schedule.at(time)
        np.testing.assert_allclose(
            [change.drag, change.cg_shift, change.thrust, *change.surface_effectiveness],
            [drag, shift, thrust, 1.0, aileron, 1.0],
            rtol=1e-14,
            atol=1e-16,
        )


def test_an_unchanged_airframe_has_the_same_forces():
    airframe = load_airframe("f16")
    # two programs may round differently
    (expected, _), (obtained, _) = wrench_by_operations(airframe), wrench_by_operations(changed(airframe))
    np.testing.assert_array_equal(obtained.force_b, expected.force_b)
    np.testing.assert_array_equal(obtained.moment_b, expected.moment_b)


def test_changes_that_an_airframe_cannot_have_are_refused():
    body = load_body("brick")
    with pytest.raises(ScenarioError, match=r"\[0\].cg_shift: arrived 0.05; expected 0: SimpleBody"):
        changes(body, (1.0, Deviation(cg_shift=0.05)))
    ones = jnp.ones(())
    change = AirframeChange(jnp.ones(2), ones, ones, ones, ones, jnp.ones(3), ones, 0.0 * ones)
    with pytest.raises(ValueError, match=r"arrived shape \(2,\); expected \(3,\)"):
        changed_airframe(load_airframe("f16"), change)
    assert AirframeChanges(jnp.zeros(1), jax.tree.map(lambda x: x[None], change)).at(0.0).drag == 1.0
