"""Environments for Gymnasium 1.1 and later: one aircraft, or many at once with a reset within the step.

Importing the module registers every task of one aircraft by its name, such as `anser/VelocityCommand-v0`, for
`gymnasium.make` and `gymnasium.make_vec`. Episode number k after `reset(seed=s)` has the same start as
`environment.reset(jax.random.fold_in(jax.random.key(s), k))`, for one aircraft and in a batch.
"""

import contextlib
import hashlib
import os
import pickle
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from anser.compiling.options import OLDER_GENERATOR, blocks_on_cores, call_on_cores
from anser.compiling.program import supported_options
from anser.environments.environment import AircraftEnvironment, EpisodeState
from anser.environments.episodes import AnyEnvironment, figure_pixels, record_flight
from anser.environments.registry import TASKS, make
from anser.environments.tasks import AbstractTask, VelocityCommand
from anser.numerics.randomness import fold_key
from anser.results.documents import install_hint
from anser.single_aircraft.flight import AircraftFlight

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    raise ImportError(install_hint("Gymnasium", "learning")) from None

Task = str | AbstractTask | AircraftEnvironment
OBSERVATION_MAX = 100.0
"""Magnitude to which the entries of observations are clipped; about 1 in ordinary flight."""
_BLOCK_MIN = 256
"""Least number of aircraft in a block of a batch; each block flies on one core of the processor."""


class CompiledEnvironment:
    """Compiled functions of an environment, with its default parameters, for Gymnasium and PettingZoo.

    Observations are clipped to +-`OBSERVATION_MAX`; NaN becomes 0.
    """

    def __init__(self, environment: AnyEnvironment) -> None:
        self.environment = environment
        # States as flat lists of arrays, and parameters as one array, reduce the cost of a call to microseconds.
        numbers, others = eqx.partition(environment.default_params, eqx.is_inexact_array)
        parameters, unravel = ravel_pytree(numbers)
        self._state_structure = jax.tree.structure(jax.eval_shape(environment.reset, jax.random.key(0))[1])

        def unpack(packed: Array) -> Any:
            return eqx.combine(unravel(packed), others)

        def reset(packed: Array, key: Array, number: Array) -> tuple[Array, list[Array]]:
            observation, state = environment.reset(fold_key(key, number), unpack(packed))
            return _bounded(observation), jax.tree.leaves(state)

        def step(packed: Array, state: list[Array], action: Array) -> tuple[Any, ...]:
            params, unused = unpack(packed), jnp.zeros(2, jnp.uint32)
            observation, flown, *ends, info = environment.step_env(unused, self.state(state), action, params)
            return _bounded(observation), jax.tree.leaves(flown), *ends, info["truncated"], info["success"]

        def step_or_reset(
            packed: Array, state: list[Array], key: Array, number: Array, action: Array
        ) -> tuple[Any, ...]:
            params, next_key = unpack(packed), fold_key(key, number + 1)
            observation, flown, *ends, info = environment.step(next_key, self.state(state), action, params)
            final, success, number = info["final_observation"], info["success"], number + (ends[1] | ends[2])
            return _bounded(observation), *ends, _bounded(final), success, number, jax.tree.leaves(flown)

        compiled = partial(jax.jit, compiler_options=supported_options(OLDER_GENERATOR))
        #: `reset(key, number)` starts an episode; `step(state, action)` flies a decision without a reset.
        #: `reset_batch` starts many episodes; `step_batch` flies a decision of many, and resets those that end.
        self.reset, self.step = partial(compiled(reset), parameters), partial(compiled(step), parameters)
        self.reset_batch = partial(compiled(jax.vmap(reset, (None, 0, 0))), parameters)
        step_batch = compiled(jax.vmap(step_or_reset, (None, 0, 0, 0, 0)), donate_argnums=1)
        self.step_batch = partial(step_batch, parameters)

    def state(self, leaves: list[Array]) -> EpisodeState:
        """Return the state of an episode from its flat list of arrays."""
        return self._state_structure.unflatten(leaves)


def _bounded(observation: Array) -> Array:
    return jnp.clip(jnp.nan_to_num(observation), -OBSERVATION_MAX, OBSERVATION_MAX)


def default_level(task: str | AbstractTask) -> str:
    """Return the default level of action: "rates", or the first level of a task that does not have "rates"."""
    named = TASKS.get(task, VelocityCommand)() if isinstance(task, str) else task
    return "rates" if "rates" in named.levels else named.levels[0]


_compile = lru_cache(maxsize=4)(CompiledEnvironment)


@lru_cache(maxsize=4)
def _make_named(task: str, action: str, options: bytes, files: tuple[tuple[str, str], ...]) -> AnyEnvironment:
    return make(task, action, **dict(pickle.loads(options)))


def _file_hashes(value: Any, visited: set[Path], folder: str = "") -> Iterator[tuple[str, str]]:
    """Yield path and SHA-256 of the files that `value` names, and of the files that these name if they are TOML files.

    `value` is a path, or nested mappings and lists of paths and other values; relative paths start at `folder`. Files
    in `visited` are left out; yielded files are added to `visited`.
    """
    if isinstance(value, Mapping):
        for part in value.values():
            yield from _file_hashes(part, visited, folder)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _file_hashes(part, visited, folder)
    elif isinstance(value, str | os.PathLike):
        path = Path(folder, value)
        with contextlib.suppress(OSError, ValueError):
            resolved = path.resolve()
            if path.is_file() and resolved not in visited:
                visited.add(resolved)
                content = path.read_bytes()
                yield str(resolved), hashlib.sha256(content).hexdigest()
                if path.suffix == ".toml":
                    yield from _file_hashes(tomllib.loads(content.decode()), visited, str(path.parent))


def compiled_environment(task: Any, action: str | None, options: Mapping[str, Any]) -> CompiledEnvironment:
    """Return the compiled functions of an environment, from the arguments of `GymnasiumEnvironment`.

    The latest results are cached: by environment, or by task name, action, options and contents of the named files. An
    `AbstractTask` is compiled anew. Raises ValueError if `task` is an environment and action or options are given.
    """
    if isinstance(task, str | AbstractTask):
        level = default_level(task) if action is None else action
        if isinstance(task, str):
            files = tuple(_file_hashes(options, set()))
            return _compile(_make_named(task, level, pickle.dumps(sorted(options.items())), files))
        return _compile(make(task, level, **options))
    if action is not None or options:
        names = ", ".join(["action"] * (action is not None) + sorted(options))
        raise ValueError(f"task: arrived an environment with {names}; expected the environment alone")
    return _compile(task)


def seed_words(seed: int) -> np.ndarray:
    """Return the two 32-bit words of `jax.random.key(seed)`, shape (2,)."""
    return np.array([seed >> 32 & 0xFFFFFFFF, seed & 0xFFFFFFFF], np.uint32)


def check_actions(actions: Any, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Return actions as a float32 array. Raises ValueError for another shape than `shape`, and for infinity or NaN."""
    array = np.asarray(actions, np.float32)
    if array.shape != shape:
        raise ValueError(f"action: arrived the shape {array.shape}; expected {shape}")
    if not np.isfinite(array).all():
        place = np.argwhere(~np.isfinite(array))[0].tolist()
        raise ValueError(f"action: arrived {array[tuple(place)]} at index {place}; expected finite numbers, -1..1")
    return array


def box_spaces(environment: Any) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Return the spaces of one aircraft's observations (+-`OBSERVATION_MAX`) and actions (-1..1), float32 vectors."""
    observed, commanded = environment.observation_space().shape, environment.action_space().shape
    observations = gymnasium.spaces.Box(-OBSERVATION_MAX, OBSERVATION_MAX, observed, np.float32)
    return observations, gymnasium.spaces.Box(-1.0, 1.0, commanded, np.float32)


class EpisodeSequence:
    """Successive episodes of an environment, with start, actions and state of the present episode."""

    def __init__(self, compiled: CompiledEnvironment) -> None:
        self.compiled, self.key, self.number = compiled, np.zeros(0, np.uint32), 0
        self.start: list[Array] = []
        self.state: list[Array] = []
        self.actions: list[np.ndarray] = []
        self.is_over = False

    def reset(self, seed: int | None, rng: np.random.Generator) -> np.ndarray:
        """Start an episode, and return the first observation.

        An integer `seed` starts the first episode of that seed; None starts the next episode. If no seed has been given
        yet, `rng` draws the key of the episodes.
        """
        if seed is not None or not self.key.size:
            self.key = rng.integers(2**32, size=2, dtype=np.uint32) if seed is None else seed_words(seed)
            self.number = 0
        else:
            self.number += 1
        observation, self.start = self.compiled.reset(self.key, np.uint32(self.number))
        self.state, self.actions, self.is_over = self.start, [], False
        return np.array(observation)

    def step(self, action: Any, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, bool, bool, bool]:
        """Fly one decision without a reset; return observation, reward, `terminated`, `truncated` and success.

        `action` must have the shape `shape`. Raises ValueError before the first reset and after the end of an
        episode; see also `check_actions`.
        """
        if not self.state or self.is_over:
            place = "after the end of the episode" if self.is_over else "before the first reset"
            raise ValueError(f"step: arrived {place}; expected reset() before step()")
        checked = check_actions(action, shape)
        observation, self.state, reward, *ends = self.compiled.step(self.state, checked)
        self.actions.append(checked.copy())
        terminated, truncated, success = map(bool, ends)
        self.is_over = terminated or truncated
        return np.array(observation), np.asarray(reward), terminated, truncated, success


class GymnasiumEnvironment(gymnasium.Env):
    """One aircraft with a task, as `gymnasium.Env`.

    Observations are float32 vectors, about -1..1 in ordinary flight and clipped to -100..100; actions are -1..1. The
    tables of the entries are `environment.observed` and `environment.commanded`. `info` has `is_success` at the end of
    an episode.

    Parameters
    ----------
    task
        Name of a task of the package, a user's `AbstractTask`, or an `AircraftEnvironment`.
    action
        Level of action: "surfaces", "rates" or "velocity"; None: see `default_level`.
    render_mode
        "rgb_array": `render` returns the figures of the latest 20 s of the episode. None: `render` warns and returns
        None.
    **options
        Further arguments of `anser.environments.make`.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - Gymnasium's name and type

    def __init__(
        self, task: Task, action: str | None = None, *, render_mode: str | None = None, **options: Any
    ) -> None:
        self._compiled = compiled_environment(task, action, options)
        self.environment = _one_aircraft(self._compiled, render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.observation_space, self.action_space = box_spaces(self.environment)
        self._episodes = EpisodeSequence(self._compiled)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Start the next episode, or the first episode of `seed`; return observation and an empty `info`.

        `options` has no effect.
        """
        super().reset(seed=seed)
        return self._episodes.reset(seed, self.np_random), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly one decision; return observation, reward, `terminated`, `truncated` and `info` (see the class).

        Raises ValueError before the first reset, after the end of an episode, and for an action of another shape or
        with infinity or NaN.
        """
        results = self._episodes.step(action, (self.environment.num_actions,))
        observation, reward, terminated, truncated, success = results
        info = {"is_success": success} if terminated or truncated else {}
        return observation, float(reward), terminated, truncated, info

    def flight(self) -> AircraftFlight:
        """Return the flight of the present episode so far, with all variables at every step.

        Raises ValueError before the first reset.
        """
        if not self._episodes.start:
            raise ValueError("flight: arrived before the first reset; expected reset() before flight()")
        start = self._compiled.state(self._episodes.start)
        actions = np.array(self._episodes.actions, np.float32).reshape(-1, self.environment.num_actions)
        return record_flight(self.environment, start, actions)

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the figures of the latest 20 s of the episode as RGB pixels (see `render_mode` of the class)."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() has no effect without gymnasium.make(..., render_mode="rgb_array")')
            return None
        dataset = self.flight().dataset
        latest = dataset.sel(time=slice(float(dataset.time[-1]) - 20.0, None))
        return figure_pixels(AircraftFlight(latest).plot())


class GymnasiumVectorEnvironment(VectorEnv):
    """Many independent aircraft with one task, as `gymnasium.vector.VectorEnv`.

    An episode that ends is reset within the step (`AutoresetMode.SAME_STEP`). `info["final_obs"]` then has the last
    observation and `info["final_info"]` the last `is_success`, as in `gymnasium.vector.SyncVectorEnv`.

    `num_envs` is the number of aircraft. `render_mode` must be None. For the other arguments see
    `GymnasiumEnvironment`.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012 - Gymnasium's type

    def __init__(
        self,
        task: Task,
        action: str | None = None,
        *,
        num_envs: int = 1,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs: arrived {num_envs}; expected at least 1")
        self._compiled = compiled_environment(task, action, options)
        self.environment = _one_aircraft(self._compiled, render_mode, [])
        self.render_mode, self.num_envs = render_mode, num_envs
        self.single_observation_space, self.single_action_space = box_spaces(self.environment)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._keys: np.ndarray | None = None
        self._numbers = np.zeros(num_envs, np.uint32)
        self._blocks = blocks_on_cores(num_envs, _BLOCK_MIN)
        self._state: Sequence[list[Array]] | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode of every aircraft; return observations, shape (aircraft, entry), and an empty `info`.

        - `seed` None starts the next episode of every aircraft.
        - An integer s starts the first episodes of the seeds s, s + 1, ...
        - A sequence has one seed per aircraft; None in the sequence starts the aircraft's next episode.

        `options` has no effect. Raises ValueError if the length of the sequence is not the number of aircraft.
        """
        if isinstance(seed, np.integer):
            seed = int(seed)
        super().reset(seed=seed if isinstance(seed, int) else None)
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is not None and len(seeds) != self.num_envs:
            raise ValueError(f"seed: arrived {len(seeds)} seeds; expected {self.num_envs}, one for each environment")
        drawn = self.np_random.integers(2**32, size=(self.num_envs, 2), dtype=np.uint32)
        keys = drawn if self._keys is None else self._keys
        numbers = self._numbers + np.uint32(self._keys is not None)
        if seeds is not None:
            is_seeded = np.array([one is not None for one in seeds])
            words = np.stack([seed_words(0 if one is None else one) for one in seeds])
            keys, numbers = np.where(is_seeded[:, None], words, keys), np.where(is_seeded, 0, numbers)
        self._keys, self._numbers = keys, numbers.astype(np.uint32)
        observations, self._state = self._fly(self._compiled.reset_batch, [], self._keys, self._numbers)
        return np.concatenate(observations), {}

    def step(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, " aircraft"], Bool[np.ndarray, " aircraft"], dict[str, Any]]:
        """Fly one decision of every aircraft; return observations, rewards, `terminated`, `truncated` and `info`.

        At the end of an episode, the observation is the first observation of the next episode; for `info` see the
        class. Raises ValueError before the first reset, and for actions of another shape or with infinity or NaN.
        """
        if self._state is None:
            raise ValueError("step: arrived before the first reset; expected reset() before step()")
        checked = check_actions(actions, (self.num_envs, self.environment.num_actions))
        state, self._state = self._state, None
        results = self._fly(self._compiled.step_batch, [state], self._keys, self._numbers, checked)
        observations, rewards, terminated, truncated, *final, numbers, self._state = results
        terminations, truncations, self._numbers = map(np.concatenate, (terminated, truncated, numbers))
        info: dict[str, Any] = {}
        ended = np.flatnonzero(terminations | truncations).tolist()
        last, success = map(np.concatenate, final) if ended else final
        for k in ended:
            info = self._add_info(info, {"final_obs": last[k], "final_info": {"is_success": bool(success[k])}}, k)
        return np.concatenate(observations), np.concatenate(rewards).astype(np.float64), terminations, truncations, info

    def _fly(self, function: Callable[..., Any], states: list[Any], *rows: Any) -> Any:
        """Call a function in parallel for each block of the aircraft; return each result as a tuple over the blocks.

        Each item of `states` must have one entry per block; `rows` are arrays over all aircraft.
        """
        blocks = zip(*states, *([array[block] for block in self._blocks] for array in rows), strict=True)
        return zip(*call_on_cores([partial(function, *block) for block in blocks]), strict=True)


def _one_aircraft(compiled: CompiledEnvironment, render_mode: str | None, modes: Sequence[str]) -> AircraftEnvironment:
    """Return the environment in `compiled`. Raises ValueError for a fleet, and for a `render_mode` not in `modes`."""
    if render_mode not in (None, *modes):
        raise ValueError(f"render_mode: arrived {render_mode!r}; expected {' or '.join([*map(repr, modes), 'None'])}")
    if not isinstance(compiled.environment, AircraftEnvironment):
        raise ValueError(
            f"task: arrived {compiled.environment.name}, a fleet; expected a task of one aircraft, or for a fleet "
            "anser.environments.pettingzoo_environments.FleetParallelEnvironment"
        )
    return compiled.environment


def register_gymnasium() -> None:
    """Register every task of one aircraft in Gymnasium as `anser/NAME-v0`; importing this module calls the function."""
    single, vector = (f"{__name__}:{kind.__name__}" for kind in (GymnasiumEnvironment, GymnasiumVectorEnvironment))
    for task in sorted(set(TASKS) - {"FleetArrival"}):
        if f"anser/{task}-v0" not in gymnasium.registry:
            gymnasium.register(f"anser/{task}-v0", single, vector_entry_point=vector, kwargs={"task": task})


register_gymnasium()
