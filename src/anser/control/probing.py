"""Test inputs of an aircraft that learns: multisines on the surfaces where an adaptive estimator lacks information."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft.airframe import AircraftState, Controls
from anser.numerics.arrays import as_array
from anser.parts.controllers import AbstractController
from anser.parts.input_signals import AbstractSignal, multisine
from anser.parts.perception import Belief
from anser.shapes import Integer, Scalar, ScalarLike, Vector, Vector3

_LINES = 4
"""Lines of each surface's multisine."""
_PERIOD_S = 5.0
"""Period of the test inputs, s."""


class ProbingState(eqx.Module):
    """State of the controller; surfaces (rad) and engine power (percent) of the start, and number of samples so far."""

    controller: Any
    surfaces: Vector
    power: Scalar
    count: Integer


class ProbingController(AbstractController):
    """Controller that adds test inputs to the surface commands of `controller`.

    In a first phase the adaptive estimator learns: the controls of the start are held, with the test input, and
    `controller` is not used.
    """

    controller: AbstractController  #: Controller whose surface commands are disturbed.
    amplitude: Vector  #: Greatest deflection of each surface, rad.
    signals: tuple[AbstractSignal, ...]  #: Multisine of each surface over a period, with the greatest magnitude 1.
    period: Scalar  #: Period after which the multisines repeat, s.
    #: Relative standard deviation of the control effectiveness above which the surfaces are moved.
    uncertainty_max: Scalar
    learning_time: Scalar  #: End of the first phase, s; 0: none.

    def init(self, state: AircraftState, attitude: Vector3) -> ProbingState:
        """Return the state after a long time in steady flight."""
        power = jnp.asarray(state.power, dtype=float)
        return ProbingState(
            self.controller.init(state, attitude), state.surfaces, power, jnp.asarray(0, dtype=jnp.int32)
        )

    def control(
        self, controller_state: ProbingState, belief: Belief, command: Any, step: ScalarLike
    ) -> tuple[Controls, Any, ProbingState]:
        """Compute the controls with the test input; raises ValueError if no adaptive estimator is flown."""
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
        controls = Controls(actuators.limit_command(surfaces), throttle)
        return controls, signals, ProbingState(waiting, state.surfaces, state.power, state.count + 1)

    def deflections(self, time: ScalarLike) -> Vector:
        """Return the surface deflections (rad) of the test input at a time (s), near 0 at time 0."""
        phase_time = jnp.mod(jnp.asarray(time), self.period)
        return self.amplitude * jnp.stack([signal.at(phase_time) for signal in self.signals])


def probing_controller(
    controller: AbstractController, surfaces: int, amplitude: ScalarLike, *, learning_time: ScalarLike = 0.0
) -> ProbingController:
    """Build a controller with test inputs of `amplitude` (rad) for a number of surfaces.

    Each surface has a multisine (`anser.parts.input_signals.multisine`) of four harmonics of 0.2 Hz. The
    harmonics, from the second on, are assigned to the surfaces in turn, so that the inputs are orthogonal over a
    period. `learning_time` (s) is the end of the first phase; 0: no first phase.
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
