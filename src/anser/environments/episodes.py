"""Functions that fly episodes under a policy, and return scores, records, or flights with all variables."""

import dataclasses
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8

from anser.control.inversion_autopilot import InversionAutopilot
from anser.environment.atmosphere import atmosphere_layers
from anser.environments.actions import AutopilotStep, SurfaceLevel
from anser.environments.cases import Case
from anser.environments.environment import AircraftEnvironment, EpisodeState, Parameters
from anser.environments.fleet import FleetEnvironment
from anser.numerics.arrays import cast_like, unstack_rows, zeros_like_result
from anser.parts.paths import PathCommand
from anser.results.documents import version_attributes
from anser.simulation.closed_loop import guide_and_move, perceive
from anser.simulation.recorders import record
from anser.simulation.vehicle import VehicleState
from anser.single_aircraft.flight import OPEN_LOOP, AircraftFlight, flight_dataset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AnyEnvironment = AircraftEnvironment | FleetEnvironment
Policy = Callable[[Array, Float[Array, " entry"], EpisodeState, Any], tuple[Float[Array, " action"], Any]]
"""Function (key, observation, state of the episode, state of the policy) that returns action and new policy state."""


@dataclasses.dataclass(frozen=True, eq=False)
class Expert:
    """Scripted policy: the dynamic-inversion autopilot flies the task through the environment's action level."""

    environment: AnyEnvironment

    def _autopilot(self, case: Case) -> InversionAutopilot:
        loop = self.environment.single.task.expert_loop
        return InversionAutopilot(case.autopilot.gains, case.autopilot.limits, loop=loop)

    def _start(self, case: Case, params: Parameters) -> Any:
        start = case.start
        settled = self._autopilot(case).init(start.state, jnp.stack([start.mu, start.alpha, start.beta]))
        return jax.tree.map(lambda leaf: jnp.asarray(leaf, params.step.dtype), settled)

    def init(self, state: EpisodeState, params: Parameters) -> Any:
        """Return the autopilot's state at the start of an episode; for a fleet with a leading axis of aircraft."""
        return self.environment.each(lambda case, _: self._start(case, params), state, params)

    def act(self, state: EpisodeState, expert_state: Any, params: Parameters) -> tuple[Float[Array, "..."], Any]:
        """Return action and new autopilot state; at the first decision of an episode `expert_state` has no effect."""
        single = self.environment.single

        def act(case: Case, vehicle: VehicleState, autopilot_state: Any) -> tuple[Float[Array, " action"], Any]:
            situation = single.situation_of(state, params, case, vehicle)
            settled = self._start(case, params)
            is_start = state.time == 0
            autopilot_state = jax.tree.map(functools.partial(jnp.where, is_start), settled, autopilot_state)
            command, period = single.task.expert_command(situation), params.step * single.decision_steps
            autopilot, belief = self._autopilot(case), situation.belief
            controls, signals, advanced = autopilot.control(autopilot_state, belief, command, period)
            step = AutopilotStep(command, controls, signals)
            return single.level.action(step, case.autopilot, belief), cast_like(advanced, autopilot_state)

        return self.environment.each(act, state, params, expert_state)


@dataclasses.dataclass(frozen=True)
class Score:
    """Result of a policy over many episodes."""

    success: float  #: Fraction of the episodes that ended with success.
    mean_return: float  #: Mean over the episodes of (sum of rewards / decisions of a full episode), 0..1.
    failed: float  #: Fraction of the episodes that ended by failure.
    successes: np.ndarray  #: Whether each episode ended with success, shape (episode,).


@dataclasses.dataclass(frozen=True)
class Episode:
    """Record of one episode under a policy."""

    environment: AnyEnvironment
    start: EpisodeState  #: State at the start.
    observations: Float[np.ndarray, "decisions+1 *aircraft entry"]  #: Before each decision and after the last.
    actions: Float[np.ndarray, "decisions *aircraft action"]
    rewards: Float[np.ndarray, "decisions ..."]
    terminated: bool  #: Whether the episode ended by failure.
    success: bool  #: Whether the episode ended with success.

    def flight(self, agent: str | None = None) -> AircraftFlight:
        """Fly the recorded actions again, and return the flight of aircraft `agent` with all variables.

        For `agent` and errors see `record_flight`.
        """
        return record_flight(self.environment, self.start, self.actions, agent)


def score(environment: AnyEnvironment, policy: str | Policy = "expert", episodes: int = 1000, seed: int = 1) -> Score:
    """Fly episodes under a policy, and return the score.

    Parameters
    ----------
    environment
        Environment of one aircraft or of a fleet.
    policy
        "expert" (see `Expert`), "zero" (action 0), "random" (uniform in -1..1), or a function `(key, observation,
        state, policy_state)` that returns action and new policy state. The first `policy_state` of an episode is None.
        Raises ValueError for another name.
    episodes
        Number of episodes. Raises ValueError for less than 1.
    seed
        Seed of the cases and of random actions.
    """
    _, sums, _ = _fly(environment, policy, episodes, seed, is_recorded=False)
    returns, successes, failures = sums
    return Score(float(successes.mean()), float(returns.mean()), float(failures.mean()), successes)


def fly_episodes(
    environment: AnyEnvironment, policy: str | Policy = "expert", episodes: int = 1, seed: int = 0
) -> list[Episode]:
    """Fly episodes under a policy, and return the records of the episodes.

    For arguments and errors see `score`. With equal arguments, `score` starts the same episodes.
    """
    starts, _, rows = _fly(environment, policy, episodes, seed, is_recorded=True)
    recorded: list[Episode] = []
    for start, row in unstack_rows((starts, rows)):
        observations, following, actions, rewards, terminated, is_over, success = row
        count = int(np.argmax(is_over)) + 1
        observed = np.concatenate([observations[:count], following[count - 1 : count]])
        ends = bool(terminated[count - 1]), bool(success[count - 1])
        recorded.append(Episode(environment, start, observed, actions[:count], rewards[:count], *ends))
    return recorded


def _fly(environment: AnyEnvironment, policy: str | Policy, episodes: int, seed: int, *, is_recorded: bool) -> Any:
    """Fly episodes to the end, and return starts, scores and records, each with a leading axis over the episodes.

    - Scores: mean reward (0..1), success, failure.
    - Records of every decision: observation before, observation after, action, reward, terminated, ended, success.
      Records after the end of an episode have no meaning. If `is_recorded` is false, the records are None.
    """
    if episodes < 1:
        raise ValueError(f"episodes: arrived {episodes}; expected at least 1")
    init, act = resolve_policy(environment, policy)
    params = environment.default_params
    numbers = jnp.arange(int(np.max(np.asarray(params.decisions))))

    def fly(key: Array, params: Parameters) -> Any:
        first, start = environment.reset(key, params)

        def advance(carry: Any, number: Array) -> tuple[Any, Any]:
            observation, state, policy_state, total, success, failure, done = carry
            step_key = jax.random.fold_in(key, number)
            action, policy_state = act(step_key, observation, state, policy_state, params)
            # a recorded action must be the flown action
            action = jnp.clip(action, -1.0, 1.0).astype(jnp.float32) if is_recorded else action
            following, flown, reward, terminated, info = environment.step_env(step_key, state, action, params)
            total = total + jnp.where(done, 0.0, jnp.mean(reward))
            success, failure = success | (info["success"] & ~done), failure | (terminated & ~done)
            is_over = terminated | info["truncated"]
            row = observation, following, action, reward, terminated, is_over, info["success"]
            done = done | is_over
            state = jax.tree.map(lambda new, old: jnp.where(done, old, new), flown, state)
            return (following, state, policy_state, total, success, failure, done), row if is_recorded else None

        is_false = jnp.zeros((), bool)
        carry = first, start, init(start, params), jnp.zeros((), params.step.dtype), is_false, is_false, is_false
        (_, final, _, total, success, failure, _), rows = jax.lax.scan(advance, carry, numbers)
        return start, (total / jnp.max(params.decisions[final.row]), success, failure), rows

    keys = jax.random.split(jax.random.key(seed), episodes)
    return jax.tree.map(np.asarray, jax.jit(jax.vmap(fly, (0, None)))(keys, params))


def resolve_policy(environment: AnyEnvironment, policy: str | Policy) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return a policy (see `score`) as two functions, `init` and `act`. Raises ValueError for an unknown name.

    - `init(state, params)` returns the policy's state at the start of an episode.
    - `act(key, observation, state, policy_state, params)` returns action and new policy state.
    """

    def shape(observation: Array) -> tuple[int, ...]:
        return *observation.shape[:-1], environment.num_actions

    expert, random = Expert(environment), jax.random.uniform
    functions: dict[Any, Callable[..., Any]] = {
        "expert": lambda key, observation, state, own, params: expert.act(state, own, params),
        "zero": lambda key, observation, *_: (jnp.zeros(shape(observation)), None),
        "random": lambda key, observation, *_: (random(key, shape(observation), jnp.float32, -1.0, 1.0), None),
    }
    if not callable(policy) and policy not in functions:
        raise ValueError(f'policy: arrived {policy!r}; expected "expert", "zero", "random", or a function')
    act = (lambda *arguments: policy(*arguments[:4])) if callable(policy) else functions[policy]
    return expert.init if policy == "expert" else lambda state, params: None, act


def record_flight(
    environment: AnyEnvironment, start: EpisodeState, actions: Float[np.ndarray, "..."], agent: str | None = None
) -> AircraftFlight:
    """Fly recorded actions from the start of an episode, and return the flight with all variables at every step.

    `actions` must have shape (decision, entry); for a fleet (decision, aircraft, entry). If `actions` is empty, the
    flight has one sample, with the action 0. `agent` must name the returned aircraft of a fleet, and must be None for
    an environment of one aircraft. The flight is stored in float64. Raises ValueError for another `agent`, and for more
    actions than the episode has decisions.
    """
    params, member, level = environment.default_params, environment.single, environment.single.level
    vehicle_state, actions = start.vehicle, np.asarray(actions, np.float32)
    if isinstance(environment, FleetEnvironment):
        if agent not in environment.agents:
            raise ValueError(f"agent: arrived {agent!r}; expected one of {', '.join(environment.agents)}")
        index = environment.agents.index(agent)
        case, actions = environment.cases(start, params).at(index), actions[:, index]
        vehicle_state = jax.tree.map(lambda leaf: leaf[index], vehicle_state)
    elif agent is not None:
        raise ValueError(f"agent: arrived {agent!r}; expected None, for the environment has one aircraft")
    else:
        case = params.case(start.row)
    count, longest = len(actions), int(case.decisions)
    if count > longest:
        raise ValueError(f"actions: arrived {count} decisions; expected at most {longest}, the length of the episode")
    table = np.zeros((int(np.max(np.asarray(params.decisions))), member.num_actions), np.float32)
    table[:count], table[count:] = actions, actions[-1] if count else 0.0
    history = _recorder(member)(case, vehicle_state, start.key, table, np.int32(count), params)
    rows = count * member.decision_steps + 1
    columns = {key: np.asarray(values, np.float64)[:rows] for key, values in history.items()}
    controller = OPEN_LOOP if isinstance(level, SurfaceLevel) else type(level.controller(case.autopilot)).__name__
    attributes = {
        **member.identity,
        **({} if agent is None else {"agent": agent}),
        "controls": f"{member.name}, actions of {type(level).__name__}",
        "controller": controller,
        "command": "",
        "step_s": float(params.step),
        "air": "that of the environment",
        "case": int(start.row),
        **version_attributes(),
    }
    time_s, surfaces = np.arange(rows) * float(params.step), case.vehicle.airframe.actuators.names
    layers = atmosphere_layers(case.environment.atmosphere)
    return AircraftFlight(flight_dataset(time_s, columns, surfaces, attributes, layers))


@functools.lru_cache(maxsize=4)
def _recorder(environment: AircraftEnvironment) -> Any:
    """Return a compiled function `fly(case, start, key, actions, count, params)` that flies and records an episode.

    `fly` flies the first `count` rows of `actions` from the aircraft's state `start` with the random `key`, and returns
    the recorded variables by key of the catalogue, with one value per integration step.
    """
    steps = environment.decision_steps

    @jax.jit
    def fly(
        case: Case, start: VehicleState, key: Array, actions: Array, count: Array, params: Parameters
    ) -> dict[str, Array]:
        actions = jnp.clip(actions.astype(params.step.dtype), -1.0, 1.0)
        last = jnp.maximum(count * steps, 1)

        def advance(number: Array, vehicle_state: Any, held: Any) -> tuple[Any, Any, dict[str, Array]]:
            instant = environment.instant(case, number, key, params)
            perception = perceive(environment.flown_vehicle(case, None), vehicle_state, instant)
            command = environment.level.command(actions[number // steps], case.autopilot, perception.belief)
            if held is not None:
                is_decision = (number % steps == 0) & (number < last)
                command = jax.tree.map(functools.partial(jnp.where, is_decision), command, held)
            vehicle = environment.flown_vehicle(case, command)
            flown, sample = guide_and_move(vehicle, vehicle_state, perception, instant)
            if not isinstance(command, PathCommand):
                nan = jnp.asarray(jnp.nan)
                sample = dataclasses.replace(sample, command=PathCommand(nan, nan, nan, nan, nan, nan))
            return cast_like(flown, vehicle_state), command, record(sample)

        _, command, row = zeros_like_result(advance, jnp.zeros((), jnp.int32), start, None)
        rows = {name: jnp.zeros(len(actions) * steps + 1, value.dtype) for name, value in row.items()}

        def store(number: Array, carry: Any) -> Any:
            *carry, rows = carry
            *carry, row = advance(number, *carry)
            return *carry, {name: rows[name].at[number].set(row[name]) for name in rows}

        return jax.lax.fori_loop(0, count * steps + 1, store, (start, command, rows))[2]

    return fly


def figure_pixels(figure: "Figure") -> UInt8[np.ndarray, "height width 3"]:
    """Return the pixels of a figure at 80 per inch, RGB in 0..255."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(80)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
