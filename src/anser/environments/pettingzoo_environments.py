"""Fleets for PettingZoo 1.25 and later: every aircraft is an agent, and the agents act at the same time."""

from typing import Any

import jax
import numpy as np

from anser.environments.gymnasium_environments import (
    OBSERVATION_MAX,
    CompiledEnvironment,
    box_space,
    check_actions,
    compiled_environment,
    seed_words,
)
from anser.results.documents import install_hint

try:
    import gymnasium
    from pettingzoo import ParallelEnv
except ImportError:
    raise ImportError(install_hint("PettingZoo", "learning")) from None


class FleetParallelEnvironment(ParallelEnv):
    """A fleet with a task, as `pettingzoo.ParallelEnv`.

    Observations are float32 vectors, about -1..1 in ordinary flight and clipped to -100..100; actions are -1..1. An
    episode ends for every agent at once; `infos` then have `is_success`.

    Parameters
    ----------
    task
        Name of a task of a fleet, or an environment of a fleet.
    action
        Level of action; None: that of the task.
    **options
        Further arguments of `anser.environments.make`.
    """

    def __init__(self, task: Any, action: str | None = None, **options: Any) -> None:
        self._compiled: CompiledEnvironment = compiled_environment(task, action, options)
        self.environment: Any = self._compiled.environment
        self.metadata = {"name": self.environment.name, "render_modes": []}
        self.render_mode = None
        self.possible_agents: list[str] = list(self.environment.agents)
        self.agents: list[str] = []
        observed = self.environment.observation_space().shape[0]
        commanded = self.environment.action_space().shape[0]
        self._observation_spaces = {agent: box_space(OBSERVATION_MAX, observed) for agent in self.possible_agents}
        self._action_spaces = {agent: box_space(1.0, commanded) for agent in self.possible_agents}
        self._key: np.ndarray | None = None
        self._number = 0
        self._state: list[jax.Array] | None = None

    def observation_space(self, agent: str) -> gymnasium.spaces.Box:
        """Return the space of an agent's observations."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.spaces.Box:
        """Return the space of an agent's actions."""
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Start the next episode; with a seed, the first episode of the seed. Options have no effect."""
        if seed is not None or self._key is None:
            drawn = np.random.default_rng().integers(2**32, size=2, dtype=np.uint32)
            self._key, self._number = drawn if seed is None else seed_words(seed), 0
        else:
            self._number += 1
        observations, self._state = self._compiled.reset(self._compiled.parameters, self._key, np.uint32(self._number))
        self.agents = list(self.possible_agents)
        return self._by_agent(np.array(observations)), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Fly one decision of every agent; return observations, rewards, ends and infos, each by agent."""
        if self._state is None or not self.agents:
            raise ValueError("step: arrived before a reset, or after the end of the episode; expected reset()")
        absent = sorted(set(self.agents) - set(actions))
        if absent:
            raise ValueError(f"actions: arrived none of {', '.join(absent)}; expected one of each agent")
        shape = len(self.agents), self.environment.action_space().shape[0]
        checked = check_actions([actions[agent] for agent in self.agents], shape)
        observations, self._state, rewards, terminated, truncated, success = self._compiled.step(
            self._compiled.parameters, self._state, checked
        )
        is_over = bool(terminated) or bool(truncated)
        agents = self.agents
        infos: dict[str, dict[str, Any]] = {agent: {"is_success": bool(success)} if is_over else {} for agent in agents}
        self.agents = [] if is_over else agents
        return (
            self._by_agent(np.array(observations)),
            dict(zip(agents, np.asarray(rewards).astype(float).tolist(), strict=True)),
            dict.fromkeys(agents, bool(terminated)),
            dict.fromkeys(agents, bool(truncated)),
            infos,
        )

    def _by_agent(self, values: np.ndarray) -> dict[str, np.ndarray]:
        return {agent: values[k] for k, agent in enumerate(self.possible_agents)}
