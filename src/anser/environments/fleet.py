"""Environment of a fleet: aircraft that meet their goals at one time and keep their separation."""

import dataclasses
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environments.cases import Case, Situation
from anser.environments.environment import (
    AircraftEnvironment,
    EpisodeState,
    Parameters,
    draw_case,
    end_decision,
    has_failed,
    reset_if,
)
from anser.environments.planned_tasks import axes_entries, in_course_axes
from anser.environments.spaces import Box, Entry
from anser.numerics.arrays import Stacked
from anser.parts.perception import velocity_over_ground_n
from anser.shapes import Flag, Scalar
from anser.spatial.vectors import norm


@dataclasses.dataclass(frozen=True, eq=False)
class FleetEnvironment:
    """Environment of several aircraft of one type, which cooperate: the contract of `AircraftEnvironment` with an axis.

    Observations, actions and rewards have a leading axis over the aircraft; the episode ends for all aircraft at once.
    Each aircraft observes its own task and the relative motion of the others. The reward of each aircraft is the mean
    over the fleet. Success means that all aircraft succeed and that no two aircraft came nearer than the separation,
    which ends the episode.

    Attributes
    ----------
    member
        Environment of each aircraft; its parameters have cases with axes over cases and aircraft.
    agents
        Names of the aircraft.
    separation_m
        Least distance between two aircraft, m.
    """

    member: AircraftEnvironment
    agents: tuple[str, ...]
    separation_m: float

    supports_transition_gradients: ClassVar[bool] = True

    def __deepcopy__(self, memo: Any) -> "FleetEnvironment":
        return self  # nothing of it can change

    @property
    def name(self) -> str:
        """Name of the environment."""
        return self.member.name

    @property
    def default_params(self) -> Parameters:
        """Return the parameters with which the environment was made."""
        return self.member.parameters

    @property
    def num_actions(self) -> int:
        """Number of entries of the action of an aircraft."""
        return self.member.num_actions

    @property
    def commanded(self) -> tuple[Entry, ...]:
        """Table of the entries of an action."""
        return self.member.commanded

    @property
    def observed(self) -> tuple[Entry, ...]:
        """Table of the entries of the observation of an aircraft."""
        others = [
            entry
            for number in range(1, len(self.agents))
            for entry in (
                *axes_entries(f"other_{number}", "m", "m", 5000.0, "Position of another aircraft relative to this one"),
                *axes_entries(f"other_{number}_velocity", "m s-1", "m_s", 200.0, "Velocity of that aircraft less own"),
            )
        ]
        return (*self.member.observed, *others)

    def with_transition_gradients(self) -> "FleetEnvironment":
        """Return the environment whose observations and states carry gradients."""
        return dataclasses.replace(self, member=self.member.with_transition_gradients())

    def observation_space(self, params: Parameters | None = None) -> Box:
        """Return the space of the observations of one aircraft."""
        return Box(-np.inf, np.inf, (len(self.observed),))

    def action_space(self, params: Parameters | None = None) -> Box:
        """Return the space of the actions of one aircraft, -1..1."""
        return Box(-1.0, 1.0, (self.num_actions,))

    def reset(
        self, key: Array, params: Parameters | None = None
    ) -> tuple[Float[Array, "aircraft entry"], EpisodeState]:
        """Draw a case and return observations and state at its start."""
        params = self.default_params if params is None else params
        state = self._initial_state(key, params)
        return self.observe(key, state, None, params), state

    def observe(
        self, key: Array, state: EpisodeState, action: Any = None, params: Parameters | None = None
    ) -> Float[Array, "aircraft entry"]:
        """Return the observations of a state; key and action have no effect."""
        return self._observations(self.situations(state, params))

    def situations(self, state: EpisodeState, params: Parameters | None = None) -> Situation:
        """Return truth, belief and recorded variables of each aircraft in a state; leading axis aircraft."""
        params = self.default_params if params is None else params

        def situation(case: Case, vehicle: Any) -> Situation:
            return self.member.situation_of(case, dataclasses.replace(state, vehicle=vehicle), params)

        return self.cases(state, params).map(situation, state.vehicle)

    def step(
        self, key: Array, state: EpisodeState, action: Float[Array, "aircraft action"], params: Parameters | None = None
    ) -> tuple[Float[Array, "aircraft entry"], EpisodeState, Float[Array, " aircraft"], Flag, Flag, dict[str, Array]]:
        """Fly one decision of all aircraft; an episode that ends is reset within the step.

        See `AircraftEnvironment.step`; `terminated` and `truncated` hold for the whole fleet.
        """
        params = self.default_params if params is None else params
        observation, flown, reward, terminated, info = self.step_env(key, state, action, params)
        done = terminated | info["truncated"]
        start = self._initial_state(key, params)
        next_state, next_observation = reset_if(
            done, (start, self.observe(key, start, None, params)), (flown, observation)
        )
        return next_observation, next_state, reward, terminated, info["truncated"], info

    def step_env(
        self, key: Array, state: EpisodeState, action: Float[Array, "aircraft action"], params: Parameters
    ) -> tuple[Float[Array, "aircraft entry"], EpisodeState, Float[Array, " aircraft"], Flag, dict[str, Array]]:
        """Fly one decision of all aircraft without a reset at the end of an episode; otherwise as `step`."""
        cases = self.cases(state, params)

        def fly(case: Case, vehicle: Any, own_action: Array) -> Any:
            return self.member.fly_decision(case, dataclasses.replace(state, vehicle=vehicle), own_action, params)

        vehicles = cases.map(fly, state.vehicle, action)
        flown = dataclasses.replace(state, time=state.time + 1, vehicle=vehicles)
        situations = self.situations(flown, params)
        task = self.member.task

        def judge(situation: Situation) -> tuple[Array, Scalar, Flag]:
            errors = task.errors(situation)
            return errors, task.reward(situation, errors), has_failed(task, situation)

        errors, rewards, failures = jax.vmap(judge)(situations)
        is_near = self.separation(situations) < self.separation_m
        terminated = jnp.any(failures) | is_near
        decisions = self.cases(state, params).map(lambda case: case.decisions)[0]
        observation, flown, reward, info = end_decision(
            self.member, flown, errors, jnp.mean(rewards), terminated, decisions, self._observations(situations)
        )
        return observation, flown, jnp.full(len(self.agents), reward), terminated, info

    def separation(self, situations: Situation) -> Scalar:
        """Return the least distance between two aircraft, m."""
        positions_n = situations.truth.state.position_n
        first, second = np.triu_indices(len(self.agents), 1)
        return jnp.min(jax.vmap(norm)(positions_n[first] - positions_n[second]))

    def cases(self, state: EpisodeState, params: Parameters) -> Stacked[Case]:
        """Return the cases of the aircraft of an episode."""
        return Stacked(jax.tree.map(lambda leaf: leaf[state.row], params.cases.batched), params.cases.shared)

    def _initial_state(self, key: Array, params: Parameters) -> EpisodeState:
        row, episode_key = draw_case(key, params)
        zero = jnp.zeros((), jnp.int32)
        state = EpisodeState(zero, row, episode_key, None, zero)  # pyright: ignore[reportArgumentType]

        def start(case: Case, index: Array) -> Any:
            return self.member.start_aircraft(case, episode_key, params, index)

        indices = jnp.arange(len(self.agents), dtype=jnp.int32)
        return dataclasses.replace(state, vehicle=self.cases(state, params).map(start, indices))

    def _observations(self, situations: Situation) -> Float[Array, "aircraft entry"]:
        own = jax.vmap(self.member.observation_of)(situations)
        belief = situations.belief
        velocities_n = jax.vmap(velocity_over_ground_n)(belief.condition, belief.state)
        count = len(self.agents)
        entries = self.observed[len(self.member.observed) :]

        def others(index: Array, situation: Situation) -> Array:
            parts: list[Scalar] = []
            for number in range(1, count):
                other = (index + number) % count
                relative_n = belief.state.position_n[other] - belief.state.position_n[index]
                parts.extend(in_course_axes(situation, relative_n))
                parts.extend(in_course_axes(situation, velocities_n[other] - velocities_n[index]))
            return jnp.stack([entry.normalize(part) for entry, part in zip(entries, parts, strict=True)])

        relative = jax.vmap(others)(jnp.arange(count), situations)
        return jnp.concatenate([own, relative.astype(own.dtype)], axis=-1)
