"""Records of episodes: observations, actions and rewards; the flight with every variable; figures as pixels."""

import dataclasses
import functools
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8

from anser.environment.atmosphere import atmosphere_layers
from anser.environments.actions import SurfaceLevel
from anser.environments.cases import Case
from anser.environments.environment import AircraftEnvironment, EpisodeState, Parameters
from anser.environments.experts import Policy, resolve_policy
from anser.environments.fleet import FleetEnvironment
from anser.numerics.arrays import cast_like, zeros_like_result
from anser.parts.paths import PathCommand
from anser.results.documents import version_attributes
from anser.simulation.closed_loop import command_and_move, perceive
from anser.simulation.recorders import record
from anser.simulation.vehicle import VehicleState
from anser.single_aircraft.flight import OPEN_LOOP, AircraftFlight, flight_dataset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FRAME_DPI = 80


@dataclasses.dataclass(frozen=True)
class Episode:
    """Record of one episode.

    Attributes
    ----------
    environment
        The environment.
    start
        State at the start.
    observations
        Observation before each decision, and after the last one.
    actions, rewards
        Action and reward of each decision.
    terminated, success
        Whether the episode ended by failure, and whether it ended with success.
    """

    environment: AircraftEnvironment | FleetEnvironment
    start: EpisodeState
    observations: Float[np.ndarray, "decisions+1 *aircraft entry"]
    actions: Float[np.ndarray, "decisions *aircraft action"]
    rewards: Float[np.ndarray, "decisions *aircraft"]
    terminated: bool
    success: bool

    def flight(self, agent: str | None = None) -> AircraftFlight:
        """Fly the recorded actions again, and return the flight with all variables; of one `agent` for a fleet."""
        return record_flight(self.environment, self.start, self.actions, agent)


def fly_episodes(
    environment: AircraftEnvironment | FleetEnvironment,
    policy: str | Policy = "expert",
    episodes: int = 1,
    seed: int = 0,
) -> list[Episode]:
    """Fly episodes under a policy and record them; the episodes are those of `score` with the same seed.

    Parameters
    ----------
    policy
        "expert", "zero", "random", or a function `(key, observation, state, policy_state)` to action and policy state.
    episodes, seed
        Number of episodes, and seed of their starts and of the random actions.
    """
    if episodes < 1:
        raise ValueError(f"episodes: arrived {episodes}; expected at least 1")
    params = environment.default_params
    decisions = int(np.max(np.asarray(params.cases.batched.decisions)))
    function = resolve_policy(environment, policy)

    @jax.jit
    def fly(keys: Array, params: Any) -> Any:
        return jax.vmap(lambda key: episode(key, params))(keys)

    def episode(key: Array, params: Any) -> Any:
        observation, start = environment.reset(key, params)

        def advance(carry: Any, number: Array) -> tuple[Any, Any]:
            observation, state, policy_state = carry
            step_key = jax.random.fold_in(key, number)
            action, policy_state = function.act(step_key, observation, state, policy_state, params)
            action = jnp.clip(action, -1.0, 1.0).astype(jnp.float32)
            following, flown, reward, terminated, info = environment.step_env(step_key, state, action, params)
            row = observation, action, reward, terminated, info["truncated"], info["success"], following
            return (following, flown, policy_state), row

        carry = observation, start, function.init(start, params)
        return start, jax.lax.scan(advance, carry, jnp.arange(decisions))[1]

    starts, rows = jax.tree.map(np.asarray, fly(jax.random.split(jax.random.key(seed), episodes), params))
    return [
        _cut_episode(environment, *jax.tree.map(lambda leaf, k=k: leaf[k], (starts, rows))) for k in range(episodes)
    ]


def _cut_episode(environment: AircraftEnvironment | FleetEnvironment, start: EpisodeState, rows: Any) -> Episode:
    """Return the rows up to the first end of the episode."""
    observations, actions, rewards, terminated, truncated, success, following = rows
    last = int(np.argmax(terminated | truncated))
    count = last + 1
    observed = np.concatenate([observations[:count], following[last:count]])
    ends = bool(terminated[last]), bool(success[last])
    return Episode(environment, start, observed, actions[:count], rewards[:count], *ends)


def record_flight(
    environment: AircraftEnvironment | FleetEnvironment,
    start: EpisodeState,
    actions: Float[np.ndarray, "decisions *aircraft action"],
    agent: str | None = None,
) -> AircraftFlight:
    """Fly recorded actions from the start of an episode, and record the variables of the catalogue at every step.

    Parameters
    ----------
    start
        State at the start.
    actions
        Actions of the decisions so far; without any, the flight has one sample, with the action 0.
    agent
        Name of the aircraft, for a fleet.

    Returns
    -------
    AircraftFlight
        Flight in the precision of the environment, stored in float64, as `anser.simulate` returns.
    """
    params = environment.default_params
    vehicle_state, actions = start.vehicle, np.asarray(actions, np.float32)
    if isinstance(environment, FleetEnvironment):
        if agent not in environment.agents:
            raise ValueError(f"agent: arrived {agent!r}; expected one of {', '.join(environment.agents)}")
        index = environment.agents.index(agent)
        case = environment.cases(start, params).at(index)
        vehicle_state = jax.tree.map(lambda leaf: leaf[index], vehicle_state)
        member, actions = environment.member, actions[:, index]
    else:
        if agent is not None:
            raise ValueError(f"agent: arrived {agent!r}; expected None, for the environment has one aircraft")
        member, case = environment, params.case(start.row)
    count, steps = len(actions), member.decision_steps
    if count > (longest := int(case.decisions)):
        raise ValueError(f"actions: arrived {count} decisions; expected at most {longest}, the length of the episode")
    table = np.zeros((int(np.max(np.asarray(params.cases.batched.decisions))), member.num_actions), np.float32)
    table[:count], table[count:] = actions, actions[-1] if count else 0.0
    history = _recorder(member)(case, vehicle_state, start.key, table, np.int32(count), params)
    rows = count * steps + 1
    columns = {key: np.asarray(values, np.float64)[:rows] for key, values in history.items()}
    level = member.level
    attributes = {
        "aircraft": agent or member.aircraft,
        "controls": f"{member.name}, actions of {type(level).__name__}",
        "controller": OPEN_LOOP if isinstance(level, SurfaceLevel) else type(level.controller(case.autopilot)).__name__,
        "command": "",
        "step_s": float(params.step),
        "air": "that of the environment",
        "case": int(start.row),
        **version_attributes(),
    }
    time_s = np.arange(rows) * float(params.step)
    layers = atmosphere_layers(case.environment.atmosphere)
    return AircraftFlight(flight_dataset(time_s, columns, case.vehicle.airframe.actuators.names, attributes, layers))


@functools.lru_cache(maxsize=4)
def _recorder(environment: AircraftEnvironment) -> Any:
    """Return the compiled flight of an environment under a table of actions, as variables by key."""
    steps = environment.decision_steps

    @jax.jit
    def fly(
        case: Case, start: VehicleState, key: Array, actions: Array, count: Array, params: Parameters
    ) -> dict[str, Array]:
        actions = jnp.clip(actions.astype(params.step.dtype), -1.0, 1.0)
        last = jnp.maximum(count * steps, 1)

        def advance(number: Array, vehicle_state: Any, command: Any) -> tuple[Any, Any, dict[str, Array]]:
            instant = environment.instant(case, number, key, params)
            perception = perceive(environment.flown_vehicle(case, None), vehicle_state, instant)
            fresh = environment.level.command(actions[number // steps], case.autopilot, perception.belief)
            is_decision = (number % steps == 0) & (number < last)
            command = fresh if command is None else jax.tree.map(partial(jnp.where, is_decision), fresh, command)
            flown, sample = command_and_move(
                environment.flown_vehicle(case, command), vehicle_state, perception, instant
            )
            if not isinstance(command, PathCommand):
                nan = jnp.asarray(jnp.nan)
                sample = dataclasses.replace(sample, command=PathCommand(nan, nan, nan, nan, nan, nan))
            return cast_like(flown, vehicle_state), command, record(sample)

        _, command, row = zeros_like_result(advance, jnp.zeros((), jnp.int32), start, None)
        rows = {name: jnp.zeros(len(actions) * steps + 1, value.dtype) for name, value in row.items()}

        def store(number: Array, carry: Any) -> Any:
            vehicle_state, command, rows = carry
            vehicle_state, command, row = advance(number, vehicle_state, command)
            return vehicle_state, command, {name: rows[name].at[number].set(row[name]) for name in rows}

        return jax.lax.fori_loop(0, count * steps + 1, store, (start, command, rows))[2]

    return fly


def figure_pixels(figure: "Figure") -> UInt8[np.ndarray, "height width 3"]:
    """Return the pixels of a figure, RGB."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(_FRAME_DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
