"""Recorders: what is kept of a flight, and how often."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from anser.aircraft import Controls
from anser.control import GroundClearance
from anser.environment import AirFlow
from anser.numerics import zeros_as
from anser.planning import AircraftPlan
from anser.sensing import Belief, GoalState, Instant, Truth
from anser.shapes import Count, Vector3
from anser.simulation.members import in_fleet_order
from anser.simulation.record import record
from anser.variables import all_surfaces, surface_variables


class GoalApproach(eqx.Module):
    """Where one aircraft is on its way to its goal at one instant.

    Attributes
    ----------
    goal
        The truth.
    rendezvous_n
        Where it is to be, NED, m.
    to_goal_n, to_rendezvous_n
        Straight lines through space from the aircraft, m.
    clearance
        Between it and the ground.
    plan
        Its own.
    phase
        One of `APPROACH`, `FROZEN`, `HOLD`.
    """

    goal: GoalState
    rendezvous_n: Vector3
    to_goal_n: Vector3
    to_rendezvous_n: Vector3
    clearance: GroundClearance
    plan: AircraftPlan
    phase: Count


class AircraftSample(eqx.Module):
    """All signals of one aircraft at one sampling instant.

    Attributes
    ----------
    truth, belief
        True and estimated state.
    controls, signals
        Outputs and signals of its controller.
    command, reference_n
        What it was commanded, and where it is to be (NED, m).
    approach
        None for an aircraft without a mission.
    status
        Index into `STATUS_MESSAGES`.
    """

    truth: Truth
    belief: Belief
    controls: Controls
    signals: Any
    command: Any
    reference_n: Vector3 | None
    approach: GoalApproach | None
    status: Count
    flow: AirFlow | None = None


class FleetSample(eqx.Module):
    """Samples of a fleet by kinds of aircraft, with a leading axis over members; and their places in the fleet."""

    kinds: tuple[AircraftSample, ...]
    members: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    def rows(self, of_one: Callable[[AircraftSample], dict[str, Array]]) -> dict[str, Array]:
        """What a function gives of each aircraft, in the fleet's order.

        Of several kinds of aircraft it is what all of them give, and the control surfaces of any: NaN of an aircraft
        that has no such surface.
        """
        found = [jax.vmap(of_one)(samples) for samples in self.kinds]
        surfaces = all_surfaces(samples.truth.airframe.actuators.names for samples in self.kinds)
        of_some = {variable.key for variable in surface_variables(surfaces)}
        keys = dict.fromkeys(key for one in found for key in one)
        kept = [key for key in keys if key in of_some or all(key in one for one in found)]
        like = {key: one[key] for one in found for key in one}
        rows = [
            {key: one[key] if key in one else jnp.full(len(places), jnp.nan, like[key].dtype) for key in kept}
            for one, places in zip(found, self.members, strict=True)
        ]
        return in_fleet_order(rows, self.members)


class AbstractRecorder(eqx.Module):
    """What is kept of a flight; concrete ones are final.

    What it sees is the `AircraftSample` of one aircraft flown alone, or the `FleetSample` of a fleet.

    Attributes
    ----------
    every
        Number of samples between two rows.
    """

    every: eqx.AbstractVar[int]

    @abc.abstractmethod
    def init(self, aircraft: int) -> Any:
        """Memory before the first sample, of so many aircraft."""

    @abc.abstractmethod
    def take(self, memory: Any, sample: Any, instant: Instant) -> Any:
        """Memory with one more sample."""

    @abc.abstractmethod
    def row(self, sample: Any, instant: Instant) -> Any:
        """What is kept of one sample, as arrays; None: nothing."""


class History(AbstractRecorder):
    """Variables of a fleet over time.

    Attributes
    ----------
    every
        Number of samples between two rows.
    keys
        Of `anser.variables.catalogue`; None: all that are recorded.
    """

    every: int = eqx.field(static=True, default=1)
    keys: tuple[str, ...] | None = eqx.field(static=True, default=None)

    def init(self, aircraft: int) -> None:
        """Nothing is kept."""

    def take(self, memory: None, sample: Any, instant: Instant) -> None:
        """Nothing is kept."""

    def row(self, sample: FleetSample, instant: Instant) -> dict[str, Array]:
        """Each variable of each aircraft, SI units and radians.

        Raises
        ------
        ValueError
            No such variable is recorded.
        """
        found = sample.rows(record)
        if self.keys is None:
            return found
        unknown = [key for key in self.keys if key not in found]
        if unknown:
            raise ValueError(f"not recorded: {', '.join(unknown)}; what is: {', '.join(found)}")
        return {key: found[key] for key in self.keys}


def scanned(
    one: Callable[[Any, Count], tuple[Any, Any, Instant]],
    state: Any,
    since: Count,
    count: int,
    recorder: AbstractRecorder,
    memory: Any,
    flown: Count | None = None,
) -> tuple[Any, Any, Any]:
    """Run steps and keep what the recorder wants.

    Parameters
    ----------
    one
        One step: from state and number of the sample to the state after it, what is known at it, and the instant.
    state
        Before the first step.
    since
        Number of the first sample, not batched.
    count
        Number of steps; a multiple of what lies between two rows.
    recorder, memory
        What is kept, and what has been so far.
    flown
        How many of the steps are run, where that is known only when it runs and each has a row; None: all.

    Returns
    -------
    State after the last step, the recorder's memory, and its rows, stacked: of samples `since`, `since + every`, ...

    Raises
    ------
    ValueError
        Rows do not fill the steps.
    """
    every = recorder.every
    if every < 1 or count % every:
        raise ValueError(f"a row every {every} samples does not fit a flight of {count} samples")

    def step(carry: tuple[Any, Any], number: Count) -> tuple[tuple[Any, Any], Any]:
        state, memory = carry
        after, sample, instant = one(state, number)
        return (after, recorder.take(memory, sample, instant)), recorder.row(sample, instant)

    if flown is not None:
        if every != 1:
            raise ValueError(f"a row every {every} samples does not fit a number of steps that is not known")
        empty = zeros_as(lambda c, n: step(c, n)[1], (state, memory), since)

        def some(carry: tuple[Any, Any], k: Count) -> tuple[tuple[Any, Any], Any]:
            return jax.lax.cond(k < flown, lambda: step(carry, since + k), lambda: (carry, empty))

        (state, memory), rows = jax.lax.scan(some, (state, memory), jnp.arange(count, dtype=since.dtype))
        return state, memory, rows

    if every == 1:
        (state, memory), rows = jax.lax.scan(step, (state, memory), since + jnp.arange(count, dtype=since.dtype))
        return state, memory, rows

    def sparse(carry: tuple[Any, Any, Any], k: Count) -> tuple[tuple[Any, Any, Any], None]:
        state, memory, number = carry[0], carry[1], carry[2][0]
        after, sample, instant = one(state, number)
        row = jax.lax.cond(k == 0, lambda: recorder.row(sample, instant), lambda: carry[2][1])
        return (after, recorder.take(memory, sample, instant), (number + 1, row)), None

    empty = zeros_as(lambda c, n: step(c, n)[1], (state, memory), since)

    def block(carry: tuple[Any, Any, Count], _: None) -> tuple[tuple[Any, Any, Count], Any]:
        state, memory, number = carry
        begun = (state, memory, (number, empty))
        (state, memory, (number, row)), _ = jax.lax.scan(sparse, begun, jnp.arange(every))
        return (state, memory, number), row

    (state, memory, _), rows = jax.lax.scan(block, (state, memory, since), length=count // every)
    return state, memory, rows
