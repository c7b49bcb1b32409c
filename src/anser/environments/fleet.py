"""Environment of a fleet: aircraft that meet their goals at one time and keep their separation."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environments.cases import Case, Situation
from anser.environments.environment import AbstractEnvironment, AircraftEnvironment, EpisodeState, Parameters
from anser.environments.planned_tasks import axes_entries, in_course_axes
from anser.environments.spaces import Box, Entry
from anser.numerics.arrays import Stacked
from anser.parts.perception import velocity_over_ground_n
from anser.planning.separation import separation_ratio
from anser.shapes import Flag, Scalar
from anser.spatial.rotations import safe_hypot


@dataclasses.dataclass(frozen=True, eq=False)
class FleetEnvironment(AbstractEnvironment):
    """Environment of several aircraft of one type, which cooperate: the contract of `AircraftEnvironment` with an axis.

    Observations, actions and rewards have a leading axis over the aircraft; the episode ends for all aircraft at once.
    Each aircraft observes its own task and the relative motion of the others. The reward of each aircraft is the mean
    over the fleet. Success means that all aircraft succeed and that no two aircraft came nearer than the separation,
    which ends the episode.
    """

    member: AircraftEnvironment  #: Environment of each aircraft; its cases have axes over cases and aircraft.
    agents: tuple[str, ...]  #: Names of the aircraft.
    #: Horizontal and vertical separation of two aircraft, of which one is required, m; vertical 0: the horizontal one.
    #: None: no separation is required.
    separation_m: tuple[float, float] | None
    observed: tuple[Entry, ...]  #: Entries of an aircraft's observation: those of `member`, then of the others.

    @property
    def single(self) -> AircraftEnvironment:
        """The environment of each aircraft."""
        return self.member

    @property
    def name(self) -> str:
        """Name of the environment."""
        return self.member.name

    @property
    def commanded(self) -> tuple[Entry, ...]:
        """Table of the entries of an action of an aircraft."""
        return self.member.commanded

    def with_transition_gradients(self) -> "FleetEnvironment":
        """Return the environment whose observations and states carry gradients."""
        return dataclasses.replace(self, member=self.member.with_transition_gradients())

    def each(self, function: Callable[..., Any], state: EpisodeState, params: Parameters, *arguments: Any) -> Any:
        """Return `function(case, vehicle, *arguments)` for each aircraft in a state.

        `arguments` and results have a leading axis over the aircraft.
        """
        return self.cases(state, params).map(function, state.vehicle, *arguments)

    def cases(self, state: EpisodeState, params: Parameters) -> Stacked[Case]:
        """Return the cases of the aircraft of an episode."""
        return Stacked(jax.tree.map(lambda leaf: leaf[state.row], params.cases.batched), params.cases.shared)

    def judge(self, situation: Situation) -> tuple[Float[Array, "aircraft error"], Float[Array, " aircraft"], Flag]:
        """Return errors, the mean reward for each aircraft, and whether an aircraft failed or two came too near."""
        errors, rewards, failures = jax.vmap(self.member.judge)(situation)
        positions_n = situation.truth.state.position_n
        is_near = jnp.asarray(False)
        if self.separation_m is not None:
            first, second = np.triu_indices(len(self.agents), 1)
            apart_n = positions_n[first] - positions_n[second]
            level, height = safe_hypot(apart_n[:, 0], apart_n[:, 1]), jnp.abs(apart_n[:, 2])
            is_near = jnp.min(separation_ratio(level, height, *self.separation_m)) < 1.0
        return errors, jnp.full(len(self.agents), jnp.mean(rewards)), jnp.any(failures) | is_near

    def observation_of(self, situation: Situation) -> Float[Array, "aircraft entry"]:
        """Return the observations in the order of `observed`, normalized, about -1..1 in ordinary flight."""
        own = jax.vmap(self.member.observation_of)(situation)
        belief, count = situation.belief, len(self.agents)
        velocities_n = jax.vmap(velocity_over_ground_n)(belief.condition, belief.state)
        entries = self.observed[len(self.member.observed) :]

        def others(index: Array, situation: Situation) -> Array:
            parts: list[Scalar] = []
            for number in range(1, count):
                other = (index + number) % count
                for vectors in (belief.state.position_n, velocities_n):
                    parts.extend(in_course_axes(situation, vectors[other] - vectors[index]))
            return jnp.stack([entry.normalize(part) for entry, part in zip(entries, parts, strict=True)])

        relative = jax.vmap(others)(jnp.arange(count), situation)
        return jnp.concatenate([own, relative.astype(own.dtype)], axis=-1)


def entries_of_others(count: int) -> tuple[Entry, ...]:
    """Return the table of the relative motion of the other aircraft, in the observation of one of `count` aircraft."""
    position, velocity = "Position of another aircraft relative to this one", "Velocity of that aircraft less own"
    tables = [
        axes_entries(f"other_{number}", "m", "m", 5000.0, position)
        + axes_entries(f"other_{number}_velocity", "m s-1", "m_s", 200.0, velocity)
        for number in range(1, count)
    ]
    return sum(tables, ())


class AgentDictionaries:
    """Environment of a fleet whose observations, actions, rewards and ends are dictionaries by agent.

    The contract is that of JaxMARL's `MultiAgentEnv`, in pure functions of keys and states: an episode that ends is
    reset within the step, and the entry `__all__` of the ends tells so. Entries of `info` have a value per agent; with
    `final_observations`, `info["final_observation"]` has the observations before the reset, (agent, entry).
    """

    def __init__(self, environment: Any, *, final_observations: bool = False) -> None:
        self.environment, self.final_observations = environment, final_observations
        self.name: str = environment.name
        self.agents: list[str] = list(environment.agents)
        self.num_agents = len(self.agents)
        self.observation_spaces: dict[str, Box] = {agent: environment.observation_space() for agent in self.agents}
        self.action_spaces: dict[str, Box] = {agent: environment.action_space() for agent in self.agents}

    def observation_space(self, agent: str) -> Box:
        """Return the space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Return the space of an agent's actions."""
        return self.action_spaces[agent]

    def reset(self, key: Array, params: Any = None) -> tuple[dict[str, Array], Any]:
        """Return the observations by agent and the state at the start of an episode."""
        observations, state = self.environment.reset(key, params)
        return self.by_agent(observations), state

    def step(
        self, key: Array, state: Any, actions: dict[str, Array], params: Any = None
    ) -> tuple[dict[str, Array], Any, dict[str, Array], dict[str, Array], dict[str, Array]]:
        """Fly one decision; return observations, state, rewards, ends by agent and of `__all__`, and info."""
        stacked = jnp.stack([actions[agent] for agent in self.agents])
        observations, state, rewards, terminated, truncated, info = self.environment.step(key, state, stacked, params)
        is_over: Array = terminated | truncated
        ends = dict.fromkeys((*self.agents, "__all__"), is_over)
        final = info.pop("final_observation")
        values = {name: jnp.broadcast_to(value, (self.num_agents,)) for name, value in info.items()}
        if self.final_observations:
            values["final_observation"] = final
        return self.by_agent(observations), state, self.by_agent(rewards), ends, values

    def by_agent(self, values: Array) -> dict[str, Array]:
        """Return the rows of an array by agent."""
        return {agent: values[k] for k, agent in enumerate(self.agents)}
