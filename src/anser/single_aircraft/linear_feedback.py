"""Linear state feedback as a controller, from a gain matrix or as a linear-quadratic regulator from weights."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.airframe import AircraftState, Controls
from anser.control.feedback import wrap_angle
from anser.numerics.arrays import as_array, namespace
from anser.parts.controllers import AbstractController
from anser.parts.paths import PathCommand
from anser.parts.perception import Belief
from anser.shapes import Scalar, ScalarLike, Vector, Vector3
from anser.simulation.open_loop import believed_variables
from anser.units import DEG_RAD, RAD_DEG

if TYPE_CHECKING:
    from anser.analysis.linear_models import LinearizationResult

_VARIABLES = {
    "V": ("airspeed_m_s", 1.0),
    "alpha": ("alpha_deg", DEG_RAD),
    "beta": ("beta_deg", DEG_RAD),
    "phi": ("roll_deg", DEG_RAD),
    "theta": ("pitch_deg", DEG_RAD),
    "P": ("roll_rate_deg_s", DEG_RAD),
    "Q": ("pitch_rate_deg_s", DEG_RAD),
    "R": ("yaw_rate_deg_s", DEG_RAD),
    "altitude": ("altitude_m", 1.0),
    "power": ("power_percent", 1.0),
}
"""Variable of a dataset and factor to the unit of the linear model, for each state that can be fed back."""
_INTEGRALS = {"V_integral": 30.0, "gamma_integral": 0.3}
"""Limits of the integrals of the errors of airspeed (m) and path angle (rad s), against windup at control limits."""


class LinearFeedback(AbstractController):
    """Linear feedback about a trim: u = u0 - K (x - x0), in SI units and radians.

    Commands change the reference x0:

    - V is the commanded airspeed.
    - theta is the trimmed pitch + commanded path angle - trimmed path angle.
    - phi is the bank of a turn with the course rate: commanded rate + `course_gain` * course error, at most `bank_max`.

    The last columns of K may be for the integrals of the errors of airspeed and path angle.
    """

    gain: Float[Array, "input state"]  #: K: a row for each input of the linear model, the throttle first.
    trim_state: Vector  #: x0: trim values of the states of K, integrals excluded.
    trim_input: Vector  #: u0: throttle (0 to 1), then deflections (rad) of the trim.
    trim_path_angle: Scalar  #: Path angle of the trim, rad.
    course_gain: Scalar  #: Commanded course rate per error of the course, 1/s.
    bank_max: Scalar  #: Greatest commanded bank angle, rad; the scenario's limit has no effect.
    states: tuple[str, ...] = eqx.field(static=True)  #: Names of the columns of K, integrals last.
    surfaces: tuple[str, ...] = eqx.field(static=True)  #: Names of the aircraft's surfaces.

    @classmethod
    def from_gain(
        cls,
        linear: "LinearizationResult",
        gain: Float[np.ndarray, "input state"],
        states: Sequence[str],
        inputs: Sequence[str],
        *,
        course_gain: float = 0.25,
        bank_max_deg: float = 40.0,
    ) -> "LinearFeedback":
        """Return the feedback with a given gain matrix.

        Raises ValueError if a name is unknown, a shape does not fit, or the model is not the open loop without
        actuators.

        Parameters
        ----------
        linear
            Open-loop linear model without actuators, from `aircraft.linearize(...)`, which gives the trim.
        gain
            K, a row for each of `inputs` and a column for each of `states`; SI units and radians.
        states
            Names among V, alpha, beta, phi, theta, P, Q, R, altitude and power, then V_integral and gamma_integral.
        inputs
            Names among the aircraft's surfaces and throttle; other inputs keep their trim values.
        course_gain, bank_max_deg
            Commanded course rate per error of the course, 1/s; greatest commanded bank angle, deg.
        """
        model = _open_model(linear)
        motion = [name for name in states if name not in _INTEGRALS]
        ordered = [*motion, *(name for name in _INTEGRALS if name in states)]
        _check_names("states", ordered, [*(name for name in model.states if name in _VARIABLES), *_INTEGRALS])
        _check_names("inputs", inputs, model.inputs)
        matrix = np.asarray(gain, dtype=float)
        if list(states) != ordered or matrix.shape != (len(inputs), len(states)):
            raise ValueError(
                f"gain: arrived shape {matrix.shape} for the states {', '.join(states)}; expected ({len(inputs)}, "
                f"{len(states)}), the columns in the order {', '.join(ordered)}"
            )
        whole = np.zeros((len(model.inputs), len(states)))
        whole[[model.inputs.index(name) for name in inputs]] = matrix
        trim_state = np.asarray(model.x)[[model.states.index(name) for name in motion]]
        trim_path_angle = float(model.y[model.outputs.index("gamma")])
        numbers = (whole, trim_state, np.asarray(model.u), trim_path_angle, course_gain, bank_max_deg * DEG_RAD)
        return cls(*map(as_array, numbers), states=tuple(states), surfaces=tuple(model.surfaces))

    @classmethod
    def from_weights(
        cls, linear: "LinearizationResult", Q: Mapping[str, float], R: Mapping[str, float], **options: float
    ) -> "LinearFeedback":
        """Return the linear-quadratic regulator: K minimizes the integral of x' Q x + u' R u.

        Raises ValueError if a name is unknown, a weight in `Q` is negative or in `R` not positive, or no regulator
        exists for these weights.

        Parameters
        ----------
        linear, **options
            Open-loop linear model, `course_gain` and `bank_max_deg`: see `from_gain`.
        Q
            Weights of states and integrals by name, in SI units and radians. All states except heading are fed back,
            with weight 0 if absent; altitude and integrals only if they have a weight.
        R
            Weights of the inputs that the feedback moves, by name.
        """
        from scipy.linalg import LinAlgError, solve_continuous_are

        model = _open_model(linear)
        fed_back = [name for name in model.states if name in _VARIABLES]
        _check_names("Q", list(Q), [*fed_back, *_INTEGRALS])
        _check_names("R", list(R), model.inputs)
        motion = [name for name in fed_back if name in Q or name != "altitude"]
        integrals = [name for name in _INTEGRALS if name in Q]
        rows, columns = [model.states.index(name) for name in motion], [model.inputs.index(name) for name in R]
        outputs = [model.outputs.index(name.removesuffix("_integral")) for name in integrals]
        slopes = np.vstack([np.asarray(model.A)[rows], np.asarray(model.C)[outputs]])[:, rows]
        A = np.pad(slopes, ((0, 0), (0, len(integrals))))
        B = np.pad(np.asarray(model.B)[np.ix_(rows, columns)], ((0, len(integrals)), (0, 0)))
        states = [*motion, *integrals]
        weights = np.array([float(Q.get(name, 0.0)) for name in states]), np.array([float(R[name]) for name in R])
        if not (weights[0] >= 0.0).all() or not (weights[1] > 0.0).all():
            raise ValueError("Q, R: arrived a negative weight; expected numbers from 0 (Q), above 0 (R)")
        try:
            cost = solve_continuous_are(A, B, np.diag(weights[0]), np.diag(weights[1]))
        except LinAlgError as error:
            raise ValueError(
                f"Q, R: no regulator exists ({error}); expected weights of inputs that stabilize the motion, and of "
                "states in which every undamped motion shows"
            ) from None
        return cls.from_gain(linear, (B / weights[1]).T @ cost, states, list(R), **options)

    def init(self, state: AircraftState, attitude: Vector3) -> Vector:
        """Return the integrals of the errors at the start, all 0: an element for each integral among `states`."""
        return jnp.zeros(len(self.states) - self.trim_state.size, state.rates_b.dtype)

    def control(
        self, controller_state: Vector, belief: Belief, command: PathCommand, step: ScalarLike
    ) -> tuple[Controls, None, Vector]:
        """Return the controls (surfaces in rad, not limited), None (no signals), and the integrals at the next sample.

        Raises ValueError if the aircraft and the linear model have different surfaces.
        """
        if belief.airframe.actuators.names != self.surfaces:
            arrived = ", ".join(belief.airframe.actuators.names)
            raise ValueError(f"linear feedback: arrived {arrived}; expected the surfaces {', '.join(self.surfaces)}")
        variables = believed_variables(belief)
        V, gamma, chi = (variables[name] for name in ("airspeed_m_s", "path_angle_deg", "course_deg"))
        gamma, chi = gamma * DEG_RAD, chi * DEG_RAD
        turn_rate = command.chi_dot + self.course_gain * wrap_angle(command.chi - chi)
        bank = jnp.arctan(V * turn_rate / belief.condition.earth.gravity)
        bank = jnp.clip(bank, -self.bank_max, self.bank_max)
        reference = dict(zip(self.states, self.trim_state, strict=False)) | {"V": command.V, "phi": bank}
        if "theta" in self.states:
            reference["theta"] = reference["theta"] + command.gamma - self.trim_path_angle
        motion = self.states[: self.trim_state.size]
        measured = [variables[_VARIABLES[name][0]] * _VARIABLES[name][1] - reference[name] for name in motion]
        throttle, *surfaces = self.trim_input - self.gain @ jnp.concatenate([jnp.stack(measured), controller_state])
        errors = {"V_integral": V - command.V, "gamma_integral": gamma - command.gamma}
        next_state = controller_state
        for k, name in enumerate(self.states[len(motion) :]):
            integral = controller_state[k] + step * errors[name]
            next_state = next_state.at[k].set(jnp.clip(integral, -_INTEGRALS[name], _INTEGRALS[name]))
        return Controls(jnp.stack(surfaces), jnp.clip(throttle, 0.0, 1.0)), None, next_state

    def controls(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the controls by name for a state by name, such as `Simulator.state`, with the trim as reference.

        Surfaces are in deg, not limited; the throttle is limited to 0 to 1. Commands and integrals have no effect. The
        variables of `state` are numbers or arrays; a control law of `anser.simulate` can call the method.
        """
        count = self.trim_state.size
        variables = [_VARIABLES[name] for name in self.states[:count]]
        xp = namespace(*(state[name] for name, _ in variables))
        measured = xp.stack([factor * xp.asarray(state[name]) for name, factor in variables], axis=-1)
        gain, trim_state, trim_input = (xp.asarray(array) for array in (self.gain, self.trim_state, self.trim_input))
        inputs = trim_input - (measured - trim_state) @ gain[:, :count].T
        named = {name: RAD_DEG * inputs[..., k] for k, name in enumerate(self.surfaces, start=1)}
        return {**named, "throttle": xp.clip(inputs[..., 0], 0.0, 1.0)}


def _open_model(linear: "LinearizationResult") -> Any:
    if linear.condition["loop"] != "open" or linear.condition["actuators"]:
        raise ValueError("linear: arrived a model of a loop or with actuators; expected aircraft.linearize(trim)")
    return linear.model


def _check_names(argument: str, names: Sequence[str], expected: Sequence[str]) -> None:
    unknown = [name for name in names if name not in expected]
    if unknown or len(set(names)) < len(names) or not names:
        arrived = repr(unknown[0]) if unknown else f"{list(names)}"
        raise ValueError(f"{argument}: arrived {arrived}; expected names among {', '.join(expected)}, each once")
