"""Dynamic models with unknown parameters, recorded manoeuvres, and predicted outputs with sensitivities."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from anser.compiling.options import compiled_quickly
from anser.identification.regression import uniform_times
from anser.numerics.integration import rk4_step
from anser.shapes import Scalar

Parameters = Mapping[str, Scalar]
"""Parameters of a model by name."""
Equations = Callable[[Array, Array, Parameters], tuple[Array, Array]]
"""JAX function of state x, input u and parameters, which returns the rate of the state and the outputs y."""
Values = Float[np.ndarray, " parameter"]
Gain = Float[np.ndarray, "state output"]


@dataclass(frozen=True)
class DynamicModel:
    """A model x_dot, y = equations(x, u, theta) with the names of its states, inputs and outputs.

    For example, with the angle of attack and the pitch rate as states and outputs::

        def equations(x, u, theta):
            alpha, q = x
            alpha_dot = theta["Z_alpha"] * alpha + q + theta["Z_elevator"] * u[0]
            q_dot = theta["M_alpha"] * alpha + theta["M_q"] * q + theta["M_elevator"] * u[0]
            return jnp.stack([alpha_dot, q_dot]), x
    """

    equations: Equations
    states: tuple[str, ...]  #: Names of the elements of x.
    inputs: tuple[str, ...]  #: Names of the elements of u.
    outputs: tuple[str, ...]  #: Names of the elements of y.


@dataclass(frozen=True)
class Manoeuvre:
    """Recorded inputs and measured outputs of one manoeuvre, in the model's units, at a constant sampling period.

    `initial_state` is the state at the first sample. If `held` is true, an input is constant over the step after its
    sample; if false, an input is linear between the samples.
    """

    time_s: Float[np.ndarray, " sample"]
    inputs: Float[np.ndarray, "sample input"]
    outputs: Float[np.ndarray, "sample output"]
    initial_state: Float[np.ndarray, " state"]
    held: bool = True

    @property
    def step_s(self) -> float:
        """Sampling period, s."""
        return float(self.time_s[-1] - self.time_s[0]) / (self.time_s.size - 1)


def make_manoeuvre(
    model: DynamicModel,
    time_s: ArrayLike,
    inputs: ArrayLike,
    outputs: ArrayLike,
    initial_state: ArrayLike | None = None,
    *,
    held: bool = True,
) -> Manoeuvre:
    """Return a `Manoeuvre` from inputs (sample, input) and measured outputs (sample, output), in the model's units.

    Times are in s. A one-dimensional array is a single column. `initial_state` None is zero; `held`: see `Manoeuvre`.
    Raises ValueError if a shape does not fit the model, a number is not finite, or the steps are not equal.
    """
    time = uniform_times(time_s, np.size(time_s))
    start = np.zeros(len(model.states)) if initial_state is None else np.asarray(initial_state, dtype=float)
    arrays = [np.asarray(values, dtype=float) for values in (inputs, outputs)]
    arrays = [values[:, None] if values.ndim == 1 else values for values in arrays]
    shapes = {
        "inputs": (arrays[0], (time.size, len(model.inputs)), model.inputs),
        "outputs": (arrays[1], (time.size, len(model.outputs)), model.outputs),
        "initial_state": (start, (len(model.states),), model.states),
    }
    for name, (values, shape, labels) in shapes.items():
        if values.shape != shape:
            raise ValueError(f"{name}: arrived shape {values.shape}; expected {shape}: {', '.join(labels)}")
        if not np.all(np.isfinite(values)):
            count = int(np.sum(~np.isfinite(values)))
            raise ValueError(f"{name}: arrived {count} numbers of {values.size} that are not finite; expected numbers")
    return Manoeuvre(time, arrays[0], arrays[1], start, held)


class Prediction(NamedTuple):
    """Predicted outputs of a manoeuvre, and sensitivities: their derivatives with respect to the parameters."""

    outputs: Float[np.ndarray, "sample output"]
    sensitivities: Float[np.ndarray, "sample output parameter"]


class StateSpace(NamedTuple):
    """State-space matrices of a model, linearized at the initial state x of a manoeuvre.

    `A` is d(x_dot)/dx, `C` is d(outputs)/dx, and `transition` is d(x after one sampling period)/dx.
    """

    transition: Float[np.ndarray, "state state"]
    C: Float[np.ndarray, "output state"]
    A: Float[np.ndarray, "state state"]


@dataclass(frozen=True)
class ParameterSet:
    """A model, the `names` of its estimated parameters, and the values of its `fixed` parameters by name.

    A name `STATE(0)` is the initial value of a state.
    """

    model: DynamicModel
    names: tuple[str, ...]
    fixed: Mapping[str, float] = field(default_factory=dict)

    def predict(self, values: Values, manoeuvre: Manoeuvre, gain: Gain | None = None) -> Prediction:
        """Integrate the model over a manoeuvre; return the outputs and their derivatives with respect to `values`.

        `values` are the estimated parameters in the order of `names`. Before each step, `gain` times (measured -
        predicted outputs) is added to the state; None: no correction.
        """
        arguments = self.case(manoeuvre), jnp.asarray(values), self._gain(gain)
        return Prediction(*map(np.asarray, _predict(*arguments)))

    def input_influence(
        self,
        values: Values,
        manoeuvre: Manoeuvre,
        weights: Float[np.ndarray, "sample output parameter"],
        gain: Gain | None = None,
    ) -> Float[np.ndarray, "parameter sample input"]:
        """Return the derivatives of weighted sums of the outputs with respect to every sample of the inputs.

        The sum of parameter p is sum(weights[:, :, p] * outputs); `gain`: see `predict`.
        """
        arguments = self.case(manoeuvre), jnp.asarray(values), jnp.asarray(weights), self._gain(gain)
        return np.asarray(_input_influence(*arguments))

    def _gain(self, gain: Gain | None) -> Array:
        zero = np.zeros((len(self.model.states), len(self.model.outputs)))
        return jnp.asarray(zero if gain is None else gain)

    def linearize(self, values: Values, manoeuvre: Manoeuvre) -> StateSpace:
        """Return the model linearized at the initial state of a manoeuvre, with the mean inputs over the manoeuvre."""
        return StateSpace(*map(np.asarray, _linearize(self.case(manoeuvre), jnp.asarray(values))))

    def case(self, manoeuvre: Manoeuvre) -> "Case":
        """Return the model and a manoeuvre as JAX arrays, for compiled functions."""
        arrays = (manoeuvre.initial_state, manoeuvre.inputs, manoeuvre.outputs, np.asarray(manoeuvre.step_s))
        fixed = {name: jnp.asarray(float(value)) for name, value in self.fixed.items()}
        return Case(
            self.model.equations, self.model.states, self.names, manoeuvre.held, fixed, *map(jnp.asarray, arrays)
        )


class Case(NamedTuple):
    """A model and a manoeuvre as JAX arrays, the argument of compiled functions.

    `names` are the estimated parameters, `fixed` the values of the remaining parameters; `held`: see `Manoeuvre`.
    """

    equations: Equations
    states: tuple[str, ...]
    names: tuple[str, ...]
    held: bool
    fixed: Parameters
    initial_state: Float[Array, " state"]
    inputs: Float[Array, "sample input"]
    measured: Float[Array, "sample output"]
    step_s: Scalar

    @property
    def samples(self) -> tuple[Array, Array, Array]:
        """Inputs, inputs one sample later (the last sample is repeated) and measured outputs; a row for each sample."""
        return self.inputs, jnp.concatenate([self.inputs[1:], self.inputs[-1:]]), self.measured

    def start(self, values: Array) -> tuple[dict[str, Array], Array]:
        """Return all parameters by name, and the initial state; a parameter `STATE(0)` overrides `initial_state`."""
        theta = {**self.fixed, **dict(zip(self.names, values, strict=True))}
        initial = [theta.get(f"{name}(0)", self.initial_state[k]) for k, name in enumerate(self.states)]
        return theta, jnp.stack(initial)

    def advance(self, x: Array, u: Array, u_next: Array, theta: Parameters) -> Array:
        """Return the state after one Runge-Kutta step; the input is `u` if held, linear from `u` to `u_next` if not."""

        def rate(t: Any, state: Array) -> Array:
            return self.equations(state, u if self.held else u + t / self.step_s * (u_next - u), theta)[0]

        return rk4_step(rate, 0.0, x, self.step_s)


def prepare_parameters(
    model: DynamicModel,
    manoeuvre: Manoeuvre,
    start: Mapping[str, float],
    fixed: Mapping[str, float] | None,
    initial_states: Sequence[str],
) -> tuple[ParameterSet, Values]:
    """Return the parameter set that estimates the parameters in `start`, and start values in the order of `names`.

    For each name in `initial_states`, a parameter `STATE(0)` is appended; its start value is the manoeuvre's initial
    state. Raises ValueError if `start` is empty, a name is fixed too, a value is not finite, or a state is unknown.
    """
    fixed = dict(fixed or {})
    numbers = {**start, **fixed}
    if not start or len(numbers) < len(start) + len(fixed) or not all(np.isfinite(list(numbers.values()))):
        raise ValueError(f"start: arrived {dict(start)}, fixed: {fixed}; expected finite numbers, each name once")
    if not set(initial_states) <= set(model.states):
        raise ValueError(f"initial_states: arrived {list(initial_states)}; expected some of {', '.join(model.states)}")
    values = {**start, **{f"{name}(0)": manoeuvre.initial_state[model.states.index(name)] for name in initial_states}}
    return ParameterSet(model, tuple(values), fixed), np.array([float(value) for value in values.values()])


def _outputs(case: Case, values: Array, gain: Array) -> Array:
    theta, start = case.start(values)

    def proceed(x: Array, sample: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        u, u_next, z = sample
        y = case.equations(x, u, theta)[1]
        return case.advance(x + gain @ (z - y), u, u_next, theta), y

    return jax.lax.scan(proceed, start, case.samples)[1]


@compiled_quickly
def _predict(case: Case, values: Array, gain: Array) -> tuple[Array, Array]:
    sensitivities, outputs = jax.jacfwd(lambda v: 2 * (_outputs(case, v, gain),), has_aux=True)(values)
    return outputs, sensitivities


@compiled_quickly
def _input_influence(case: Case, values: Array, weights: Array, gain: Array) -> Array:
    def weighted(inputs: Array) -> Array:
        return jnp.einsum("iap,ia->p", weights, _outputs(case._replace(inputs=inputs), values, gain))

    return jax.jacrev(weighted)(case.inputs)


@compiled_quickly
def _linearize(case: Case, values: Array) -> tuple[Array, Array, Array]:
    theta, start = case.start(values)
    u = jnp.mean(case.inputs, axis=0)
    transition = jax.jacfwd(lambda x: case.advance(x, u, u, theta))(start)
    A, C = jax.jacfwd(lambda x: case.equations(x, u, theta))(start)
    return transition, C, A
