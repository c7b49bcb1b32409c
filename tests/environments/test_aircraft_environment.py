"""Environments of one aircraft: contract, equality with `anser.simulate`, gradients, reproducibility, and refusals."""

import dataclasses
import functools
import math
import types

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import anser
from anser.config.errors import ScenarioError
from anser.environment.environment import Environment, LayeredWind
from anser.environments import TASKS, AbstractPlannedTask, Expert, make
from anser.environments.actions import LEVELS, AutopilotStep, SurfaceLevel
from anser.environments.cases import FlightRange, default_range, single_aircraft, stack_cases
from anser.environments.episodes import score
from anser.environments.tasks import Aim, UpsetRecovery, VelocityCommand
from anser.spatial.rotations import rotate, rotation_from_quaternion
from anser.units import RAD_DEG
from support.environment_resets import batch_programs, check_resets, shortened


@functools.cache
def velocity_command(action="surfaces", precision="float64", **tables):
    return make("VelocityCommand", action, cases=8, precision=precision, **tables)


@functools.cache
def programs(environment_key="surfaces"):
    environment = velocity_command(environment_key)
    return environment, *batch_programs(environment)


def keys(count, seed=0):
    return jax.random.split(jax.random.key(seed), count)


def test_a_step_has_the_six_values_of_the_contract():
    environment, reset, step = programs()
    params = environment.default_params
    observation, state = reset(keys(4), params)
    assert observation.shape == (4, len(environment.observed))
    assert observation.dtype == jnp.float32
    actions = jnp.zeros((4, environment.num_actions))
    observation, state, reward, terminated, truncated, info = step(keys(4, 1), state, actions, params)
    assert reward.shape == terminated.shape == truncated.shape == (4,)
    assert terminated.dtype == truncated.dtype == bool
    assert {"final_observation", "success", "terminated", "truncated", "discount"} == set(info)
    assert bool(jnp.all((reward >= 0.0) & (reward <= 1.0)))
    np.testing.assert_array_equal(info["final_observation"], observation)
    assert bool(environment.observation_space().contains(observation))
    assert [entry.name for entry in environment.commanded] == [
        "elevator_command_deg",
        "aileron_command_deg",
        "rudder_command_deg",
        "throttle",
    ]


def test_consecutive_seeds_fly_consecutive_cases_with_random_numbers_of_their_own():
    environment, reset, _ = programs()

    def starts(batches):
        states = [reset(batch, environment.default_params)[1] for batch in batches]
        return (np.concatenate([getattr(state, name) for state in states]) for name in ("row", "key"))

    key_of = jax.vmap(jax.random.key)
    rows, own_keys = starts(key_of(seeds) for seeds in np.arange(16).reshape(4, 4))
    np.testing.assert_array_equal(rows, np.arange(16) % 8)
    assert len(np.unique(own_keys, axis=0)) == 16
    rows, _ = starts(keys(4, seed) for seed in range(16))  # split keys draw every case
    assert set(np.unique(rows)) == set(range(8))


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), scale=st.floats(0.0, 1.0))
def test_no_state_survives_a_reset_within_random_episodes(seed, scale):
    environment, reset, step = programs()
    check_resets(environment, reset, step, seed, scale)


UNCERTAIN = {"turbulence": {"intensity": "light"}, "navigation": {"sensors": "satellite-inertial"}}
PAIRS = [(name, level, {}) for name in TASKS for level in TASKS[name]().levels]


@pytest.mark.long
@pytest.mark.parametrize(
    ("task", "action", "tables"),
    [
        *(pair for pair in PAIRS if not issubclass(TASKS[pair[0]], AbstractPlannedTask)),
        ("VelocityCommand", "rates", UNCERTAIN),
    ],
)
def test_no_state_survives_a_reset_at_any_level_of_any_task(task, action, tables):
    environment = make(task, action, cases=8, **tables)
    reset, step = batch_programs(environment)
    # first readings of sensors are computed in a reset, and the two programs round differently
    rounding = 1e-14 if tables else 0.0
    for seed in range(5):
        check_resets(environment, reset, step, seed, 0.25 * seed, rounding)


def one_episode(count, place):
    """Observations and rewards of an episode at an index of a batch."""
    environment, reset, step = programs()
    params = environment.default_params
    chosen = keys(count, 5).at[place].set(jax.random.key(77))
    observation, state = reset(chosen, params)
    rows = []
    for number in range(20):
        actions = 0.3 * np.ones((count, environment.num_actions)) * np.sin(number)
        observation, state, reward, *_ = step(chosen, state, actions, params)
        rows.append(np.append(np.asarray(observation)[place], np.asarray(reward)[place]))
    return np.array(rows)


def test_an_episode_is_the_same_at_any_index():
    np.testing.assert_array_equal(one_episode(4, 0), one_episode(4, 3))


@pytest.mark.long
def test_an_episode_is_the_same_in_any_batch():
    np.testing.assert_allclose(one_episode(4, 0), one_episode(7, 5), rtol=0.0, atol=1e-9)


def test_recorded_actions_fly_as_simulate_does():
    environment, reset, step = programs()
    params = environment.default_params
    _, states = reset(keys(4, 3), params)
    state = jax.tree.map(lambda leaf: leaf[0], states)
    case = params.case(state.row)
    actions = 0.2 * np.random.default_rng(0).uniform(-1.0, 1.0, (40, 4)) + np.array([-0.1, 0.0, 0.0, -0.3])
    situation = jax.jit(environment.situation)
    belief = situation(state, params).belief
    command = jax.jit(lambda action: SurfaceLevel().command(action, case.autopilot, belief))
    controls = [command(action) for action in actions]
    inputs = np.array([[*np.asarray(c.surfaces) * RAD_DEG, float(c.throttle)] for c in controls])
    names = (*case.vehicle.airframe.actuators.names, "throttle")
    wind_n = np.asarray(case.environment.wind.velocity_n)
    flight = anser.simulate(
        case.vehicle.airframe,
        in_still_air(case),
        {name: np.append(column, column[-1]) for name, column in zip(names, inputs.T, strict=True)},
        duration_s=0.4,
        wind={"speed_m_s": float(np.hypot(*wind_n[:2])), "from_deg": float(np.degrees(np.arctan2(*-wind_n[1::-1])))},
        earth={"latitude_deg": 45.0},
    ).dataset
    for action in actions:
        _, states, *_ = step(keys(4), states, np.tile(action, (4, 1)), params)
    variables = situation(jax.tree.map(lambda leaf: leaf[0], states), params).variables
    for name in ("airspeed_m_s", "alpha_deg", "beta_deg", "pitch_deg", "roll_deg", "roll_rate_deg_s", "altitude_m"):
        assert float(variables[name]) == pytest.approx(float(flight[name][-1]), rel=1e-12, abs=1e-11), name


def test_cases_in_a_wind_profile_share_it_and_start_with_its_velocity():
    bank = programs()[0].default_params.cases
    case, starts = bank.at(0), bank.batched.start
    altitudes_m = np.array([0.0, 12_000.0])
    wind = LayeredWind(jnp.asarray(altitudes_m), jnp.array([[0.0, 0.0, 0.0], [24.0, 12.0, 0.0]]))
    environment = Environment(case.environment.atmosphere, wind, case.environment.earth)
    drawn = jax.tree.map(np.asarray, (starts, bank.batched.task))
    stacked = stack_cases(
        case.vehicle, environment, FlightRange((140.0, 160.0), (1e3, 2e3)), drawn, 7, np.random.default_rng(0), float
    )
    np.testing.assert_array_equal(stacked.at(3).environment.wind.velocities_n, wind.velocities_n)
    start, given_start = stacked.at(3).start.state, drawn[0].state
    share = float(-given_start.position_n[3, 2]) / 12_000.0
    added_b = rotate(rotation_from_quaternion(start.quaternion), jnp.array([24.0, 12.0, 0.0]) * share)
    np.testing.assert_allclose(start.velocity_b - given_start.velocity_b[3], added_b, rtol=0.0, atol=1e-10)


def test_starts_in_a_steady_wind_are_steady_relative_to_the_air():
    tables = {"wind": {"speed_m_s": 15.0, "from_deg": 270.0}}
    cases = make("VelocityCommand", cases=8, **tables).default_params.cases
    for row in range(8):
        start = in_still_air(cases.at(row))
        u, v, w = start.state.velocity_b
        assert float(jnp.arctan2(w, u)) == pytest.approx(float(start.alpha), abs=1e-9)
        assert float(v) == pytest.approx(float(jnp.sin(start.beta) * jnp.sqrt(u * u + v * v + w * w)), abs=1e-6)


def in_still_air(case):
    """Return the start of a case as a trim in still air, to which `simulate` adds the wind."""
    wind_b = rotate(rotation_from_quaternion(case.start.state.quaternion), case.environment.wind.velocity_n)
    return eqx.tree_at(lambda p: p.state.velocity_b, case.start, case.start.state.velocity_b - wind_b)


@pytest.mark.long
def test_gradients_of_a_return_agree_with_finite_differences():
    environment = velocity_command().with_transition_gradients()
    params = environment.default_params
    _, state = environment.reset(jax.random.key(4), params)
    case = params.case(state.row)

    @jax.jit
    def total(actions):
        def advance(carried, action):
            _, carried, reward, *_ = environment.step_env(jax.random.key(0), carried, action, params)
            return carried, reward

        return jnp.sum(jax.lax.scan(advance, state, actions)[1])

    # about the trim: the elevator at 0 deg is a breakpoint of the tables, where a two-sided difference is no derivative
    step = AutopilotStep(None, case.start.controls, None)
    trim = environment.level.action(step, case.autopilot, environment.situation(state, params).belief)
    base = trim[None, :] + 0.01 * np.random.default_rng(0).normal(size=(100, 4))
    gradient = np.asarray(jax.jit(jax.grad(total))(base))
    assert np.all(np.isfinite(gradient))
    direction = gradient / np.linalg.norm(gradient)  # the derivative does not cancel along it
    h = 1e-5
    difference = float(total(base + h * direction) - total(base - h * direction)) / (2 * h)
    assert float(np.sum(gradient * direction)) == pytest.approx(difference, rel=1e-5)
    detached = velocity_command()
    zero = jax.grad(lambda action: detached.step_env(jax.random.key(0), state, action, params)[0].sum())(base[0])
    np.testing.assert_array_equal(zero, 0.0)  # without the request, transitions carry no gradient


@pytest.mark.long
def test_the_expert_follows_a_command_and_begins_anew_with_each_episode():
    environment = velocity_command("velocity")
    environment = dataclasses.replace(environment, parameters=shortened(environment.default_params, 30))
    params, expert = environment.default_params, Expert(environment)
    _, state = environment.reset(jax.random.key(1), params)

    @jax.jit
    def advance(state, own, key):
        action, own = expert.act(state, own, params)
        _, state, reward, *_ = environment.step(key, state, action, params)
        return state, own, reward

    own = expert.init(state, params)
    first = environment.situation(state, params)
    errors = [np.abs(environment.task.errors(first))]
    for number in range(29):
        state, own, _ = advance(state, own, jax.random.key(number))
        errors.append(np.abs(environment.task.errors(environment.situation(state, params))))
    assert np.linalg.norm(errors[-1]) < 0.9 * np.linalg.norm(errors[0])
    state, own, _ = advance(state, own, jax.random.key(99))  # the episode ends here
    assert int(state.time) == 0
    again, _ = expert.act(state, own, params)
    fresh, _ = expert.act(state, expert.init(state, params), params)
    np.testing.assert_array_equal(again, fresh)


@pytest.mark.long
def test_turbulence_and_sensors_are_those_of_the_episode():
    environment = make("VelocityCommand", cases=8, **UNCERTAIN)
    params = environment.default_params
    assert params.observations is None
    step = jax.jit(environment.step)
    _, state = environment.reset(jax.random.key(1), params)
    action = jnp.zeros(4)
    first = step(jax.random.key(7), state, action, params)
    second = step(jax.random.key(8), state, action, params)  # the key of a step is that of the next episode alone
    np.testing.assert_array_equal(first[0], second[0])
    situation = environment.situation(first[1], params)
    assert float(situation.estimates["alpha_deg"]) != float(situation.variables["alpha_deg"])
    assert bool(jnp.all(jnp.isfinite(first[0])))


@pytest.mark.long
def test_float32_stays_float32():
    environment = velocity_command("surfaces", "float32")
    _, state = environment.reset(jax.random.key(1))
    _, state, reward, *_ = jax.jit(environment.step)(jax.random.key(2), state, jnp.zeros(4))
    assert reward.dtype == jnp.float32
    floats = {leaf.dtype for leaf in jax.tree.leaves(state) if jnp.issubdtype(leaf.dtype, jnp.floating)}
    assert floats == {jnp.dtype("float32")}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("Velocity",), "task: arrived 'Velocity'; expected one of AttitudeHold"),
        (("VelocityCommand", "stick"), "action: arrived 'stick'; expected one of surfaces, rates, velocity"),
        (("UpsetRecovery", "velocity"), "expected one of surfaces, rates: at other levels"),
    ],
)
def test_wrong_names_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        make(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cases": 0}, "cases: arrived 0"),
        ({"cases": 2.5}, "cases: arrived 2.5; expected a whole number"),
        ({"seed": 1.5}, "seed: arrived 1.5; expected a whole number from 0"),
        ({"precision": "float16"}, "precision: arrived 'float16'"),
        ({"step_s": 0.03}, "step_s: arrived 0.03; expected a divisor of the decision, 0.01 s"),
        ({"step_s": 0.0}, "step_s: arrived 0; expected a divisor"),
        ({"step_s": float("nan")}, "step_s: arrived nan; expected a divisor"),
        ({"step_s": 0.1, "action": "velocity"}, "step_s: arrived 0.1; expected .* from 0.001 to 0.05 s"),
        ({"study": "mine.toml"}, "study: arrived mine.toml; expected a task with a plan"),
        ({"flown": FlightRange((5.0, 6.0), (1000.0, 2000.0))}, "drawn conditions are steady flights"),
        ({"seed": -1}, "seed: arrived -1; expected a whole number from 0"),
        ({"flown": FlightRange((100.0, 200.0), (1000.0, 2000.0)), "task": "Arrival"}, "Arrival: arrived flown"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        make(**{"task": "VelocityCommand", "cases": 8, **arguments})


@pytest.mark.parametrize(
    ("tables", "path"),
    [
        ({"timing": {"duration_s": 600.0, "step_s": 0.02}}, "timing"),
        ({"goal_sensor": {"preset": "camera"}}, "goal_sensor"),
        ({"separation": {"horizontal_m": 200.0}, "arrival": {"rule": "at", "time_s": 60.0}}, "separation"),
        ({"parts": {"planner": "my_planners:Straight"}}, r"parts\.planner"),
        ({"event": [{"kind": "goal-stops", "goal": "goal", "time_s": 5.0}]}, r"event\[0\]"),
        ({"turbulence": {"spectrum": "von-karman"}}, r"turbulence\.spectrum"),
        ({"aircraft": {"rendezvous": {"stand_off_up_m": 400.0}}}, r"aircraft\.rendezvous"),
        ({"name": "mine"}, "name"),
    ],
)
def test_tables_without_effect_are_refused(tables, path):
    with pytest.raises(ScenarioError, match=rf"{path}: arrived .* (without effect|with intensity)"):
        make("VelocityCommand", cases=8, **tables)


def test_tables_of_the_air_and_the_aircraft_take_effect():
    event = {"kind": "thrust-lost", "aircraft": "aircraft", "time_s": 5.0, "thrust_left": 0.5}
    doublet = {"signal": "doublet", "inputs": ["elevator"], "amplitude": 1.0}
    air = {"atmosphere": {"temperature_offset_k": 20.0}}
    vehicle, environment = single_aircraft("f16", {"event": [event], "excitation": [doublet], **air})
    assert float(vehicle.thrust_ratio_at(6.0)) == 0.5
    assert vehicle.excitation is not None
    assert float(environment.atmosphere.at(0.0).temperature) == pytest.approx(308.15)


@pytest.mark.parametrize(
    ("aircraft", "tables"),
    [
        ({"start": {"speed_m_s": 95.0}}, {"wind": {"speed_m_s": 99.0, "from_deg": 0.0}}),
        ("f16", {"earth": {"model": "wgs84", "latitude_deg": 84.0}}),
        ({"start": {"mach": 0.5}}, {}),
    ],
)
def test_nothing_is_required_of_a_mission(aircraft, tables):
    vehicle, _ = single_aircraft(aircraft, tables)
    assert vehicle.mission is None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"speed_m_s": (100.0, float("inf"))}, "flown.speed_m_s: arrived 100 to inf"),
        ({"wind_m_s": -5.0}, "flown.wind_m_s: arrived -5; expected a finite number from 0"),
    ],
)
def test_ranges_are_finite_and_not_negative(given, message):
    with pytest.raises(ValueError, match=message):
        FlightRange(**{"speed_m_s": (100.0, 200.0), "altitude_m": (1000.0, 2000.0), **given})


@pytest.mark.long
def test_derived_gains_are_those_of_the_step():
    coarse, fine = (single_aircraft("aerosonde", {}, step_s)[0].controller.gains.rates for step_s in (0.02, 0.01))
    assert np.all(np.asarray(coarse.proportional) < np.asarray(fine.proportional))


def test_periods_of_sensors_and_an_own_airspeed_are_checked():
    navigation = {"sensors": "satellite-inertial", "period_s": 0.01}
    with pytest.raises(ScenarioError, match=r"aircraft\[0\]\.speed_m_s .*arrived 45"):
        single_aircraft({"speed_m_s": 45.0}, {})
    with pytest.raises(ScenarioError, match=r"navigation\.period_s: arrived 0\.01"):
        single_aircraft("f16", {"navigation": navigation}, 0.02)


def test_narrow_ranges_of_airspeed_have_starts():
    vehicle, _ = single_aircraft("f16", {})
    autopilot = vehicle.controller

    def speeds(least, greatest):
        limits = dataclasses.replace(autopilot.limits, speed_min=jnp.asarray(least), speed_max=jnp.asarray(greatest))
        narrow = dataclasses.replace(autopilot, limits=limits)
        return default_range(dataclasses.replace(vehicle, controller=narrow)).speed_m_s

    assert speeds(100.0, 108.0) == pytest.approx((103.0, 105.0))
    assert speeds(90.0, 240.0) == (1.1 * 90.0, 0.9 * 240.0)
    with pytest.raises(ValueError, match="aircraft: arrived limits of the airspeed of 350 to 400 m/s; expected"):
        speeds(350.0, 400.0)
    with pytest.raises(ValueError, match=r"flown.altitude_m: arrived 2000 to 1000; expected a least and a greatest"):
        FlightRange((100.0, 120.0), (2000.0, 1000.0))


@pytest.mark.parametrize(
    ("data_m", "flown_m"),
    [
        ((-100.0, 800.0), (-100.0, 800.0)),
        ((1500.0, 20e3), (1500.0, 8e3)),
        ((0.0, 3e3), (1e3, 3e3)),
        ((9e3, 12e3), (9e3, 12e3)),
    ],
)
def test_starts_are_within_the_altitudes_of_the_data(data_m, flown_m):
    vehicle, _ = single_aircraft("aerosonde", {})
    data = dataclasses.replace(vehicle.airframe.validity, altitude=tuple(map(jnp.asarray, data_m)))
    vehicle = eqx.tree_at(lambda v: v.airframe.validity, vehicle, data)
    assert default_range(vehicle).altitude_m == flown_m


def test_upsets_start_within_the_data_of_the_aircraft():
    vehicle, environment = single_aircraft("f16", {})
    flown = default_range(vehicle)
    for greatest in (25.0, 12.0):
        starts, _ = UpsetRecovery().draw(vehicle, environment, flown, 64, np.random.default_rng(0))
        assert greatest - 2.0 < np.rad2deg(starts.alpha).max() <= greatest
        vehicle = eqx.tree_at(lambda v: v.airframe.alpha_range[1], vehicle, jnp.deg2rad(12.0))


def test_observed_commands_have_the_unit_of_their_variable():
    """An airspeed, an angle, a rate and a path angle of 0 (None), as commands of a user's task."""

    class Commanded(VelocityCommand):
        aims = (
            Aim("airspeed_m_s", command_scale=50.0),
            Aim("path_angle_deg", command_scale=10.0),
            Aim("roll_rate_deg_s", tolerance=2.0, difference_scale=10.0),
            Aim("bank_deg", difference_scale=90.0, command_scale=90.0),
        )

    values = {"airspeed_m_s": 140.0, "path_angle_deg": 1.0, "roll_rate_deg_s": 4.0, "bank_deg": 20.0}
    case = types.SimpleNamespace(task=(150.0, math.radians(5.0), math.radians(10.0), None))
    situation = types.SimpleNamespace(case=case, estimates=values, variables=values)
    np.testing.assert_allclose(Commanded().observation(situation), [6.0, -20.0, 150.0, 5.0, 0.0], rtol=1e-6)
    np.testing.assert_allclose(Commanded().errors(situation), [-3.0], rtol=1e-6)


def test_commanded_courses_are_within_half_a_turn():
    vehicle, environment = single_aircraft("f16", {})
    drawn = VelocityCommand().draw(vehicle, environment, default_range(vehicle), 64, np.random.default_rng(0))
    assert np.abs(np.asarray(drawn[1])[:, 2]).max() <= np.pi
    south = types.SimpleNamespace(velocity_b=jnp.array([-100.0, 1.0, 0.0]))
    still = types.SimpleNamespace(R_bn=jnp.eye(3), wind_n=jnp.zeros(3))
    belief = types.SimpleNamespace(state=south, condition=still)
    command = LEVELS["velocity"].command(jnp.array([0.0, 0.0, 1.0]), vehicle.controller, belief)
    assert float(command.chi) == pytest.approx(-0.5 * np.pi - 0.01, abs=1e-4)


def test_a_score_needs_an_episode():
    with pytest.raises(ValueError, match="episodes: arrived 0; expected at least 1"):
        score(velocity_command(), "zero", episodes=0)


def test_a_wrong_table_is_refused_with_its_key():
    with pytest.raises(ScenarioError, match=r"turbulence\.intensity"):
        make("VelocityCommand", cases=8, turbulence={"intensity": "some"})


def test_a_wrong_key_is_refused():
    with pytest.raises(ValueError, match=r"key: arrived words of shape \(3,\)"):
        programs()[0].reset(jnp.zeros(3, jnp.uint32))
