"""Fleets for PettingZoo 1.25 and later: every aircraft is an agent, and the agents act at the same time."""

from typing import Any

import numpy as np

from anser.environments.gymnasium_environments import EpisodeSequence, box_spaces, compiled_environment
from anser.results.documents import install_hint

try:
    import gymnasium
    from pettingzoo import ParallelEnv
except ImportError:
    raise ImportError(install_hint("PettingZoo", "learning")) from None


class FleetParallelEnvironment(ParallelEnv):
    """A fleet with a task, as `pettingzoo.ParallelEnv`.

    Every aircraft is an agent. An episode ends for all agents at once; `infos` then have `is_success`. `task` must be
    "FleetArrival", a task of a fleet, or a `FleetEnvironment`. For observations, actions and other arguments see
    `GymnasiumEnvironment`.
    """

    def __init__(self, task: Any, action: str | None = None, **options: Any) -> None:
        compiled = compiled_environment(task, action, options)
        self._episodes = EpisodeSequence(compiled)
        self.environment: Any = compiled.environment
        if not hasattr(self.environment, "agents"):
            raise ValueError(
                f"task: arrived {self.environment.name}, a task of one aircraft; expected a task of a fleet, such as "
                "FleetArrival; GymnasiumEnvironment flies one aircraft"
            )
        self.metadata = {"name": self.environment.name, "render_modes": []}
        self.render_mode = None
        self.possible_agents: list[str] = list(self.environment.agents)
        self.agents: list[str] = []
        self._spaces = {agent: box_spaces(self.environment) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> gymnasium.spaces.Box:
        """Return the space of an agent's observations."""
        return self._spaces[agent][0]

    def action_space(self, agent: str) -> gymnasium.spaces.Box:
        """Return the space of an agent's actions."""
        return self._spaces[agent][1]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Start the next episode, or the first episode of `seed`; return observations and empty infos by agent.

        `options` has no effect.
        """
        observations = self._episodes.reset(seed, np.random.default_rng())
        self.agents = list(self.possible_agents)
        return self._by_agent(observations), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Fly one decision; return observations, rewards, terminations, truncations and infos, each by agent.

        Raises ValueError before a reset, after the end of an episode, and if an agent has no valid action.
        """
        if not (agents := self.agents):
            raise ValueError("step: arrived before a reset, or after the end of the episode; expected reset()")
        if absent := sorted(set(agents) - set(actions)):
            raise ValueError(f"actions: arrived none of {', '.join(absent)}; expected one of each agent")
        shape = len(agents), *self.environment.action_space().shape
        results = self._episodes.step([actions[agent] for agent in agents], shape)
        observations, rewards, terminated, truncated, success = results
        is_over = terminated or truncated
        self.agents = [] if is_over else agents
        return (
            self._by_agent(observations),
            dict(zip(agents, rewards.astype(float).tolist(), strict=True)),
            dict.fromkeys(agents, terminated),
            dict.fromkeys(agents, truncated),
            {agent: {"is_success": success} if is_over else {} for agent in agents},
        )

    def _by_agent(self, values: np.ndarray) -> dict[str, np.ndarray]:
        return {agent: values[k] for k, agent in enumerate(self.possible_agents)}
