"""Scripted expert of each task, episodes under a policy, and scores: the share of successes, and the mean return."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.control.inversion_autopilot import InversionAutopilot
from anser.environments.cases import Case, Situation
from anser.environments.environment import AircraftEnvironment, EpisodeState, Parameters
from anser.environments.fleet import FleetEnvironment
from anser.numerics.arrays import cast_like
from anser.shapes import Integer

Policy = Callable[[Array, Float[Array, " entry"], EpisodeState, Any], tuple[Float[Array, " action"], Any]]
"""Function from a key, the observation, the state and the policy's own state to an action and that state."""


@dataclasses.dataclass(frozen=True, eq=False)
class Expert:
    """The autopilot by dynamic inversion, which flies a task through the environment's level of action.

    The autopilot computes its commands once in each decision; what the level takes of them is the action. Each aircraft
    of a fleet has its own autopilot.
    """

    environment: AircraftEnvironment | FleetEnvironment

    @property
    def _member(self) -> AircraftEnvironment:
        environment = self.environment
        return environment.member if isinstance(environment, FleetEnvironment) else environment

    def _autopilot(self, case: Case) -> InversionAutopilot:
        autopilot = case.autopilot
        return InversionAutopilot(autopilot.gains, autopilot.limits, loop=self._member.task.expert_loop)

    def _start(self, case: Case, dtype: Any) -> Any:
        start = case.start
        settled = self._autopilot(case).init(start.state, jnp.stack([start.mu, start.alpha, start.beta]))
        return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), settled)

    def _act(
        self, situation: Situation, time: Integer, expert_state: Any, params: Parameters
    ) -> tuple[Float[Array, " action"], Any]:
        member, case = self._member, situation.case
        start = self._start(case, params.step.dtype)
        expert_state = jax.tree.map(lambda new, old: jnp.where(time == 0, new, old), start, expert_state)
        command = member.task.expert_command(situation)
        step = params.step * member.decision_steps
        controls, signals, advanced = self._autopilot(case).control(expert_state, situation.belief, command, step)
        action = member.level.action(controls, signals, command, case.autopilot, situation.belief)
        return action, cast_like(advanced, expert_state)

    def init(self, state: EpisodeState, params: Parameters) -> Any:
        """Return the state of the autopilot at the start of an episode; leading axis aircraft for a fleet."""
        if isinstance(self.environment, FleetEnvironment):
            return self.environment.cases(state, params).map(lambda case: self._start(case, params.step.dtype))
        return self._start(params.case(state.row), params.step.dtype)

    def act(self, state: EpisodeState, expert_state: Any, params: Parameters) -> tuple[Float[Array, "..."], Any]:
        """Return the action in a state, and the new state of the expert, which begins anew with each episode."""
        if isinstance(self.environment, FleetEnvironment):
            situations = self.environment.situations(state, params)
            return jax.vmap(lambda situation, own: self._act(situation, state.time, own, params))(
                situations, expert_state
            )
        return self._act(self.environment.situation(state, params), state.time, expert_state, params)


@dataclasses.dataclass(frozen=True)
class Score:
    """Result of a policy over many episodes.

    Attributes
    ----------
    success
        Share of episodes that ended with success.
    mean_return
        Mean of the sum of rewards, divided by the number of decisions of a full episode: 0..1.
    failed
        Share of episodes that ended by failure.
    successes
        Success of each episode.
    """

    success: float
    mean_return: float
    failed: float
    successes: np.ndarray


def score(
    environment: AircraftEnvironment | FleetEnvironment,
    policy: str | Policy = "expert",
    episodes: int = 1000,
    seed: int = 1,
) -> Score:
    """Fly episodes under a policy.

    Parameters
    ----------
    policy
        "expert", "zero", "random", or a function `(key, observation, state, policy_state)` to action and policy state.
    episodes, seed
        Number of episodes, and seed of their starts and of the random actions.
    """
    params = environment.default_params
    decisions = int(np.max(np.asarray(params.cases.batched.decisions)))
    function = resolve_policy(environment, policy)

    @jax.jit
    def fly(keys: Array, params: Parameters) -> tuple[Array, Array, Array]:
        return jax.vmap(lambda key: _episode(environment, function, key, params, decisions))(keys)

    returns, successes, failures = map(np.asarray, fly(jax.random.split(jax.random.key(seed), episodes), params))
    return Score(float(successes.mean()), float(returns.mean()), float(failures.mean()), successes)


def _episode(
    environment: AircraftEnvironment | FleetEnvironment,
    policy: "ResolvedPolicy",
    key: Array,
    params: Parameters,
    decisions: int,
) -> tuple[Array, Array, Array]:
    """Fly one episode; return the mean reward per decision (0..1), and whether it ended with success and by failure."""
    observation, state = environment.reset(key, params)

    def advance(carry: Any, number: Array) -> tuple[Any, None]:
        observation, state, policy_state, total, success, failure, done = carry
        step_key = jax.random.fold_in(key, number)
        action, policy_state = policy.act(step_key, observation, state, policy_state, params)
        observation, flown, reward, terminated, info = environment.step_env(step_key, state, action, params)
        total = total + jnp.where(done, 0.0, jnp.mean(reward))
        success, failure = success | (info["success"] & ~done), failure | (terminated & ~done)
        done = done | terminated | info["truncated"]
        state = jax.tree.map(lambda new, old: jnp.where(done, old, new), flown, state)
        return (observation, state, policy_state, total, success, failure, done), None

    no = jnp.zeros((), bool)
    carry = observation, state, policy.init(state, params), jnp.zeros((), params.step.dtype), no, no, no
    (_, final, _, total, success, failure, _), _ = jax.lax.scan(advance, carry, jnp.arange(decisions))
    return total / jnp.max(params.cases.batched.decisions[final.row]), success, failure


@dataclasses.dataclass(frozen=True)
class ResolvedPolicy:
    """A policy as two functions: `init` returns its state at an episode's start, `act` an action and its new state.

    The arguments of `act`: key, observation, state of the episode, state of the policy, parameters.
    """

    init: Callable[[EpisodeState, Parameters], Any]
    act: Callable[[Array, Array, EpisodeState, Any, Parameters], tuple[Array, Any]]


def resolve_policy(environment: AircraftEnvironment | FleetEnvironment, policy: str | Policy) -> ResolvedPolicy:
    """Return a policy as functions `init` and `act`: "expert", "zero" or "random" by name, or a user's function.

    Raises ValueError for an unknown name.
    """
    if callable(policy):
        return ResolvedPolicy(
            lambda state, params: None, lambda key, obs, state, own, params: policy(key, obs, state, own)
        )
    if policy == "expert":
        expert = Expert(environment)
        return ResolvedPolicy(expert.init, lambda key, obs, state, own, params: expert.act(state, own, params))
    space = environment.action_space()
    shape = (len(environment.agents), *space.shape) if isinstance(environment, FleetEnvironment) else space.shape
    if policy == "zero":
        return ResolvedPolicy(lambda state, params: None, lambda *_: (jnp.zeros(shape), None))
    if policy == "random":
        return ResolvedPolicy(
            lambda state, params: None, lambda key, *_: (jax.random.uniform(key, shape, jnp.float32, -1.0, 1.0), None)
        )
    raise ValueError(f'policy: arrived {policy!r}; expected "expert", "zero", "random", or a function')
