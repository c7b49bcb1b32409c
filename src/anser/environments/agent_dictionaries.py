"""Fleets with dictionaries of agents, as JaxMARL has them: pure functions of keys and states."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from anser.environments.spaces import Box


class AgentDictionaries:
    """Environment of a fleet whose observations, actions, rewards and ends are dictionaries by agent.

    The contract is that of JaxMARL's `MultiAgentEnv`: an episode that ends is reset within the step, and the entry
    `__all__` of the ends tells so. Entries of `info` have a value per agent.

    Parameters
    ----------
    environment
        Environment of a fleet from `anser.environments.make`.
    final_observations
        True: `info["final_observation"]` has the observations before the reset, (agent, entry).
    """

    def __init__(self, environment: Any, *, final_observations: bool = False) -> None:
        self.environment, self.final_observations = environment, final_observations
        self.agents: list[str] = list(environment.agents)
        self.num_agents = len(self.agents)
        self.observation_spaces = {agent: environment.observation_space() for agent in self.agents}
        self.action_spaces = {agent: environment.action_space() for agent in self.agents}

    @property
    def name(self) -> str:
        """Name of the environment."""
        return self.environment.name

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
        """Fly one decision of every agent.

        Returns
        -------
        Observations by agent, state, rewards by agent, ends by agent and of `__all__`, and info.
        """
        stacked = jnp.stack([actions[agent] for agent in self.agents])
        observations, state, rewards, terminated, truncated, info = self.environment.step(key, state, stacked, params)
        is_over = terminated | truncated
        ends = {**dict.fromkeys(self.agents, is_over), "__all__": is_over}
        values = {
            name: jnp.broadcast_to(value, (self.num_agents,))
            for name, value in info.items()
            if name != "final_observation"
        }
        if self.final_observations:
            values["final_observation"] = info["final_observation"]
        return self.by_agent(observations), state, self.by_agent(rewards), ends, values

    def by_agent(self, values: Array) -> dict[str, Array]:
        """Return the rows of an array by agent."""
        return {agent: values[k] for k, agent in enumerate(self.agents)}
