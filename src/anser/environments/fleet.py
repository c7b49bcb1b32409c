"""Environment of a fleet whose aircraft arrive at their goals at one time and keep their separation."""

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
    """Environment of several cooperating aircraft of one type, with the functions of `AircraftEnvironment`.

    Observations, actions and rewards have a leading axis over the aircraft; the episode ends for all aircraft at once.
    The episode ends by failure if one aircraft fails, or if two aircraft are nearer than the separation. Success means
    that all aircraft succeed.
    """

    member: AircraftEnvironment  #: Environment of each aircraft; the cases have the axes (case, aircraft).
    agents: tuple[str, ...]  #: Names of the aircraft.
    #: Horizontal and vertical separation, m. Two aircraft are too near if both distances are smaller. If the vertical
    #: separation is 0, only the horizontal distance counts. None: no separation is required.
    separation_m: tuple[float, float] | None
    #: Table of the entries of one aircraft's observation: the entries of `member`, then `entries_of_others`.
    observed: tuple[Entry, ...]

    @property
    def single(self) -> AircraftEnvironment:
        """Environment of each aircraft, `member`."""
        return self.member

    @property
    def name(self) -> str:
        """Name of the task."""
        return self.member.name

    @property
    def commanded(self) -> tuple[Entry, ...]:
        """Table of the entries of one aircraft's action."""
        return self.member.commanded

    def with_transition_gradients(self) -> "FleetEnvironment":
        """Return a copy whose `step` has gradients of observation, state and reward, instead of the reward alone."""
        return dataclasses.replace(self, member=self.member.with_transition_gradients())

    def each(self, function: Callable[..., Any], state: EpisodeState, params: Parameters, *arguments: Any) -> Any:
        """Call `function(case, vehicle, *arguments)` for each aircraft, and return the results.

        `vehicle` is the aircraft's state. `arguments` and results have a leading axis over the aircraft.
        """
        return self.cases(state, params).map(function, state.vehicle, *arguments)

    def cases(self, state: EpisodeState, params: Parameters) -> Stacked[Case]:
        """Return the cases of all aircraft in an episode, stacked in the order of `agents`."""
        return Stacked(jax.tree.map(lambda leaf: leaf[state.row], params.cases.batched), params.cases.shared)

    def judge(self, situation: Situation) -> tuple[Float[Array, "aircraft error"], Float[Array, " aircraft"], Flag]:
        """Return errors divided by the tolerances, rewards (0..1), and whether the episode ends by failure.

        The reward of every aircraft is the mean over the fleet.
        """
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
        """Return the observation of each aircraft in the order of `observed`, about -1..1 in ordinary flight.

        Aircraft k of n observes the other aircraft in the order k + 1, k + 2, ..., modulo n. The relative motion comes
        from each aircraft's own estimate of position and velocity.
        """
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
    """Return the table entries of the other aircraft's relative motion, in a fleet of `count` aircraft.

    Each other aircraft has position (m) and velocity (m/s) relative to the observing aircraft, with components along
    the observing aircraft's course, to the right and upwards.
    """
    position, velocity = "Position of another aircraft relative to this one", "Velocity of that aircraft less own"
    tables = [
        axes_entries(f"other_{number}", "m", "m", 5000.0, position)
        + axes_entries(f"other_{number}_velocity", "m s-1", "m_s", 200.0, velocity)
        for number in range(1, count)
    ]
    return sum(tables, ())


class AgentDictionaries:
    """Environment of a fleet that takes and returns dictionaries by agent's name, as JaxMARL's `MultiAgentEnv` does.

    The methods are pure functions. Entries of `info` are arrays with one value per agent. If the argument
    `final_observations` is true, `info["final_observation"]` has the observations before a reset, shape (agent, entry).
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
        """Fly one decision; return observations by agent, state, rewards by agent, ends by agent, and info.

        An end is True if the episode ended, by failure or at full length; all agents and the entry `__all__` have the
        same value. At an end, `key` selects the next episode, and observations and state are values at its start.
        """
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
        """Return the values along the first axis (in the order of `agents`) as a dictionary by agent's name."""
        return {agent: values[k] for k, agent in enumerate(self.agents)}
