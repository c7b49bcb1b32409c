"""Gymnasium's contract: the single environment, the vector of environments, episodes as flights and datasets."""

import copy
import dataclasses
import importlib
import json
import sys
import warnings

import equinox as eqx
import gymnasium
import jax
import minari
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.environments import gymnasium_environments as wrapped
from anser.environments.episodes import Episode, figure_pixels, fly_episodes, record_flight, score
from anser.environments.minari_datasets import save_minari
from anser.environments.planned_tasks import AbstractPlannedTask
from anser.environments.registry import TASKS, make
from anser.environments.tasks import VelocityCommand
from support.environment_resets import check_rows

DECISIONS = 12
COUNT = 5
NAME = "anser/VelocityCommand-v0"


class ShortCommand(VelocityCommand):
    """A short task that fails after five decisions below an airspeed: ends of both sorts in a few steps."""

    duration_s: float = eqx.field(static=True, default=0.05 * DECISIONS)
    settled_s: float = eqx.field(static=True, default=0.05)

    def has_failed(self, situation):
        return (situation.time > 0.22) & (situation.variables["airspeed_m_s"] < 150.0)


@pytest.fixture(scope="module")
def environment():
    return make(ShortCommand(), "rates", cases=64)


@pytest.fixture(scope="module")
def single(environment):
    return gymnasium.make(NAME, task=environment).unwrapped


@pytest.fixture(scope="module")
def vector(environment):
    return gymnasium.make_vec(NAME, num_envs=COUNT, task=environment)


@pytest.mark.long
def test_the_single_environment_passes_gymnasiums_check_without_warnings(single):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(single)


@pytest.mark.long
@pytest.mark.parametrize("task", [task for task in TASKS if task != "FleetArrival"])
def test_every_task_passes_gymnasiums_check_at_its_default_level(task):
    cases = {} if issubclass(TASKS[task], AbstractPlannedTask) else {"cases": 64}  # the shipped study has the others
    check_env(gymnasium.make(f"anser/{task}-v0", **cases).unwrapped)


@pytest.mark.long
def test_the_vector_is_gymnasiums_own_vector_of_single_environments(environment, vector):
    sync = gymnasium.make_vec(
        NAME,
        num_envs=COUNT,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP},
        task=environment,
    )
    assert isinstance(vector, wrapped.GymnasiumVectorEnvironment)
    assert vector.metadata["autoreset_mode"] == sync.metadata["autoreset_mode"]
    for space in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
        assert getattr(vector, space) == getattr(sync, space)
    starts, expected = vector.reset(seed=3)[0], sync.reset(seed=3)[0]
    np.testing.assert_array_equal(starts, expected)
    rng = np.random.default_rng(0)
    failures = lengths = 0
    for _ in range(3 * DECISIONS):
        actions = rng.uniform(-1.2, 1.2, (COUNT, 4)).astype(np.float32)
        *results, info = vector.step(actions)
        *expected, expected_info = sync.step(np.clip(actions, -1.0, 1.0))
        for result, reference in zip(results, expected, strict=True):
            assert result.dtype == reference.dtype
            assert result.flags.writeable
            # observations are float32: one rounding, where the batch's program rounds otherwise than the single one
            np.testing.assert_allclose(result, reference, rtol=0.0, atol=2e-6)
        assert info.keys() == expected_info.keys()
        if info:
            np.testing.assert_array_equal(info["_final_obs"], results[2] | results[3])
            for name in ("_final_obs", "_final_info"):
                np.testing.assert_array_equal(info[name], expected_info[name])
            for name, values in expected_info["final_info"].items():
                np.testing.assert_array_equal(info["final_info"][name], values)
            for last, reference in zip(info["final_obs"], expected_info["final_obs"], strict=True):
                assert (last is None) == (reference is None)
                if last is not None:
                    np.testing.assert_allclose(last, reference, rtol=0.0, atol=2e-6)
            failures, lengths = failures + results[2].sum(), lengths + results[3].sum()
    assert failures > 0
    assert lengths > 0


@pytest.mark.long
def test_parts_of_a_vector_on_two_cores_are_the_vectors_of_their_seeds(environment, vector, monkeypatch):
    monkeypatch.setattr(wrapped, "_BLOCK_MIN", COUNT)
    monkeypatch.setattr("anser.compiling.options.usable_cores", lambda: 3)
    both = wrapped.GymnasiumVectorEnvironment(environment, num_envs=2 * COUNT)
    assert len(both._blocks) == 2
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (DECISIONS + 2, 2 * COUNT, 4))
    starts, rows = both.reset(seed=20)[0], [both.step(action) for action in actions]
    for part in (slice(0, COUNT), slice(COUNT, 2 * COUNT)):
        np.testing.assert_array_equal(starts[part], vector.reset(seed=20 + part.start)[0])
        for action, (*results, info) in zip(actions[:, part], rows, strict=True):
            *expected, expected_info = vector.step(action)
            for result, reference in zip(results, expected, strict=True):
                np.testing.assert_array_equal(result[part], reference)
            if expected_info:
                np.testing.assert_array_equal(info["_final_obs"][part], expected_info["_final_obs"])


def test_episodes_are_those_of_the_keys_of_the_seed(single, vector):
    reset = jax.jit(single.environment.reset)

    def start(seed, number):
        return np.asarray(reset(jax.random.fold_in(jax.random.key(seed), number))[0])

    np.testing.assert_array_equal(single.reset(seed=7)[0], start(7, 0))
    np.testing.assert_array_equal(single.reset()[0], start(7, 1))
    np.testing.assert_array_equal(vector.reset(seed=7)[0], [start(7 + k, 0) for k in range(COUNT)])
    np.testing.assert_array_equal(vector.reset()[0], [start(7 + k, 1) for k in range(COUNT)])
    seeds = [None, 2**40 + 1, None, None, 0]
    expected = [start(7, 2), start(2**40 + 1, 0), start(9, 2), start(10, 2), start(0, 0)]
    np.testing.assert_array_equal(vector.reset(seed=seeds)[0], expected)


@pytest.mark.long
@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), scale=st.floats(0.0, 1.0))
def test_no_state_survives_a_reset_within_random_episodes_of_the_vector(vector, seed, scale):
    rng, ends = np.random.default_rng(seed), 0
    vector.reset(seed=seed)
    for _ in range(2 * DECISIONS):
        observations, _, terminated, truncated, _ = vector.step(scale * rng.uniform(-1.0, 1.0, (COUNT, 4)))
        ended = terminated | truncated
        ends += ended.sum()
        if ended.any():
            fresh = vector._compiled.reset_batch(vector._keys, vector._numbers)
            check_rows(ended, (observations, vector._state[0]), fresh)
    assert ends >= 2 * COUNT


def test_without_a_seed_each_environment_begins_elsewhere(environment):
    starts = [wrapped.GymnasiumEnvironment(environment).reset()[0] for _ in range(4)]
    assert len({tuple(start) for start in starts}) > 1


def test_environments_with_the_same_arguments_share_the_compiled_programs(environment):
    first, second = (wrapped.GymnasiumEnvironment(environment) for _ in range(2))
    assert first._compiled is second._compiled
    assert copy.deepcopy(environment) is environment
    assert wrapped.default_level("PathTracking") == "rates"


def test_an_environment_by_name_is_made_once_from_its_arguments(environment, monkeypatch):
    calls = []
    monkeypatch.setattr(wrapped, "make", lambda *names, **options: calls.append((names, options)) or environment)
    wrapped._make_named.cache_clear()
    options = {"cases": 7, "wind": {"speed_m_s": 3.0}}
    named = [gymnasium.make(NAME, **options).unwrapped, gymnasium.make_vec(NAME, num_envs=2, **options)]
    gymnasium.make(NAME, action="surfaces")
    wrapped._make_named.cache_clear()
    assert calls == [(("VelocityCommand", "rates"), options), (("VelocityCommand", "surfaces"), {})]
    assert all(wrapper.environment is environment for wrapper in named)


def test_an_edited_file_makes_another_environment(environment, monkeypatch, tmp_path):
    """The file itself, and the scenario that a study names."""
    calls = []
    monkeypatch.setattr(wrapped, "make", lambda *names, **options: calls.append(options) or environment)
    wrapped._make_named.cache_clear()
    study, scenario = tmp_path / "study.toml", tmp_path / "scenario.toml"
    for edited, text in ((study, 'scenario = "scenario.toml"'), (scenario, "seed = 1"), (scenario, "seed = 2")):
        edited.write_text(text, encoding="utf-8")
        for _ in range(2):
            gymnasium.make(NAME, study=str(study))
    wrapped._make_named.cache_clear()
    assert len(calls) == 3


def test_files_that_name_themselves_or_each_other_are_hashed_once(tmp_path):
    study, scenario = tmp_path / "study.toml", tmp_path / "scenario.toml"
    study.write_text('name = "study.toml"\nscenario = "scenario.toml"', encoding="utf-8")
    scenario.write_text('parts = ["study.toml"]', encoding="utf-8")
    hashes = wrapped._file_hashes({"study": str(study), "other": [scenario]}, set())
    assert [path for path, _ in hashes] == [str(study.resolve()), str(scenario.resolve())]


def test_the_tasks_of_one_aircraft_are_registered_and_their_specifications_are_text():
    for task in set(TASKS) - {"FleetArrival"}:
        spec = gymnasium.spec(f"anser/{task}-v0")
        assert json.loads(spec.to_json())["kwargs"] == {"task": task}
    before = dict(gymnasium.registry)
    wrapped.register_gymnasium()
    assert dict(gymnasium.registry) == before


def test_wrong_arguments_are_refused(environment, single, vector):
    fresh = wrapped.GymnasiumEnvironment(environment)
    with pytest.raises(ValueError, match=r"step: arrived before the first reset"):
        fresh.step(np.zeros(4))
    single.reset(seed=0)
    with pytest.raises(ValueError, match=r"action: arrived the shape \(3,\); expected \(4,\)"):
        single.step(np.zeros(3))
    while not any(single.step(np.zeros(4))[2:4]):
        pass
    with pytest.raises(ValueError, match="step: arrived after the end of the episode"):
        single.step(np.zeros(4))
    vector.reset(seed=np.int64(0))
    actions = np.zeros((COUNT, 4))
    actions[2, 1] = np.nan
    with pytest.raises(ValueError, match=r"action: arrived nan at index \[2, 1\]"):
        vector.step(actions)
    with pytest.raises(ValueError, match="seed: arrived 2 seeds; expected 5"):
        vector.reset(seed=[1, 2])
    with pytest.raises(ValueError, match="render_mode: arrived 'human'; expected 'rgb_array' or None"):
        wrapped.GymnasiumEnvironment(environment, render_mode="human")
    with pytest.raises(ValueError, match="num_envs: arrived 0"):
        wrapped.GymnasiumVectorEnvironment(environment, num_envs=0)
    with pytest.raises(ValueError, match="task: arrived an environment with action"):
        wrapped.GymnasiumEnvironment(environment, "rates")


def test_without_gymnasium_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, wrapped.__name__)
    with pytest.raises(ImportError, match=r'Gymnasium is not installed: pip install "anser\[learning\]"'):
        importlib.import_module(wrapped.__name__)


def fly(single, seed):
    """One episode under random actions."""
    observations, actions, rewards, is_over = [single.reset(seed=seed)[0]], [], [], False
    start = single._compiled.state(single._episodes.start)
    rng = np.random.default_rng(seed)
    while not is_over:
        actions.append(rng.uniform(-1.0, 1.0, 4).astype(np.float32))
        observation, reward, terminated, truncated, info = single.step(actions[-1])
        observations, rewards, is_over = [*observations, observation], [*rewards, reward], terminated or truncated
    rows = map(np.array, (observations, actions, rewards))
    return Episode(single.environment, start, *rows, terminated, info["is_success"])


@pytest.mark.long
def test_the_flight_of_an_episode_has_the_observed_variables(single):
    episode = fly(single, seed=1)
    flight, steps = single.flight(), single.environment.decision_steps
    dataset = flight.dataset
    assert dataset.sizes["time"] == len(episode.actions) * steps + 1
    np.testing.assert_allclose(np.diff(dataset.time), 0.01, rtol=1e-9)
    motion = single.environment.observed[: -len(single.environment.task.entries())]
    assert {"airspeed_m_s", "alpha_deg", "elevator_deg"} <= {entry.name for entry in motion}
    for k, entry in enumerate(motion):
        values = entry.normalize(dataset[entry.name].values[::steps])
        # a float32 has 1.2e-7 of its value, which is at most about 3 here
        np.testing.assert_allclose(episode.observations[:, k], values, rtol=0.0, atol=5e-7, err_msg=entry.name)
    throttle = 0.5 * (episode.actions[:, 3].astype(float) + 1.0)
    np.testing.assert_allclose(dataset["throttle"].values[:-1:steps], throttle, rtol=0.0, atol=1e-12)
    pixels = figure_pixels(flight.plot())
    assert pixels.ndim == 3
    assert pixels.std() > 10.0
    too_many = np.zeros((DECISIONS + 1, 4), np.float32)
    with pytest.raises(ValueError, match="actions: arrived 13 decisions; expected at most 12"):
        record_flight(single.environment, episode.start, too_many)


def test_recorded_episodes_are_datasets_of_minari(single, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    episodes = [fly(single, seed) for seed in range(6)]
    assert {episode.terminated for episode in episodes} == {True, False}
    texts = ("algorithm_name", "author", "author_email", "code_permalink", "description")
    dataset = save_minari("anser/short/random-v0", episodes, **dict.fromkeys(texts, "test"))
    assert dataset.total_steps == sum(len(episode.actions) for episode in episodes)
    saved_episodes = list(minari.load_dataset("anser/short/random-v0").iterate_episodes())
    for saved, episode in zip(saved_episodes, episodes, strict=True):
        np.testing.assert_array_equal(saved.observations, episode.observations)
        np.testing.assert_array_equal(saved.actions, episode.actions)
        np.testing.assert_array_equal(saved.rewards, episode.rewards)
        assert saved.terminations[-1] == episode.terminated
        assert saved.truncations[-1] != episode.terminated
        assert not saved.terminations[:-1].any()
    with pytest.raises(ValueError, match="episodes: arrived none"):
        save_minari("anser/short/none-v0", [])
    of_fleet = dataclasses.replace(episodes[0], observations=np.zeros((3, 2, 5)))
    with pytest.raises(ValueError, match="episodes: arrived those of a fleet; expected episodes of an environment"):
        save_minari("anser/short/fleet-v0", [of_fleet])
    diverged = dataclasses.replace(episodes[0], rewards=np.full_like(episodes[0].rewards, np.nan))
    with pytest.raises(ValueError, match=r"episodes\[1\]: arrived numbers that are not finite"):
        save_minari("anser/short/diverged-v0", [episodes[0], diverged])


@pytest.mark.long
def test_episodes_flown_together_are_those_of_the_score(single):
    environment = single.environment
    episodes = fly_episodes(environment, "expert", episodes=8, seed=2)
    result = score(environment, "expert", episodes=8, seed=2)
    np.testing.assert_array_equal([episode.success for episode in episodes], result.successes)
    np.testing.assert_allclose(np.mean([e.rewards.sum() / DECISIONS for e in episodes]), result.mean_return, rtol=1e-9)
    for episode in episodes:
        row = episode.flight().dataset.isel(time=-1)
        altitude = environment.observed[1]
        assert altitude.name == "altitude_m"
        np.testing.assert_allclose(episode.observations[-1, 1], altitude.normalize(float(row.altitude_m)), atol=5e-7)
