"""Environments for the wrappers of gymnax 1.0 that convert spaces: gymnax's class and spaces around an environment.

gymnax 1.0.1 needs gymnasium < 1.4 and jax < 0.12, and is no dependency of anser. Training loops and most wrappers take
an `AircraftEnvironment` as it is, for it has the functions of gymnax's environments.
"""

from functools import partial
from typing import Any

import jax
from gymnax.environments import spaces
from gymnax.environments.environment import Environment

from anser.environments.environment import AircraftEnvironment, EpisodeState, Parameters


class GymnaxEnvironment(Environment):
    """An environment as a subclass of gymnax's.

    Parameters
    ----------
    environment
        Environment from `anser.environments.make`.
    """

    _supports_transition_gradients = True

    def __init__(self, environment: AircraftEnvironment) -> None:
        self.environment = environment

    @property
    def default_params(self) -> Parameters:
        """Parameters with which the environment was made."""
        return self.environment.default_params

    @property
    def name(self) -> str:
        """Name of the environment."""
        return self.environment.name

    @property
    def num_actions(self) -> int:
        """Number of entries of an action."""
        return self.environment.num_actions

    def with_transition_gradients(self) -> "GymnaxEnvironment":
        """Return the environment whose observations and states carry gradients."""
        configured = GymnaxEnvironment(self.environment.with_transition_gradients())
        configured._transition_gradients_enabled = True
        return configured

    @partial(jax.jit, static_argnames=("self",))
    def reset(self, key: jax.Array, params: Parameters | None = None) -> tuple[jax.Array, EpisodeState]:
        """Return observation and state at the start of an episode."""
        return self.environment.reset(key, params)

    @partial(jax.jit, static_argnames=("self",))
    def step(
        self, key: jax.Array, state: EpisodeState, action: jax.Array, params: Parameters | None = None
    ) -> tuple[jax.Array, EpisodeState, jax.Array, jax.Array, jax.Array, dict[str, jax.Array]]:
        """Fly one decision; an episode that ends is reset within the step."""
        return self.environment.step(key, state, action, params)

    def observe(self, key: jax.Array, state: EpisodeState, action: Any, params: Parameters) -> jax.Array:
        """Return the observation of a state."""
        return self.environment.observe(key, state, action, params)

    def observation_space(self, params: Parameters) -> Any:
        """Return the space of observations."""
        return self._box(self.environment.observation_space(params))

    def action_space(self, params: Parameters) -> Any:
        """Return the space of actions."""
        return self._box(self.environment.action_space(params))

    def _box(self, box: Any) -> Any:
        return spaces.Box(box.low, box.high, box.shape, box.dtype)
