"""Environment of one aircraft for reinforcement learning, with the functions of gymnax 1.0 such as `reset` and `step`.

All functions are pure and compute one environment; `jax.vmap` computes many at once.
"""

import abc
import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from anser.environment.gridded_wind import has_left_field
from anser.environments.actions import AbstractActionLevel
from anser.environments.cases import Case, Situation
from anser.environments.planned_tasks import PlannedMission, comes_too_near
from anser.environments.spaces import Box, Entry, catalogue_entry
from anser.environments.tasks import AbstractTask
from anser.numerics.arrays import Stacked, cast_like, cast_to_precision
from anser.numerics.randomness import SeededRandomness
from anser.parts.perception import Belief, Instant
from anser.shapes import Flag, Integer, Scalar
from anser.simulation.closed_loop import guide_and_move, perceive, trimmed_vehicle
from anser.simulation.open_loop import believed_variables
from anser.simulation.response import ConstantCommand
from anser.simulation.vehicle import Vehicle, VehicleState
from anser.units import RAD_DEG

Observations = Float[Array, "*aircraft entry"]
Actions = Float[Array, "*aircraft action"]
_EPISODE_MASK = np.uint32(0x9E3779B9)
"""Arbitrary number, combined with a reset's key so that the episode's random numbers differ from the user's draws."""
_ALPHA_MARGIN_DEG = 10.0
"""Margin beyond the aircraft's range of angle of attack at which an episode ends by failure, deg."""

MOTION = (
    catalogue_entry("airspeed_m_s", 150.0, 100.0),
    catalogue_entry("altitude_m", 4000.0, 4000.0),
    catalogue_entry("alpha_deg", 0.0, 25.0),
    catalogue_entry("beta_deg", 0.0, 10.0),
    catalogue_entry("bank_deg", 0.0, 180.0),
    catalogue_entry("path_angle_deg", 0.0, 45.0),
    catalogue_entry("roll_rate_deg_s", 0.0, 90.0),
    catalogue_entry("pitch_rate_deg_s", 0.0, 45.0),
    catalogue_entry("yaw_rate_deg_s", 0.0, 45.0),
    catalogue_entry("load_factor", 1.0, 4.0),
    catalogue_entry("power_percent", 50.0, 50.0),
)
"""Table of the first entries of every observation: the aircraft's motion. Surface deflections and the task follow."""


class Parameters(eqx.Module):
    """Cases and integration step of an environment; the argument `params` of the environment's functions."""

    #: Cases of the episodes, stacked along a leading axis; for a fleet along two axes, (case, aircraft).
    cases: Stacked[Case]
    #: Observation at the start of each case, computed in advance; None: each reset computes the observation. Must be
    #: None if gusts or sensor errors are random, or if `cases` or `step` have been changed.
    observations: Float[Array, "case entry"] | None
    step: Scalar  #: Step of the integration, s.

    @property
    def decisions(self) -> Integer:
        """Number of decisions of a full episode of each case, shape (case,); for a fleet (case, aircraft)."""
        return self.cases.batched.decisions

    def case(self, row: Integer) -> Case:
        """Return case number `row` of an environment of one aircraft, counted from 0."""
        return self.cases.at(row)  # pyright: ignore[reportArgumentType]


class EpisodeState(eqx.Module):
    """State of one environment between two decisions."""

    time: Integer  #: Number of decisions since the reset.
    row: Integer  #: Index of the case in `Parameters.cases`.
    key: UInt32[Array, "2"]  #: Key of the episode's random numbers.
    vehicle: VehicleState  #: State of the aircraft; for a fleet with a leading axis over the aircraft.
    settled: Integer  #: Number of successive decisions, up to the latest, with all errors within the tolerances.


class AbstractEnvironment(abc.ABC):
    """Common functions of the environments of one aircraft and of a fleet.

    In the environment of a fleet, observations, actions and rewards have a leading axis over the aircraft. An
    environment is hashable, as `jax.jit(environment.step)` requires.
    """

    observed: tuple[Entry, ...]  #: Table of the entries of one aircraft's observation.
    #: Flag of gymnax's interface: True means that `with_transition_gradients` exists.
    supports_transition_gradients: ClassVar[bool] = True

    def __deepcopy__(self, memo: Any) -> Self:
        return self  # nothing of it can change

    @property
    @abc.abstractmethod
    def single(self) -> "AircraftEnvironment":
        """Environment of one aircraft: this environment itself, or the `member` of a fleet's environment."""

    @abc.abstractmethod
    def each(self, function: Callable[..., Any], state: EpisodeState, params: Parameters, *arguments: Any) -> Any:
        """Call `function(case, vehicle, *arguments)` for each aircraft of the environment, and return the results.

        `case` is the aircraft's case in the episode and `vehicle` the aircraft's state. For a fleet, `arguments` and
        results have a leading axis over the aircraft.
        """

    @abc.abstractmethod
    def judge(self, situation: Situation) -> tuple[Float[Array, "..."], Float[Array, "..."], Flag]:
        """Return errors divided by the tolerances, reward (0..1), and whether the episode ends by failure."""

    @abc.abstractmethod
    def observation_of(self, situation: Situation) -> Observations:
        """Return the observation in the order of `observed`, normalized, about -1..1 in ordinary flight."""

    @property
    def default_params(self) -> Parameters:
        """Parameters with which the environment was made."""
        return self.single.parameters

    @property
    def num_actions(self) -> int:
        """Number of entries of one aircraft's action."""
        return len(self.single.commanded)

    def observation_space(self, params: Parameters | None = None) -> Box:
        """Return the unbounded space of one aircraft's observations."""
        return Box(-np.inf, np.inf, (len(self.observed),))

    def action_space(self, params: Parameters | None = None) -> Box:
        """Return the space of one aircraft's actions, -1..1."""
        return Box(-1.0, 1.0, (self.num_actions,))

    def reset(self, key: Array, params: Parameters | None = None) -> tuple[Observations, EpisodeState]:
        """Return observation and state at the start of an episode.

        Parameters
        ----------
        key
            Key of JAX's default generator, a typed key or two raw 32-bit words; raises ValueError for another shape.
            The key seeds the episode's random numbers, and selects case (word 0 xor word 1) modulo the number of cases.
            Keys of consecutive seeds select consecutive cases; split or folded keys select random cases.
        params
            Parameters; None: `default_params`.
        """
        params = self.default_params if params is None else params
        entropy = jax.random.key_data(key) if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else key
        if entropy.shape != (2,):
            raise ValueError(f"key: arrived words of shape {entropy.shape}; expected (2,), as of jax.random.key(seed)")
        row = ((entropy[0] ^ entropy[1]) % np.uint32(len(params.decisions))).astype(jnp.int32)
        state = self.start_of_case(row, entropy ^ _EPISODE_MASK, params)
        if params.observations is not None:
            return params.observations[row], state
        return self.observe(key, state, None, params), state

    def start_of_case(self, row: Integer, key: UInt32[Array, "2"], params: Parameters) -> EpisodeState:
        """Return the state at the start of case `row`; `key` seeds the episode's random numbers."""
        zero, shape = jnp.zeros((), jnp.int32), params.decisions.shape[1:]
        state = EpisodeState(zero, row, key, None, zero)  # pyright: ignore[reportArgumentType]

        def start(case: Case, _: None, place: Integer) -> VehicleState:
            vehicle, instant = self.single.flown_vehicle(case, None), self.single.instant(case, zero, key, params)
            return cast_to_precision(trimmed_vehicle(vehicle, instant, case.start, place), params.step.dtype)

        places = np.arange(np.prod(shape, dtype=int), dtype=np.int32).reshape(shape)
        return dataclasses.replace(state, vehicle=self.each(start, state, params, places))

    def observe(
        self, key: Array, state: EpisodeState, action: Any = None, params: Parameters | None = None
    ) -> Observations:
        """Return the observation in a state; `key` and `action` have no effect."""
        return self.observation_of(self.situation(state, params))

    def situation(self, state: EpisodeState, params: Parameters | None = None) -> Situation:
        """Return true and estimated motion in a state, for a fleet with a leading axis over the aircraft."""
        params = self.default_params if params is None else params
        return self.each(functools.partial(self.single.situation_of, state, params), state, params)

    def step(
        self, key: Array, state: EpisodeState, action: Actions, params: Parameters | None = None
    ) -> tuple[Observations, EpisodeState, Float[Array, "*aircraft"], Flag, Flag, dict[str, Array]]:
        """Fly one decision; an episode that ends is reset within the step.

        Parameters
        ----------
        key
            Key of the next episode, used if the present episode ends.
        state
            State of the present episode.
        action
            Action, clipped to -1..1.
        params
            Parameters; None: `default_params`.

        Returns
        -------
        observation, state
            Values after the decision; if the episode ended, values at the start of the next episode.
        reward
            0..1; 0 at a failure.
        terminated
            Whether the episode ended by failure.
        truncated
            Whether the episode ended at full length without a failure.
        info
            `final_observation` (before a reset), `success`, `terminated`, `truncated`, and `discount` (0 at a failure,
            1 at any other decision).
        """
        params = self.default_params if params is None else params
        *flown, reward, terminated, info = self.step_env(key, state, action, params)
        done = terminated | info["truncated"]
        restart = list(self.reset(key, params))
        observation, state = jax.tree.map(lambda new, old: jnp.where(done, new, old), restart, flown)
        return observation, state, reward, terminated, info["truncated"], info

    def step_env(
        self, key: Array, state: EpisodeState, action: Actions, params: Parameters
    ) -> tuple[Observations, EpisodeState, Float[Array, "*aircraft"], Flag, dict[str, Array]]:
        """Fly one decision without a reset: return observation, state, reward, `terminated` and `info` (see `step`).

        `key` has no effect.
        """
        single = self.single
        fly = functools.partial(single.fly_decision, state, params)
        flown = dataclasses.replace(state, time=state.time + 1, vehicle=self.each(fly, state, params, action))
        situation = self.situation(flown, params)
        errors, reward, terminated = self.judge(situation)
        within = jnp.all(jnp.abs(errors) <= 1.0) & ~terminated
        settled = jnp.where(within, flown.settled + 1, 0).astype(flown.settled.dtype)
        result = self.observation_of(situation), dataclasses.replace(flown, settled=settled)
        if not single.transition_gradients_enabled:
            result = jax.tree.map(jax.lax.stop_gradient, result)
        observation, flown = result
        truncated = ~terminated & (flown.time >= jnp.max(params.decisions[state.row]))
        info = {
            "final_observation": observation,
            "success": truncated & (settled >= max(1, round(single.task.settled_s / single.level.decision_s))),
            "terminated": terminated,
            "truncated": truncated,
            "discount": jnp.where(terminated, 0.0, 1.0),
        }
        reward = jnp.where(terminated, 0.0, reward).astype(single.parameters.step.dtype)
        return observation, flown, reward, terminated, info


@dataclasses.dataclass(frozen=True, eq=False)
class AircraftEnvironment(AbstractEnvironment):
    """Environment of one aircraft that flies a task; `level` determines what an action commands."""

    task: AbstractTask  #: Task, which defines reward, success and failure.
    level: AbstractActionLevel  #: Level at which an action enters the closed loop.
    parameters: Parameters  #: Default parameters, `default_params`.
    observed: tuple[Entry, ...]  #: Table of the entries of observations.
    commanded: tuple[Entry, ...]  #: Table of the entries of actions.
    decision_steps: int  #: Number of integration steps in a decision.
    name: str  #: Name of the task.
    #: Name of the aircraft (`aircraft`), and `variant` and `x_cg_over_c` if any, for the attributes of flights.
    identity: Mapping[str, str | int | float]
    transition_gradients_enabled: bool = False  #: Whether `step` passes gradients through observation and state.

    @property
    def single(self) -> "AircraftEnvironment":
        """The environment itself."""
        return self

    def with_transition_gradients(self) -> "AircraftEnvironment":
        """Return a copy whose `step` has gradients of observation, state and reward, instead of the reward alone."""
        return dataclasses.replace(self, transition_gradients_enabled=True)

    def each(self, function: Callable[..., Any], state: EpisodeState, params: Parameters, *arguments: Any) -> Any:
        """Call `function(case, vehicle, *arguments)` once, with case and state of the aircraft; return the result."""
        return function(params.case(state.row), state.vehicle, *arguments)

    def instant(self, case: Case, number: Integer, key: UInt32[Array, "2"], params: Parameters) -> Instant:
        """Return the instant of integration step `number`, with the air of `case` and random numbers from `key`."""
        return Instant(case.environment, number, params.step, SeededRandomness(key))

    def flown_vehicle(self, case: Case, command: Any) -> Vehicle:
        """Return a case's aircraft with the action level's controller, and guidance that always gives `command`."""
        parts = ConstantCommand(command), self.level.controller(case.autopilot)
        return eqx.tree_at(lambda v: (v.guidance, v.controller), case.vehicle, parts)

    def fly_decision(
        self, state: EpisodeState, params: Parameters, case: Case, start: VehicleState, action: Float[Array, " action"]
    ) -> VehicleState:
        """Return the aircraft's state one decision after `start` in the episode `state`. Clips `action` to -1..1."""
        first = state.time * self.decision_steps
        instant = self.instant(case, first, state.key, params)
        belief = perceive(self.flown_vehicle(case, None), start, instant).belief
        action = jnp.clip(jnp.asarray(action, params.step.dtype), -1.0, 1.0)
        vehicle = self.flown_vehicle(case, self.level.command(action, case.autopilot, belief))

        def advance(k: Integer, vehicle_state: VehicleState) -> VehicleState:
            instant = self.instant(case, first + k, state.key, params)
            perception = perceive(vehicle, vehicle_state, instant)
            return cast_like(guide_and_move(vehicle, vehicle_state, perception, instant)[0], vehicle_state)

        if self.decision_steps == 1:
            return advance(jnp.zeros((), jnp.int32), start)
        return jax.lax.fori_loop(0, self.decision_steps, advance, start)

    def situation_of(self, state: EpisodeState, params: Parameters, case: Case, vehicle: VehicleState) -> Situation:
        """Return true and estimated motion of one aircraft in the state `vehicle`, at the time of `state`."""
        instant = self.instant(case, state.time * self.decision_steps, state.key, params)
        perception = perceive(self.flown_vehicle(case, None), vehicle, instant)
        truth, belief = perception.truth, perception.belief
        variables = estimates = believed_variables(belief)
        # whether the belief is the truth itself is known while a program is traced
        pairs = (belief.state, truth.state), (belief.condition, truth.condition)
        if not all(a is b for pair in pairs for a, b in zip(*map(jax.tree.leaves, pair), strict=True)):
            force_b, mass = truth.condition.wrench.force_b, truth.airframe.mass_properties.mass
            exact = Belief(truth.airframe, truth.state, truth.condition, force_b / mass, sight=None, goal=None)
            variables = believed_variables(exact)
        return Situation(case, instant, truth, belief, variables, estimates)

    def judge(self, situation: Situation) -> tuple[Float[Array, " error"], Scalar, Flag]:
        """Return errors divided by the tolerances, reward (0..1), and whether the episode ends by failure.

        Failures:

        - altitude 0 m or less
        - angle of attack more than 10 deg outside the aircraft's range
        - infinite or NaN motion
        - in tasks with a plan: the aircraft must turn away now to keep its least distance from the goal
        - a position or time outside a wind field that has no values beyond its boundary
        - failures of the task (`AbstractTask.has_failed`)
        """
        task, truth, v, instant = self.task, situation.truth, situation.variables, situation.instant
        low, high = (edge * RAD_DEG for edge in truth.airframe.alpha_range)
        is_outside = (v["alpha_deg"] < low - _ALPHA_MARGIN_DEG) | (v["alpha_deg"] > high + _ALPHA_MARGIN_DEG)
        is_finite = jnp.all(jnp.isfinite(jnp.stack([v[entry.name] for entry in MOTION])))
        failure = (v["altitude_m"] <= 0.0) | is_outside | ~is_finite
        has_left = has_left_field(instant.environment.wind, truth.state.position_n, instant.time)
        failure = failure | has_left | task.has_failed(situation)
        if isinstance(situation.case.task, PlannedMission):
            failure = failure | comes_too_near(situation)
        errors = task.errors(situation)
        return errors, task.reward(situation, errors), failure

    def observation_of(self, situation: Situation) -> Float[Array, " entry"]:
        """Return the observation in the order of `observed`, about -1..1 in ordinary flight."""
        motion = self.observed[: len(self.observed) - len(self.task.entries())]
        values = [*(situation.estimates[entry.name] for entry in motion), *self.task.observation(situation)]
        normalized = [entry.normalize(value) for entry, value in zip(self.observed, values, strict=True)]
        return jnp.stack(normalized).astype(jnp.float32)
