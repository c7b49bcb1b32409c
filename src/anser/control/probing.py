"""Test inputs of an adaptive aircraft: multisines on the surfaces while the control effectiveness is uncertain."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from anser.aircraft.airframe import AircraftState, Controls
from anser.numerics.arrays import as_array
from anser.parts.controllers import AbstractController
from anser.parts.input_signals import AbstractSignal, multisine
from anser.parts.perception import Belief
from anser.shapes import Integer, Scalar, ScalarLike, Vector, Vector3

_LINES = 4
"""Number of harmonics in each surface's multisine."""
_PERIOD_S = 5.0
"""Period of the test inputs, s."""


class ProbingState(eqx.Module):
    """State of a `ProbingController` between samples."""

    controller: Any  # state of the controller to whose commands the test inputs are added
    surfaces: Vector  # deflections at the start, rad
    power: Scalar  # engine power at the start, percent
    count: Integer  # number of samples so far


class ProbingController(AbstractController):
    """Controller that adds multisines to the surface commands of `controller` while an adaptive estimator needs them.

    Test inputs are added until `learning_time`, and whenever the relative standard deviation of the control
    effectiveness exceeds `uncertainty_max`. Until `learning_time`, the surfaces and the engine power of the start
    replace the commands of `controller`.
    """

    controller: AbstractController  #: Controller to whose surface commands the test inputs are added.
    amplitude: Vector  #: Greatest magnitude of each surface's test input, rad.
    signals: tuple[AbstractSignal, ...]  #: Multisine of each surface over one period, with the greatest magnitude 1.
    period: Scalar  #: Period after which the multisines repeat, s.
    #: Relative standard deviation of the control effectiveness above which test inputs are added.
    uncertainty_max: Scalar
    learning_time: Scalar  #: Time until which the controls of the start are held, s; 0: never.

    def init(self, state: AircraftState, attitude: Vector3) -> ProbingState:
        """Return the state after a long time in steady flight; `attitude` is (mu, alpha, beta), rad."""
        power = jnp.asarray(state.power, dtype=float)
        return ProbingState(
            self.controller.init(state, attitude), state.surfaces, power, jnp.asarray(0, dtype=jnp.int32)
        )

    def control(
        self, controller_state: ProbingState, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, Any, ProbingState]:
        """Return surfaces and throttle with the test input, the signals of `controller`, and the new state.

        Until `learning_time`, the signals are NaN and their flags false. `step` is the sampling period, s. Raises
        ValueError if the belief has no estimates of an adaptive estimator.
        """
        if belief.estimates is None:
            raise ValueError("a controller with test inputs needs an adaptive estimator, which says when to move")
        state, time = controller_state, controller_state.count * step
        controls, signals, active = self.controller.control(state.controller, belief, command, step)
        is_learning = time < self.learning_time
        is_needed = is_learning | (belief.estimates.effectiveness_uncertainty > self.uncertainty_max)
        added = jnp.where(is_needed, self.deflections(time), 0.0)
        surfaces = jnp.where(is_learning, state.surfaces, controls.surfaces) + added
        engine, actuators = belief.airframe.engine, belief.airframe.actuators
        throttle = jnp.where(is_learning, engine.throttle_for_power(state.power), controls.throttle)
        waiting = jax.tree.map(lambda new, old: jnp.where(is_learning, old, new), active, state.controller)
        signals = jax.tree.map(lambda leaf: jnp.where(is_learning, _blank(leaf), leaf), signals)
        controls = Controls(actuators.limit_command(surfaces), throttle)
        return controls, signals, ProbingState(waiting, state.surfaces, state.power, state.count + 1)

    def deflections(self, time: ScalarLike) -> Vector:
        """Return the test input of each surface (rad) at `time` (s); near 0 at time 0."""
        phase_time = jnp.mod(jnp.asarray(time), self.period)
        return self.amplitude * jnp.stack([signal.at(phase_time) for signal in self.signals])


def _blank(values: Array) -> Array:
    return jnp.full_like(values, jnp.nan if jnp.issubdtype(jnp.result_type(values), jnp.inexact) else 0)


def probing_controller(
    controller: AbstractController, surfaces: int, amplitude: ScalarLike, *, learning_time: ScalarLike = 0.0
) -> ProbingController:
    """Build a controller that adds test inputs up to `amplitude` (rad) to the surfaces; `surfaces` is their number.

    Each surface has a multisine (`anser.parts.input_signals.multisine`) of four harmonics of 0.2 Hz. The surfaces take
    the harmonics in turn, starting with the second, so that the inputs are orthogonal over a period of 5 s. Until
    `learning_time` (s; 0: never), the controls of the start are held.
    """
    frequencies_hz = 2.0 / _PERIOD_S, (1.0 + _LINES * surfaces) / _PERIOD_S
    signals = (
        multisine(1.0, frequencies_hz, _PERIOD_S, 0.0, channel=k, channels=surfaces).signal for k in range(surfaces)
    )
    return ProbingController(
        controller=controller,
        amplitude=jnp.broadcast_to(jnp.asarray(amplitude, dtype=float), (surfaces,)),
        signals=jax.tree.map(as_array, tuple(signals)),
        period=jnp.asarray(_PERIOD_S),
        uncertainty_max=jnp.asarray(0.2),
        learning_time=jnp.asarray(learning_time, dtype=float),
    )
