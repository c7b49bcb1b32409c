"""Environment for learning: the closed loop of one aircraft under an action, with task, reward and automatic reset.

The contract is that of gymnax 1.0: `reset`, `step` with six values, a reset within the step, the last observation in
`info["final_observation"]`, `observe`, and gradients on request. All functions are pure and for one environment;
`jax.vmap` makes many.
"""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from anser.environment.gridded_wind import has_left_field
from anser.environments.actions import AbstractActionLevel, HeldCommand
from anser.environments.cases import Case, Situation
from anser.environments.planned_tasks import PlannedMission, comes_too_near
from anser.environments.spaces import Box, Entry, catalogue_entry
from anser.environments.tasks import AbstractTask
from anser.numerics.arrays import Stacked, cast_like, cast_to_precision
from anser.numerics.randomness import SeededRandomness, threefry
from anser.parts.perception import Belief, Instant, Truth
from anser.shapes import Flag, Integer, Scalar, ScalarLike
from anser.simulation.closed_loop import Perception, command_and_move, perceive, trimmed_vehicle
from anser.simulation.open_loop import believed_variables
from anser.simulation.vehicle import Vehicle, VehicleState
from anser.units import RAD_DEG

_ALPHA_MARGIN_DEG = 10.0
"""Angle of attack beyond the aircraft's data at which an episode ends, deg."""

MOTION = (
    catalogue_entry("airspeed_m_s", 150.0, 100.0),
    catalogue_entry("altitude_m", 4000.0, 4000.0),
    catalogue_entry("alpha_deg", 0.0, 25.0),
    catalogue_entry("beta_deg", 0.0, 10.0),
    catalogue_entry("bank_deg", 0.0, 180.0),
    catalogue_entry("path_angle_deg", 0.0, 45.0),
    catalogue_entry("roll_rate_deg_s", 0.0, 90.0),
    catalogue_entry("pitch_rate_deg_s", 0.0, 45.0),
    catalogue_entry("yaw_rate_deg_s", 0.0, 45.0),
    catalogue_entry("load_factor", 1.0, 4.0),
    catalogue_entry("power_percent", 50.0, 50.0),
)
"""Entries of the aircraft's own motion, at the head of every observation; surfaces follow."""


class Parameters(eqx.Module):
    """Numbers of an environment, an argument of its functions.

    Attributes
    ----------
    cases
        Cases of the episodes, with a leading axis.
    observations
        Observation at the start of each case; None: it depends on random numbers, and each reset computes it.
    step
        Step of the integration, s.
    """

    cases: Stacked[Case]
    observations: Float[Array, "case entry"] | None
    step: Scalar

    @property
    def count(self) -> int:
        """Number of cases."""
        return jax.tree.leaves(self.cases.batched)[0].shape[0]

    def case(self, row: Integer) -> Case:
        """Return the case in a row of the table of cases."""
        return self.cases.at(row)  # pyright: ignore[reportArgumentType]


class EpisodeState(eqx.Module):
    """State of one environment between two decisions.

    Attributes
    ----------
    time
        Number of decisions since the reset.
    row
        Row of the case in `Parameters.cases`.
    key
        Key of the episode's random numbers.
    vehicle
        State of the aircraft and its parts.
    settled
        Number of latest decisions after which all errors were within the tolerances.
    """

    time: Integer
    row: Integer
    key: UInt32[Array, "2"]
    vehicle: VehicleState
    settled: Integer


@dataclasses.dataclass(frozen=True, eq=False)
class AircraftEnvironment:
    """Environment of one aircraft; hashable, so that `jax.jit(environment.step)` compiles it.

    Attributes
    ----------
    task
        Task, with reward and success.
    level
        Level of action.
    parameters
        Default parameters, `default_params`.
    observed, commanded
        Tables of the entries of observations and actions.
    decision_steps
        Number of integration steps in a decision.
    name, aircraft
        Name of the environment, and of the aircraft.
    """

    task: AbstractTask
    level: AbstractActionLevel
    parameters: Parameters
    observed: tuple[Entry, ...]
    commanded: tuple[Entry, ...]
    decision_steps: int
    name: str
    aircraft: str = "custom"
    transition_gradients_enabled: bool = False

    supports_transition_gradients: ClassVar[bool] = True

    def __deepcopy__(self, memo: Any) -> "AircraftEnvironment":
        return self  # nothing of it can change

    @property
    def default_params(self) -> Parameters:
        """Return the parameters with which the environment was made."""
        return self.parameters

    @property
    def num_actions(self) -> int:
        """Number of entries of an action."""
        return len(self.commanded)

    def with_transition_gradients(self) -> "AircraftEnvironment":
        """Return the environment whose observations and states carry gradients."""
        return dataclasses.replace(self, transition_gradients_enabled=True)

    def observation_space(self, params: Parameters | None = None) -> Box:
        """Return the space of observations: about -1..1 in ordinary flight, without bounds."""
        return Box(-np.inf, np.inf, (len(self.observed),))

    def action_space(self, params: Parameters | None = None) -> Box:
        """Return the space of actions, -1..1."""
        return Box(-1.0, 1.0, (self.num_actions,))

    def reset(self, key: Array, params: Parameters | None = None) -> tuple[Float[Array, " entry"], EpisodeState]:
        """Draw a case and return observation and state at its start.

        Parameters
        ----------
        key
            Key of JAX's default generator, new or raw.
        params
            Parameters; None: `default_params`.
        """
        params = self.parameters if params is None else params
        state = self._initial_state(key, params)
        return self._initial_observation(state, params), state

    def observe(
        self, key: Array, state: EpisodeState, action: Any = None, params: Parameters | None = None
    ) -> Float[Array, " entry"]:
        """Return the observation of a state; key and action have no effect."""
        params = self.parameters if params is None else params
        return self.observation_of(self.situation_of(params.case(state.row), state, params))

    def step(
        self, key: Array, state: EpisodeState, action: Float[Array, " action"], params: Parameters | None = None
    ) -> tuple[Float[Array, " entry"], EpisodeState, Scalar, Flag, Flag, dict[str, Array]]:
        """Fly one decision; an episode that ends is reset within the step.

        Parameters
        ----------
        key
            Key of the next episode, used if this one ends.
        action
            Action, clipped to -1..1.

        Returns
        -------
        Observation and state after the step, or at the start of the next episode; reward, 0..1; whether the episode
        ended by failure (`terminated`), or at its full length (`truncated`). `info` has `final_observation`, the
        observation before the reset, `success`, `terminated`, `truncated` and `discount`.
        """
        params = self.parameters if params is None else params
        observation, flown, reward, terminated, info = self.step_env(key, state, action, params)
        start = self._initial_state(key, params)
        restart = start, self._initial_observation(start, params)
        next_state, next_observation = reset_if(terminated | info["truncated"], restart, (flown, observation))
        return next_observation, next_state, reward, terminated, info["truncated"], info

    def step_env(
        self, key: Array, state: EpisodeState, action: Float[Array, " action"], params: Parameters
    ) -> tuple[Float[Array, " entry"], EpisodeState, Scalar, Flag, dict[str, Array]]:
        """Fly one decision without a reset at the end of an episode; arguments and results otherwise as for `step`."""
        case = params.case(state.row)
        vehicle = self.fly_decision(case, state, action, params)
        flown = dataclasses.replace(state, time=state.time + 1, vehicle=vehicle)
        situation = self.situation_of(case, flown, params)
        errors = self.task.errors(situation)
        terminated = has_failed(self.task, situation)
        reward, observation = self.task.reward(situation, errors), self.observation_of(situation)
        observation, flown, reward, info = end_decision(
            self, flown, errors, reward, terminated, case.decisions, observation
        )
        return observation, flown, reward, terminated, info

    @property
    def settled_decisions(self) -> int:
        """Number of decisions at the end of an episode after which the errors must be within the tolerances."""
        return max(1, round(self.task.settled_s / self.level.decision_s))

    def situation(self, state: EpisodeState, params: Parameters | None = None) -> Situation:
        """Return truth, belief and recorded variables of a state, from which the task computes."""
        params = self.parameters if params is None else params
        return self.situation_of(params.case(state.row), state, params)

    def _initial_state(self, key: Array, params: Parameters) -> EpisodeState:
        row, episode_key = draw_case(key, params)
        return self.start_of_case(row, episode_key, params)

    def start_of_case(self, row: Integer, key: UInt32[Array, "2"], params: Parameters) -> EpisodeState:
        """Return the state at the start of a case, with a key of the episode's random numbers."""
        zero = jnp.zeros((), jnp.int32)
        return EpisodeState(zero, row, key, self.start_aircraft(params.case(row), key, params), zero)

    def start_aircraft(
        self, case: Case, key: UInt32[Array, "2"], params: Parameters, index: ScalarLike = 0
    ) -> VehicleState:
        """Return the state of an aircraft at the start of a case; `index` is its place in a fleet."""
        instant = self.instant(case, jnp.zeros((), jnp.int32), key, params)
        state = trimmed_vehicle(self.flown_vehicle(case, None), instant, case.start, index)
        return cast_to_precision(state, params.step.dtype)

    def _initial_observation(self, state: EpisodeState, params: Parameters) -> Float[Array, " entry"]:
        if params.observations is not None:
            return params.observations[state.row]
        return self.observation_of(self.situation_of(params.case(state.row), state, params))

    def instant(self, case: Case, number: Integer, key: UInt32[Array, "2"], params: Parameters) -> Instant:
        """Return time, step and random numbers of sample `number` since the start of an episode with a key."""
        return Instant(case.environment, number, params.step, SeededRandomness(key))

    def flown_vehicle(self, case: Case, command: Any) -> Vehicle:
        """Return the aircraft of a case with the controller of the action level and a held command."""
        parts = HeldCommand(command), self.level.controller(case.autopilot)
        return eqx.tree_at(lambda v: (v.guidance, v.controller), case.vehicle, parts)

    def fly_decision(
        self, case: Case, state: EpisodeState, action: Float[Array, " action"], params: Parameters
    ) -> VehicleState:
        """Return the state of the aircraft of a case after the integration steps of one decision."""
        first = state.time * self.decision_steps
        belief = perceive(
            self.flown_vehicle(case, None), state.vehicle, self.instant(case, first, state.key, params)
        ).belief
        action = jnp.clip(jnp.asarray(action, params.step.dtype), -1.0, 1.0)
        vehicle = self.flown_vehicle(case, self.level.command(action, case.autopilot, belief))

        def advance(k: Integer, vehicle_state: VehicleState) -> VehicleState:
            instant = self.instant(case, first + k, state.key, params)
            perception = perceive(vehicle, vehicle_state, instant)
            return cast_like(command_and_move(vehicle, vehicle_state, perception, instant)[0], vehicle_state)

        if self.decision_steps == 1:
            return advance(jnp.zeros((), jnp.int32), state.vehicle)
        return jax.lax.fori_loop(0, self.decision_steps, advance, state.vehicle)

    def situation_of(self, case: Case, state: EpisodeState, params: Parameters) -> Situation:
        """Return truth, belief and recorded variables of a case in a state, from which the task computes."""
        number = state.time * self.decision_steps
        instant = self.instant(case, number, state.key, params)
        perception = perceive(self.flown_vehicle(case, None), state.vehicle, instant)
        truth, belief = perception.truth, perception.belief
        estimates = believed_variables(belief)
        variables = estimates if _is_exact(perception) else believed_variables(_true_belief(truth))
        return Situation(case, instant, truth, belief, variables, estimates)

    def observation_of(self, situation: Situation) -> Float[Array, " entry"]:
        """Return the observation in the order of `observed`, normalized, about -1..1 in ordinary flight."""
        motion = self.observed[: len(self.observed) - len(self.task.entries())]
        values = [*(situation.estimates[entry.name] for entry in motion), *self.task.observation(situation)]
        normalized = [entry.normalize(value) for entry, value in zip(self.observed, values, strict=True)]
        return jnp.stack(normalized).astype(jnp.float32)


def _is_exact(perception: Perception) -> bool:
    """Whether the belief is the truth itself, known while a program is traced."""
    pairs = (perception.belief.state, perception.truth.state), (perception.belief.condition, perception.truth.condition)
    return all(a is b for pair in pairs for a, b in zip(*map(jax.tree.leaves, pair), strict=True))


def _true_belief(truth: Truth) -> Belief:
    specific_force_b = truth.condition.wrench.force_b / truth.airframe.mass_properties.mass
    return Belief(truth.airframe, truth.state, truth.condition, specific_force_b, sight=None, goal=None)


def end_decision(
    environment: AircraftEnvironment,
    flown: EpisodeState,  # state after the decision, with the `settled` of before
    errors: Float[Array, "..."],
    reward: Scalar,
    terminated: Flag,
    decisions: Integer,  # number of decisions of the episode
    observation: Float[Array, "..."],
) -> tuple[Float[Array, "..."], EpisodeState, Scalar, dict[str, Array]]:
    """Return observation, state, reward and `info` at the end of a decision, for one aircraft or a fleet."""
    within = jnp.all(jnp.abs(errors) <= 1.0) & ~terminated
    settled = jnp.where(within, flown.settled + 1, 0).astype(flown.settled.dtype)
    flown = dataclasses.replace(flown, settled=settled)
    reward = jnp.where(terminated, 0.0, reward).astype(environment.parameters.step.dtype)
    if not environment.transition_gradients_enabled:
        observation, flown = jax.tree.map(jax.lax.stop_gradient, (observation, flown))
    truncated = ~terminated & (flown.time >= decisions)
    info = {
        "final_observation": observation,
        "success": truncated & (settled >= environment.settled_decisions),
        "terminated": terminated,
        "truncated": truncated,
        "discount": jnp.where(terminated, 0.0, 1.0),
    }
    return observation, flown, reward, info


def reset_if(done: Flag, start: Any, flown: Any) -> Any:
    """Return the start of the next episode if this one is done, otherwise the flown state, leaf by leaf."""
    return jax.tree.map(lambda new, old: jnp.where(done, new, old), start, flown)


def draw_case(key: Array, params: Parameters) -> tuple[Integer, UInt32[Array, "2"]]:
    """Draw the row of a case, and the key of the random numbers of an episode."""
    draws, words = threefry(_key_words(key), jnp.zeros(2, jnp.uint32), jnp.arange(2, dtype=jnp.uint32))
    row = (draws[0] % np.uint32(params.count)).astype(jnp.int32)
    return row, jnp.stack([draws[1], words[1]])


def _key_words(key: Array) -> UInt32[Array, "2"]:
    """Return the two words of a key (typed or raw) of JAX's default generator."""
    words = jax.random.key_data(key) if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else key
    if words.shape != (2,):
        raise ValueError(f"key: arrived words of shape {words.shape}; expected (2,), as of jax.random.key(seed)")
    return words


def has_failed(task: AbstractTask, situation: Situation) -> Flag:
    """Whether an episode ends by failure: of the envelope, the stand-off (which no task lowers) or the task.

    A flight beyond a wind field from a file is a failure too, unless the values of its boundary hold.
    """
    position_n, time = situation.truth.state.position_n, situation.instant.time
    is_outside = has_left_field(situation.instant.environment.wind, position_n, time)
    failure = out_of_envelope(situation) | is_outside | task.has_failed(situation)
    return failure | comes_too_near(situation) if isinstance(situation.case.task, PlannedMission) else failure


def out_of_envelope(situation: Situation) -> Flag:
    """Whether the aircraft reached the ground, exceeded its range of angle of attack by 10 deg, or is not finite."""
    v, airframe = situation.variables, situation.truth.airframe
    low, high = (edge * RAD_DEG for edge in airframe.alpha_range)
    alpha = v["alpha_deg"]
    motion = jnp.stack([v[entry.name] for entry in MOTION])
    is_outside = (alpha < low - _ALPHA_MARGIN_DEG) | (alpha > high + _ALPHA_MARGIN_DEG)
    return (v["altitude_m"] <= 0.0) | is_outside | ~jnp.all(jnp.isfinite(motion))
