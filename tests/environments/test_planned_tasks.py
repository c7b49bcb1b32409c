"""Tasks with plans: cases from a study, the expert on its plan, the stand-off, the fleet's separation, and refusals."""

import dataclasses
import functools
import shutil
import tempfile
import types
from importlib import resources
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.config.errors import ScenarioError
from anser.environment.earth import wgs84_earth
from anser.environments import Arrival, Expert, FleetEnvironment, make
from anser.environments.planned_tasks import PathTracking
from support.environment_resets import batch_programs, check_resets


def study_file(folder, name, flights):
    """Copy a study of the package and its scenario, with another number of flights."""
    data = resources.files("anser.environments").joinpath("data")
    scenario = "fleet.toml" if name == "fleet" else "arrival.toml"
    shutil.copy(str(data.joinpath(scenario)), folder)
    text = data.joinpath(f"{name}-study.toml").read_text(encoding="utf-8")
    path = Path(folder) / f"{name}-study.toml"
    path.write_text(text.replace("flights = 512", f"flights = {flights}"), encoding="utf-8")
    return path


def edited_study(folder, old, new):
    """Copy the study of arrivals with three flights; in its scenario, `new` replaces `old`."""
    path, scenario = study_file(folder, "arrival", 3), Path(folder) / "arrival.toml"
    text = scenario.read_text(encoding="utf-8")
    assert text.count(old) == 1
    scenario.write_text(text.replace(old, new), encoding="utf-8")
    return path


@functools.cache
def arrival(task, action="velocity"):
    return make(task, action, study=study_file(tempfile.mkdtemp(), "arrival", 3))


@functools.cache
def fleet(action="velocity"):
    return make("FleetArrival", action, study=study_file(tempfile.mkdtemp(), "fleet", 8))


class CarelessArrival(Arrival):
    """A task that never fails by itself."""

    def has_failed(self, situation):
        return jnp.zeros((), bool)


def moved(environment, state, position_n, velocity_b=None):
    """Return the state with the aircraft at another place."""
    aircraft = state.vehicle.aircraft
    aircraft = dataclasses.replace(aircraft, position_n=jnp.asarray(position_n, float))
    return dataclasses.replace(state, vehicle=dataclasses.replace(state.vehicle, aircraft=aircraft))


def fly_expert(environment, decisions):
    params, expert = environment.default_params, Expert(environment)
    observation, state = environment.reset(jax.random.key(1), params)

    @jax.jit
    def fly(state, own):
        def advance(carry, _):
            state, own = carry
            action, own = expert.act(state, own, params)
            observation, state, reward, terminated, info = environment.step_env(
                jax.random.key(0), state, action, params
            )
            return (state, own), (observation, reward, terminated, info["success"])

        return jax.lax.scan(advance, (state, own), None, length=decisions)

    (state, _), rows = fly(state, expert.init(state, params))
    return observation, state, rows


@pytest.mark.long
@pytest.mark.parametrize("action", ["surfaces", "rates", "velocity"])
@pytest.mark.parametrize("task", ["PathTracking", "Arrival", "FleetArrival"])
def test_no_state_survives_a_reset_at_any_level(task, action):
    is_fleet = task == "FleetArrival"  # computes observations in a reset, and the two programs round differently
    environment, rounding = (fleet(action), 1e-14) if is_fleet else (arrival(task, action), 0.0)
    reset, step = batch_programs(environment)
    for seed in range(5):
        check_resets(environment, reset, step, seed, 0.25 * seed, rounding)


@pytest.mark.long
def test_the_expert_stays_on_its_path_and_the_observation_tells_it():
    environment = arrival("PathTracking")
    names = [entry.name for entry in environment.observed]
    first, state, (observations, _, terminated, _) = fly_expert(environment, 100)
    assert not bool(terminated.any())
    offset = [names.index(f"path_offset_{axis}_m") for axis in ("ahead", "right", "up")]
    np.testing.assert_allclose(first[np.array(offset)], 0.0, atol=1e-6)  # the path begins at the start
    assert float(np.abs(environment.task.errors(environment.situation(state)))[0]) < 0.2
    assert bool(jnp.all(jnp.isfinite(observations)))


def test_on_the_ellipsoid_velocities_are_compared_over_the_ground():
    """Aircraft 200 km from the origin, on its straight way in the chart: no slip, no zero-effort miss."""
    position_n, velocity_n = jnp.array([2e5, 2e5, -3000.0]), jnp.array([120.0, 90.0, -2.0])
    earth = wgs84_earth(np.deg2rad(50.0), 0.1).local_earth(position_n, velocity_n)
    assert abs(float(earth.chart_scale[1]) - 1.0) > 0.01
    rate_n = earth.chart_scale * velocity_n
    planned = types.SimpleNamespace(position_n=position_n, velocity_n=rate_n)
    task = types.SimpleNamespace(
        trajectory=types.SimpleNamespace(at=lambda time: planned, arrival_time=100.0),
        rendezvous_n=lambda time: position_n + 100.0 * rate_n,
    )
    state = types.SimpleNamespace(position_n=position_n, velocity_b=velocity_n)
    motion = types.SimpleNamespace(state=state, condition=types.SimpleNamespace(R_bn=jnp.eye(3), earth=earth))
    situation = types.SimpleNamespace(
        case=types.SimpleNamespace(task=task), belief=motion, truth=motion, time=0.0, estimates={"course_deg": 40.0}
    )
    np.testing.assert_allclose(PathTracking().observation(situation)[6:], 0.0, atol=1e-9)
    np.testing.assert_allclose(Arrival().errors(situation), 0.0, atol=1e-8)
    observed = Arrival().observation(situation)
    np.testing.assert_allclose(observed[4:7], observed[7:], rtol=1e-9)


@pytest.mark.long
def test_an_arrival_counts_at_its_time_alone():
    environment = arrival("Arrival")
    params = environment.default_params
    case = params.case(jnp.asarray(0))
    _, state = environment.reset(jax.random.key(1), params)
    arrival_s = float(params.case(state.row).task.trajectory.arrival_time)
    assert int(params.case(state.row).decisions) == int(arrival_s / 0.1 + 1e-9)
    step = jax.jit(environment.step_env)
    last = dataclasses.replace(state, time=params.case(state.row).decisions - 1)
    rendezvous_n = np.asarray(params.case(state.row).task.rendezvous_n(arrival_s))
    for north_m, success in ((0.0, True), (200.0, False)):
        there = moved(environment, last, rendezvous_n + np.array([north_m, 0.0, 0.0]))
        _, _, _, terminated, info = step(jax.random.key(0), there, jnp.zeros(3), params)
        assert not bool(terminated)
        assert bool(info["truncated"])
        assert bool(info["success"]) is success
    assert float(case.task.distance_min) == 150.0


@pytest.mark.long
def test_an_aircraft_that_comes_too_near_its_goal_ends_the_episode():
    environment = arrival("Arrival")
    params = environment.default_params
    _, state = environment.reset(jax.random.key(1), params)
    goal_n = np.asarray(params.case(state.row).task.goal.position_n(0.1))
    # a task of the user's own cannot lower the stand-off
    step = jax.jit(dataclasses.replace(environment, task=CarelessArrival()).step_env)
    for above_m, ended in ((120.0, True), (900.0, False)):
        there = moved(environment, state, goal_n - np.array([0.0, 0.0, above_m]))
        assert bool(step(jax.random.key(0), there, jnp.zeros(3), params)[3]) is ended


@pytest.mark.long
def test_a_fleet_shares_reward_and_end():
    environment = fleet()
    assert isinstance(environment, FleetEnvironment)
    assert environment.agents == ("aircraft-1", "aircraft-2", "aircraft-3")
    assert environment.separation_m == (200.0, 200.0)
    params = environment.default_params
    observation, state = environment.reset(jax.random.key(2), params)
    assert observation.shape == (3, len(environment.observed))
    step = jax.jit(environment.step)
    observation, after, reward, terminated, truncated, info = step(jax.random.key(3), state, jnp.zeros((3, 3)), params)
    assert observation.shape == (3, len(environment.observed))
    assert len(set(np.asarray(reward).tolist())) == 1
    assert terminated.shape == truncated.shape == info["success"].shape == ()
    # 90 m above another aircraft 50 m aside is apart where the vertical separation is less
    flat = dataclasses.replace(environment, separation_m=(200.0, 80.0))
    positions_n = after.vehicle.aircraft.position_n
    above = moved(environment, after, positions_n.at[1].set(positions_n[0] + jnp.array([0.0, 50.0, -90.0])))
    for fleet_of_study, ended in ((environment, True), (flat, False)):
        results = jax.jit(fleet_of_study.step_env)(jax.random.key(4), above, jnp.zeros((3, 3)), params)
        assert bool(results[3]) is ended
    # two aircraft at one place end the episode, and the next one begins
    near = moved(environment, after, positions_n.at[1].set(positions_n[0] + jnp.array([0.0, 100.0, 0.0])))
    _, again, _, terminated, _, info = step(jax.random.key(4), near, jnp.zeros((3, 3)), params)
    assert bool(terminated)
    assert int(again.time) == 0
    assert float(info["discount"]) == 0.0


@pytest.mark.long
def test_an_aircraft_observes_the_others_in_its_own_axes():
    environment = fleet()
    observation, state = environment.reset(jax.random.key(2))
    names = [entry.name for entry in environment.observed]
    columns = [names.index(f"other_1_{axis}_m") for axis in ("ahead", "right", "up")]
    positions_n = np.asarray(state.vehicle.aircraft.position_n)
    for index in range(3):
        distance_m = np.linalg.norm(positions_n[(index + 1) % 3] - positions_n[index])
        assert 5000.0 * np.linalg.norm(observation[index, np.array(columns)]) == pytest.approx(distance_m, rel=1e-5)


@pytest.mark.long
def test_the_experts_of_a_fleet_follow_their_plans():
    _, state, (_, rewards, terminated, _) = fly_expert(fleet(), 50)
    assert not bool(terminated.any())
    assert rewards.shape == (50, 3)
    environment = fleet()
    task = environment.cases(state, environment.default_params).map(lambda case: case.task.trajectory.position_n(5.0))
    offset = np.linalg.norm(np.asarray(task) - np.asarray(state.vehicle.aircraft.position_n), axis=1)
    assert np.all(offset < 5.0)


def test_a_fleet_is_refused_where_one_aircraft_is_expected(tmp_path):
    with pytest.raises(ValueError, match="study: arrived 3 aircraft; expected one, or the task FleetArrival"):
        make("Arrival", "velocity", study=study_file(tmp_path, "fleet", 8))
    with pytest.raises(ValueError, match="study: arrived one aircraft; expected several"):
        make("FleetArrival", "velocity", study=study_file(tmp_path, "arrival", 3))


def test_a_study_with_a_measured_goal_is_refused(tmp_path):
    path = edited_study(tmp_path, "[timing]", '[goal_sensor]\npreset = "camera"\n\n[timing]')
    with pytest.raises(ScenarioError, match=r'goal_sensor\.preset: arrived "camera"; expected "exact"'):
        make("Arrival", "velocity", study=path)


@pytest.mark.long
def test_a_study_flies_with_its_own_step_or_the_given_one(tmp_path):
    path = edited_study(tmp_path, "[timing]", "[timing]\nstep_s = 0.02")
    coarse, fine = make("Arrival", "velocity", study=path), make("Arrival", "velocity", study=path, step_s=0.01)
    assert (coarse.decision_steps, fine.decision_steps) == (5, 10)
    assert coarse.identity == fine.identity == {"aircraft": "f16", "variant": "textbook"}


@pytest.mark.long
def test_flights_that_would_arrive_after_their_end_are_left_out(tmp_path):
    path = edited_study(tmp_path, "duration_s = 180.0", "duration_s = 62.0")
    params = make("Arrival", "velocity", study=path).default_params
    assert 1 <= len(params.decisions) < 3
    assert np.max(params.decisions) * 0.1 <= 62.0


def test_a_study_without_one_common_arrival_time_is_refused(tmp_path):
    path = edited_study(tmp_path, "[timing]", '[arrival]\nrule = "earliest"\n\n[timing]')
    with pytest.raises(ScenarioError, match=r'arrival\.rule: arrived "earliest"; expected one common time'):
        make("Arrival", "velocity", study=path)


@pytest.mark.long
def test_a_study_without_a_plan_is_refused(tmp_path):
    path = edited_study(tmp_path, "stand_off_up_m = 1000.0", "stand_off_up_m = 9000.0")
    with pytest.raises(ScenarioError, match="3 flights of which none has a plan"):
        make("Arrival", "velocity", study=path)
