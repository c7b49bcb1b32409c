"""Environments for Gymnasium 1.1 and later: one aircraft, or many at once with a reset within the step.

Importing the module registers every task as `anser/VelocityCommand-v0` and so on, for `gymnasium.make` and
`gymnasium.make_vec`. Episode number k after `reset(seed=s)` is that of
`environment.reset(jax.random.fold_in(jax.random.key(s), k))`, alone or in a batch.
"""

import functools
import pickle
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.environments.environment import AircraftEnvironment, EpisodeState
from anser.environments.fleet import FleetEnvironment
from anser.environments.recording import figure_pixels, record_flight
from anser.environments.registry import TASKS, make
from anser.environments.tasks import AbstractTask
from anser.results.documents import install_hint
from anser.single_aircraft.flight import AircraftFlight

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    raise ImportError(install_hint("Gymnasium", "learning")) from None

OBSERVATION_MAX = 100.0
"""Greatest magnitude of an entry of an observation: entries beyond it are clipped. Ordinary flight has about 1."""
_FRAME_S = 20.0


class CompiledEnvironment:
    """Compiled functions of an environment, for Gymnasium and PettingZoo.

    The parameters and states are flat lists of arrays: a call costs microseconds.

    Attributes
    ----------
    environment
        The environment.
    parameters
        Arrays of its parameters.
    reset, reset_batch
        Start of an episode by key and number, and starts of a batch.
    step, step_batch
        A decision without a reset, and decisions of a batch with a reset within the step.
    """

    def __init__(self, environment: AircraftEnvironment | FleetEnvironment) -> None:
        self.environment = environment
        self.parameters, self._parameter_structure = jax.tree.flatten(environment.default_params)
        shapes = jax.eval_shape(lambda: environment.reset(jax.random.key(0)))
        self._state_structure = jax.tree.structure(shapes[1])
        self.reset = jax.jit(self._reset)
        self.reset_batch = jax.jit(jax.vmap(self._reset, in_axes=(None, 0, 0)))
        self.step = jax.jit(self._step)
        self.step_batch = jax.jit(self._step_batch, donate_argnums=1)

    def state(self, leaves: list[Array]) -> EpisodeState:
        """Return the state of an episode from its flat list of arrays."""
        return self._state_structure.unflatten(leaves)

    def _reset(self, parameters: list[Array], key: Array, number: Array) -> tuple[Array, list[Array]]:
        params = self._parameter_structure.unflatten(parameters)
        observation, state = self.environment.reset(jax.random.fold_in(key, number), params)
        return _bounded(observation), jax.tree.leaves(state)

    def _step(self, parameters: list[Array], state: list[Array], action: Array) -> tuple[Any, ...]:
        params = self._parameter_structure.unflatten(parameters)
        unused = jnp.zeros(2, jnp.uint32)
        observation, flown, reward, terminated, info = self.environment.step_env(
            unused, self._state_structure.unflatten(state), action, params
        )
        return _bounded(observation), jax.tree.leaves(flown), reward, terminated, info["truncated"], info["success"]

    def _step_batch(
        self, parameters: list[Array], state: list[Array], keys: Array, numbers: Array, actions: Array
    ) -> tuple[Any, ...]:
        params = self._parameter_structure.unflatten(parameters)

        def step(leaves: list[Array], key: Array, number: Array, action: Array) -> tuple[Any, ...]:
            next_key = jax.random.fold_in(key, number + 1)
            observation, flown, reward, terminated, truncated, info = self.environment.step(
                next_key, self._state_structure.unflatten(leaves), action, params
            )
            number = number + (terminated | truncated)
            result = _bounded(observation), reward, terminated, truncated
            return *result, _bounded(info["final_observation"]), info["success"], jax.tree.leaves(flown), number

        return jax.vmap(step)(state, keys, numbers, actions)


def _bounded(observation: Array) -> Array:
    return jnp.clip(jnp.nan_to_num(observation), -OBSERVATION_MAX, OBSERVATION_MAX)


def default_level(task: str | AbstractTask) -> str:
    """Return the level of action if none is chosen: body rates, or the first of the levels of a task without them."""
    if task in TASKS or not isinstance(task, str):
        levels = (TASKS[task]() if isinstance(task, str) else task).levels
        return "rates" if "rates" in levels else levels[0]
    return "rates"


@functools.lru_cache(maxsize=4)
def _compile(environment: AircraftEnvironment | FleetEnvironment) -> CompiledEnvironment:
    return CompiledEnvironment(environment)


@functools.lru_cache(maxsize=4)
def _make_named(task: str, action: str, options: bytes) -> AircraftEnvironment | FleetEnvironment:
    return make(task, action, **dict(pickle.loads(options)))


def compiled_environment(task: Any, action: str | None, options: Mapping[str, Any]) -> CompiledEnvironment:
    """Return a task's environment with its compiled functions.

    Environments with the same arguments are one object, and so are the compiled functions of one environment.

    Parameters
    ----------
    task
        Name of a task, an own task, or an environment.
    action
        Level of action; None: body rates, if the task has them.
    options
        Further arguments of `anser.environments.make`.
    """
    if isinstance(task, str | AbstractTask):
        level = default_level(task) if action is None else action
        if isinstance(task, str):
            return _compile(_make_named(task, level, pickle.dumps(sorted(options.items()))))
        return _compile(make(task, level, **options))
    if action is not None or options:
        names = ", ".join(["action"] * (action is not None) + sorted(options))
        raise ValueError(f"task: arrived an environment with {names}; expected the environment alone")
    return _compile(task)


def seed_words(seed: int) -> np.ndarray:
    """Return the words of `jax.random.key(seed)`."""
    return np.array([seed >> 32 & 0xFFFFFFFF, seed & 0xFFFFFFFF], np.uint32)


def check_actions(actions: Any, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Return actions as float32. Raises ValueError for another shape and for numbers that are not finite."""
    array = np.asarray(actions, np.float32)
    if array.shape != shape:
        raise ValueError(f"action: arrived the shape {array.shape}; expected {shape}")
    if not np.isfinite(array).all():
        place = np.argwhere(~np.isfinite(array))[0].tolist()
        raise ValueError(f"action: arrived {array[tuple(place)]} at index {place}; expected finite numbers, -1..1")
    return array


def box_space(limit: float, count: int) -> gymnasium.spaces.Box:
    """Return the space of float32 vectors between -limit and limit."""
    return gymnasium.spaces.Box(-limit, limit, (count,), np.float32)


class GymnasiumEnvironment(gymnasium.Env):
    """One aircraft with a task, as `gymnasium.Env`.

    Observations are float32 vectors, about -1..1 in ordinary flight and clipped to -100..100; actions are -1..1.
    `environment.observed` and `environment.commanded` are the tables of their entries. `info` has `is_success` at the
    end of an episode. Options of `reset` have no effect.

    Parameters
    ----------
    task
        Name of a task, an own task, or an `AircraftEnvironment`, whose compiled program all wrappers of it share.
    action
        Level of action: "surfaces", "rates" or "velocity"; None: "rates", if the task has it.
    render_mode
        "rgb_array": `render` returns the figures of the flight report over the latest 20 s of the episode.
    **options
        Further arguments of `anser.environments.make`: `aircraft`, `cases`, `precision`, tables of a scenario, ...
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - Gymnasium's name and type

    def __init__(
        self,
        task: str | AbstractTask | AircraftEnvironment,
        action: str | None = None,
        *,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        self._compiled = compiled_environment(task, action, options)
        self.environment = _one_aircraft(self._compiled)
        self.render_mode = _check_render_mode(render_mode, self.metadata["render_modes"])
        self.observation_space = box_space(OBSERVATION_MAX, len(self.environment.observed))
        self.action_space = box_space(1.0, self.environment.num_actions)
        self._key: np.ndarray | None = None
        self._number = 0
        self._state: list[Array] | None = None
        self._start: list[Array] = []
        self._actions: list[np.ndarray] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Start the next episode; with a seed, the first episode of the seed."""
        super().reset(seed=seed)
        if seed is not None or self._key is None:
            self._key = self.np_random.integers(2**32, size=2, dtype=np.uint32) if seed is None else seed_words(seed)
            self._number = 0
        else:
            self._number += 1
        observation, state = self._compiled.reset(self._compiled.parameters, self._key, np.uint32(self._number))
        self._state, self._start, self._actions = state, state, []
        return np.array(observation), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly one decision; return observation, reward, `terminated`, `truncated` and `info`."""
        if self._state is None:
            raise ValueError("step: arrived before the first reset; expected reset() before step()")
        checked = check_actions(action, (self.environment.num_actions,))
        observation, self._state, reward, terminated, truncated, success = self._compiled.step(
            self._compiled.parameters, self._state, checked
        )
        self._actions.append(checked.copy())
        is_over = bool(terminated) or bool(truncated)
        info = {"is_success": bool(success)} if is_over else {}
        return np.array(observation), float(reward), bool(terminated), bool(truncated), info

    def flight(self) -> AircraftFlight:
        """Return the flight of the episode so far: variables of the catalogue at every step, figure and report."""
        if self._state is None:
            raise ValueError("flight: arrived before the first reset; expected reset() before flight()")
        start = self._compiled.state(self._start)
        actions = np.array(self._actions, np.float32).reshape(len(self._actions), self.environment.num_actions)
        return record_flight(self.environment, start, actions)

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the figures of the latest 20 s of the episode as pixels."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() has no effect without gymnasium.make(..., render_mode="rgb_array")')
            return None
        dataset = self.flight().dataset
        latest = dataset.sel(time=slice(float(dataset.time[-1]) - _FRAME_S, None))
        return figure_pixels(AircraftFlight(latest).plot())


class GymnasiumVectorEnvironment(VectorEnv):
    """Many aircraft with a task, as `gymnasium.vector.VectorEnv`: one compiled program per step.

    An episode that ends is reset within the step (`AutoresetMode.SAME_STEP`): `info["final_obs"]` has the last
    observation, `info["final_info"]` the last `is_success`, as `gymnasium.vector.SyncVectorEnv` has them.

    Parameters
    ----------
    task, action, **options
        As for `GymnasiumEnvironment`.
    num_envs
        Number of aircraft.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012 - Gymnasium's type

    def __init__(
        self,
        task: str | AbstractTask | AircraftEnvironment,
        action: str | None = None,
        *,
        num_envs: int = 1,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs: arrived {num_envs}; expected at least 1")
        self.render_mode = _check_render_mode(render_mode, [])
        self._compiled = compiled_environment(task, action, options)
        self.environment = _one_aircraft(self._compiled)
        self.num_envs = num_envs
        self.single_observation_space = box_space(OBSERVATION_MAX, len(self.environment.observed))
        self.single_action_space = box_space(1.0, self.environment.num_actions)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._keys: np.ndarray | None = None
        self._numbers: Any = None
        self._state: list[Array] | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start the next episode of every aircraft; with a seed s, the first episodes of the seeds s, s + 1, ...

        Parameters
        ----------
        seed
            Seed, or a seed for each aircraft; None: the episodes after the present ones.
        options
            No effect.
        """
        super().reset(seed=seed if isinstance(seed, int) else None)
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is not None and len(seeds) != self.num_envs:
            raise ValueError(f"seed: arrived {len(seeds)} seeds; expected {self.num_envs}, one for each environment")
        drawn = self.np_random.integers(2**32, size=(self.num_envs, 2), dtype=np.uint32)
        keys = drawn if self._keys is None else self._keys
        numbers = np.zeros(self.num_envs, np.uint32) if self._keys is None else np.asarray(self._numbers) + np.uint32(1)
        if seeds is not None:
            is_seeded = np.array([one is not None for one in seeds])
            words = np.stack([seed_words(0 if one is None else one) for one in seeds])
            keys, numbers = np.where(is_seeded[:, None], words, keys), np.where(is_seeded, 0, numbers)
        self._keys, self._numbers = keys, numbers.astype(np.uint32)
        observations, self._state = self._compiled.reset_batch(self._compiled.parameters, self._keys, self._numbers)
        return np.array(observations), {}

    def step(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, " aircraft"], Bool[np.ndarray, " aircraft"], dict[str, Any]]:
        """Fly one decision of every aircraft; return observations, rewards, `terminated`, `truncated` and `info`."""
        if self._state is None:
            raise ValueError("step: arrived before the first reset; expected reset() before step()")
        checked = check_actions(actions, (self.num_envs, self.environment.num_actions))
        state, self._state = self._state, None
        observations, rewards, terminated, truncated, final, success, self._state, self._numbers = (
            self._compiled.step_batch(self._compiled.parameters, state, self._keys, self._numbers, checked)
        )
        terminations, truncations = np.array(terminated), np.array(truncated)
        is_over = terminations | truncations
        info = _final_info(is_over, np.asarray(final), np.asarray(success)) if is_over.any() else {}
        return np.array(observations), np.array(rewards, np.float64), terminations, truncations, info


def _final_info(is_over: np.ndarray, final: np.ndarray, success: np.ndarray) -> dict[str, Any]:
    observations = np.full(is_over.size, None, dtype=object)
    for k in np.flatnonzero(is_over):
        observations[k] = final[k].copy()
    final_info = {"is_success": success & is_over, "_is_success": is_over.copy()}
    return {
        "final_obs": observations,
        "_final_obs": is_over.copy(),
        "final_info": final_info,
        "_final_info": is_over.copy(),
    }


def _one_aircraft(compiled: CompiledEnvironment) -> AircraftEnvironment:
    if not isinstance(compiled.environment, AircraftEnvironment):
        raise ValueError(
            f"task: arrived {compiled.environment.name}, a fleet; expected a task of one aircraft, or for a fleet "
            "anser.environments.pettingzoo_environments.FleetParallelEnvironment"
        )
    return compiled.environment


def _check_render_mode(render_mode: str | None, modes: Sequence[str]) -> str | None:
    if render_mode is not None and render_mode not in modes:
        raise ValueError(f"render_mode: arrived {render_mode!r}; expected {' or '.join([*map(repr, modes), 'None'])}")
    return render_mode


def register_gymnasium() -> None:
    """Register every task of one aircraft in Gymnasium as `anser/NAME-v0`; importing this module does so."""
    for task in sorted(set(TASKS) - {"FleetArrival"}):
        name, module = f"anser/{task}-v0", __name__
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f"{module}:{GymnasiumEnvironment.__name__}",
                vector_entry_point=f"{module}:{GymnasiumVectorEnvironment.__name__}",
                kwargs={"task": task},
            )


register_gymnasium()
