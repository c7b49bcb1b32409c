"""Incremental inversion: no residual with a perfect model, the complete model error with a wrong model."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AbstractAirframe, AbstractEngine, FirstOrderActuators, MassProperties, Wrench
from anser.control import default_limits, published_gains
from anser.control.autopilot import rate_control, velocity_control
from anser.control.autopilot_state import ModelResidual, no_residual
from anser.control.onboard_model import onboard_model
from anser.parts import PathCommand
from anser.scenario import build_flight, loads
from anser.shapes import Scalar, Vector3
from anser.simulation.response import exact_belief
from anser.simulation.vehicle import advance
from anser.steady import trim_target
from support.autopilot_cases import ENVIRONMENT, memory_of
from support.control_cases import AIRFRAME, DEGREE
from support.states import make_state
from support.trims import trim

BANDWIDTH, STEP = 20.0, 0.01
LIMITS, GRAVITY = default_limits(), ENVIRONMENT.gravity


def gains(bandwidth):
    return eqx.tree_at(lambda g: g.sensor_bandwidth, published_gains(), jnp.asarray(bandwidth))


def test_the_filter_uses_the_mean_over_the_sample():
    """Constant model error: the filter converges with exp(-bandwidth t); with zero bandwidth, it stays zero."""
    model, error, force = jnp.array([0.1, -0.2, 0.3]), jnp.array([1.0, 2.0, -3.0]), jnp.array([5.0, -6.0, 7.0])
    for bandwidth, expected_share in ((BANDWIDTH, 1 - np.exp(-BANDWIDTH * 0.5)), (0.0, 0.0)):
        memory = dataclasses.replace(no_residual(jnp.zeros(3)), model_acceleration_b=model)
        for k in range(1, 51):
            rates = (model + error) * k * STEP
            memory = memory.advance(force, rates, model, bandwidth, STEP)
        assert isinstance(memory, ModelResidual)
        np.testing.assert_allclose(memory.acceleration_b, expected_share * error, atol=1e-12)
        np.testing.assert_allclose(memory.force_b, expected_share * force, atol=1e-12)


def test_held_surfaces_act_over_the_whole_period_before_the_sample():
    memory = dataclasses.replace(no_residual(jnp.zeros(3)), model_acceleration_b=jnp.array([9.0, -9.0, 9.0]))
    model = jnp.array([1.0, -2.0, 3.0])
    residual = memory.advance(jnp.zeros(3), model * STEP, model, BANDWIDTH, STEP, is_held=True).acceleration_b
    np.testing.assert_allclose(residual, np.zeros(3), atol=1e-12)


class Offset(AbstractAirframe):
    """The F-16 with an added constant moment: a model with wrong moments and correct slopes."""

    mass_properties: MassProperties
    actuators: FirstOrderActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    moment_b: Vector3

    def aerodynamics(self, air_data, rates_b, surfaces):
        right = AIRFRAME.aerodynamics(air_data, rates_b, surfaces)
        return Wrench(right.force_b, right.moment_b + self.moment_b)


@pytest.mark.long
def test_surfaces_depend_only_on_the_measurement_and_the_slopes_of_the_model():
    """u = u_0 + G^-1 (nu - y_dot measured): a model with constant moment errors gives the same surfaces."""
    state = make_state(V=150.0, alpha=0.08, beta=0.01, rates=(0.05, 0.02, -0.01), surfaces=(-0.03, 0.0, 0.0))
    memory_0 = memory_of(trim(AIRFRAME, ENVIRONMENT, trim_target(150.0, 2500.0)))
    J_inverse = AIRFRAME.mass_properties.inertia_inverse_b

    def surfaces(moment_b, *, with_residual):
        model = Offset(
            AIRFRAME.mass_properties,
            AIRFRAME.actuators,
            AIRFRAME.engine,
            AIRFRAME.alpha_range,
            AIRFRAME.beta_range,
            moment_b,
        )
        residual = no_residual(state.rates_b)
        if with_residual:
            residual = dataclasses.replace(residual, acceleration_b=-(J_inverse @ moment_b))
        memory = eqx.tree_at(lambda m: m.residual, memory_0, residual)
        model = onboard_model(exact_belief(model, ENVIRONMENT, state), LIMITS, gains(0.0), memory, STEP)
        demand, _ = rate_control(model, gains(0.0), memory, state.rates_b, jnp.array([0.2, 0.1, 0.0]))
        return np.asarray(demand.surfaces)

    right, wrong = surfaces(jnp.zeros(3), with_residual=False), jnp.array([3e3, -5e3, 2e3])  # N m
    np.testing.assert_allclose(surfaces(wrong, with_residual=True), right, atol=1e-9)
    assert np.abs(surfaces(wrong, with_residual=False) - right).max() > 0.2 * DEGREE


def _wrong_aircraft():
    """Lift and drag 30 % less, damping 30 % more, controls 30 % weaker than in the autopilot's model."""
    return eqx.tree_at(
        lambda a: (a.tables.cells[0], a.tables.cells[2], a.normal_force_elevator),
        AIRFRAME,
        (
            AIRFRAME.tables.cells[0] * jnp.array([0.7, *(1.3,) * 9])[None, None],
            AIRFRAME.tables.cells[2] * jnp.array([0.7, 0.7, 0.7, 0.7, 1.3, 0.7])[None, None],
            AIRFRAME.normal_force_elevator * 0.7,
        ),
    )


@jax.jit
def _climb_and_turn(truth, bandwidth, start, memory):
    """40 s of a climb of 3 deg and a turn by 30 deg, flown by the autopilot of the nominal aircraft."""

    def model_based(carry, k):
        state, memory = carry
        felt_b = exact_belief(truth, ENVIRONMENT, state).specific_force_b
        belief = eqx.tree_at(lambda b: b.specific_force_b, exact_belief(AIRFRAME, ENVIRONMENT, state), felt_b)
        setting = gains(bandwidth)
        model = onboard_model(belief, LIMITS, setting, memory, STEP)
        zero = jnp.zeros(())
        command = PathCommand(jnp.asarray(155.0), jnp.asarray(3 * DEGREE), jnp.asarray(30 * DEGREE), zero, zero, zero)
        controls, _, memory = velocity_control(model, setting, memory, command)
        motion = model.motion
        errors = jnp.stack([motion.V - 155.0, motion.gamma - 3 * DEGREE, motion.chi - 30 * DEGREE, motion.beta])
        return (advance(truth, ENVIRONMENT, 0.0, state, controls, STEP), memory), (
            errors,
            state.surfaces,
            memory.residual,
        )

    return jax.lax.scan(model_based, (start, memory), length=4000)[1]


@pytest.fixture(scope="module")
def flown():
    point = trim(AIRFRAME, ENVIRONMENT, trim_target(150.0, 2000.0))
    return {
        (name, bandwidth): jax.tree.map(np.asarray, _climb_and_turn(truth, bandwidth, point.state, memory_of(point)))
        for name, truth in (("nominal", AIRFRAME), ("wrong", _wrong_aircraft()))
        for bandwidth in (0.0, BANDWIDTH)
    }


@pytest.mark.long
def test_both_inversions_fly_alike_with_a_perfect_model(flown):
    """The measured minus the modelled acceleration is only the curvature within a sample."""
    model_based, incremental = flown["nominal", 0.0][0], flown["nominal", BANDWIDTH][0]
    np.testing.assert_allclose(incremental[:, 1:3], model_based[:, 1:3], atol=0.01 * DEGREE)
    np.testing.assert_allclose(incremental[:, 0], model_based[:, 0], atol=0.02)
    assert np.abs(flown["nominal", 0.0][2].acceleration_b).max() == 0.0


@pytest.mark.long
def test_the_incremental_inversion_is_insensitive_to_model_errors(flown):
    """The path angle, with 30 % lift error: model-based inversion sags and needs the slow integral."""
    _, _, sensed = flown["wrong", BANDWIDTH]
    assert np.abs(sensed.force_b[-1][2]) > 0.1 * 9295 * 9.8  # the model's lift is off, and the sensors say so
    sag = {bandwidth: np.abs(flown["wrong", bandwidth][0][2000:, 1]).max() for bandwidth in (0.0, BANDWIDTH)}
    nominal = np.abs(flown["nominal", 0.0][0][2000:, 1]).max()
    assert sag[0.0] > 3 * nominal
    assert sag[BANDWIDTH] < 1.2 * nominal
    for bandwidth in (0.0, BANDWIDTH):
        errors, surfaces, _ = flown["wrong", bandwidth]
        assert np.isfinite(errors).all()
        # no chatter: at the end the surfaces move by less than a thousandth of a degree a sample
        assert np.abs(np.diff(surfaces[-500:], axis=0)).max() < 1e-3 * DEGREE


def test_a_scenario_chooses_the_inversion():
    from pathlib import Path

    text = (Path(__file__).parents[2] / "scenarios" / "single-aircraft.toml").read_text()
    assert float(build_flight(loads(text)).groups[0].vehicles.batched.controller.gains.sensor_bandwidth[0]) == 0.0
    chosen = text.replace("[[goal]]", '[aircraft.gains]\ninversion = "incremental"\n\n[[goal]]', 1)
    assert (
        float(build_flight(loads(chosen)).groups[0].vehicles.batched.controller.gains.sensor_bandwidth[0]) == BANDWIDTH
    )
