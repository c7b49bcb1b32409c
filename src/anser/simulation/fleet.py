"""What flies together: the numbers of a whole flight, and its state between steps; all are arrays."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.environment import Environment
from anser.numerics import AbstractRandomness, Stacked, as_array, rows_of, stacked, structure_of
from anser.planning import AbstractPlanner
from anser.shapes import Count, Scalar, ScalarLike, Vector3
from anser.simulation.members import in_fleet_order, rows_at
from anser.simulation.trim import TrimTarget
from anser.simulation.vehicle import Vehicle, VehicleState


class Timing(eqx.Module):
    """Periods of a flight, s.

    Attributes
    ----------
    step
        Sampling period of the aircraft's parts and step of the integrator.
    replan_steps
        Number of steps between plans; 0 plans once, at the start.
    freeze
        The plan stands still for this long before the arrival.
    """

    step: Scalar
    replan_steps: Count
    freeze: Scalar


class Kind(eqx.Module):
    """Aircraft of one structure, which fly as one batch.

    Attributes
    ----------
    vehicles
        Their parts.
    starts
        Steady flight from which each starts; leading axis members.
    start_positions_n
        Where, m.
    flies
        Whether each is one of the fleet's aircraft; the others fill it up to a size and never fly.
    members
        Place of each in the fleet.
    """

    vehicles: Stacked[Vehicle]
    starts: TrimTarget
    start_positions_n: Float[Array, "members 3"]
    flies: Bool[Array, " members"]
    members: tuple[int, ...] = eqx.field(static=True)


class Flight(eqx.Module):
    """Everything that determines a flight.

    Attributes
    ----------
    environment
        Where.
    kinds
        The fleet, by kinds of aircraft; whatever has a leading axis aircraft goes by `Kind.members`.
    planner
        Of all.
    timing
        Periods.
    randomness
        Source of random numbers, of the seed and the flight; None: nothing may draw any.
    """

    environment: Environment
    kinds: tuple[Kind, ...]
    planner: AbstractPlanner
    timing: Timing
    randomness: AbstractRandomness | None = None

    @property
    def members(self) -> tuple[tuple[int, ...], ...]:
        """Places in the fleet of the members of each kind."""
        return tuple(kind.members for kind in self.kinds)

    @property
    def count(self) -> int:
        """Number of aircraft."""
        return sum(len(kind.members) for kind in self.kinds)

    @property
    def surfaces(self) -> tuple[tuple[str, ...], ...]:
        """Names of the control surfaces of each aircraft, in the fleet's order."""
        named = {place: kind.vehicles.own.airframe.actuators.names for kind in self.kinds for place in kind.members}
        return tuple(named[place] for place in range(self.count))

    def aircraft(self, place: int) -> tuple[Vehicle, TrimTarget, Vector3]:
        """The aircraft at a place in the fleet, the steady flight that it starts from, and where, m."""
        for kind in self.kinds:
            if place in kind.members:
                k = kind.members.index(place)
                start = jax.tree.map(lambda leaf, k=k: leaf[k], (kind.starts, kind.start_positions_n))
                return kind.vehicles.at(k), *start
        raise IndexError(f"a fleet of {self.count} aircraft has none at place {place}")


class FlightState(eqx.Module):
    """A flight between two steps.

    Attributes
    ----------
    vehicles
        By kind; leading axis members.
    planner
        What the planner carries along, the plan in force among it.
    """

    vehicles: tuple[VehicleState, ...]
    planner: Any


def assemble(
    environment: Environment,
    aircraft: Sequence[tuple[Vehicle, TrimTarget, Vector3]],
    planner: AbstractPlanner,
    step: ScalarLike,
    replan_steps: int,
    freeze: ScalarLike = 0.0,
    randomness: AbstractRandomness | None = None,
    flying: int | None = None,
) -> Flight:
    """Put a flight together; aircraft of one structure become one kind.

    Parameters
    ----------
    environment
        Where.
    aircraft
        Of each: its parts, the steady flight that it starts from, and where (NED, m).
    planner
        Of all.
    step
        Sampling period, s.
    replan_steps
        Number of steps between plans; 0 plans once.
    freeze
        How long the plan stands still before the arrival, s.
    randomness
        Source of random numbers.
    flying
        How many of the aircraft, from the first on, fly: the others fill the fleet up to a size for which a program is
        compiled already. None: all.

    Raises
    ------
    ValueError
        No aircraft, or one without a mission.
    """
    if not aircraft:
        raise ValueError("a flight needs at least one aircraft")
    without = [str(k) for k, (vehicle, _, _) in enumerate(aircraft) if vehicle.mission is None]
    if without:
        raise ValueError(f"aircraft without a goal cannot be planned for: place {', '.join(without)} of the fleet")
    kinds: dict[Any, list[int]] = {}
    for k, (vehicle, _, _) in enumerate(aircraft):
        kinds.setdefault(structure_of(vehicle), []).append(k)
    return Flight(
        environment=environment,
        kinds=tuple(
            _kind(aircraft, members, len(aircraft) if flying is None else flying) for members in kinds.values()
        ),
        planner=planner,
        timing=Timing(
            step=as_array(step),
            replan_steps=as_array(replan_steps, np.int32),
            freeze=as_array(freeze),
        ),
        randomness=randomness,
    )


def _kind(aircraft: Sequence[tuple[Vehicle, TrimTarget, Vector3]], members: Sequence[int], flying: int) -> Kind:
    vehicles, starts, places = zip(*(aircraft[k] for k in members), strict=True)
    return Kind(
        vehicles=stacked(vehicles, own=lambda vehicle: vehicle.mission),
        starts=rows_of(starts),
        start_positions_n=rows_of(places),
        flies=as_array([k < flying for k in members], bool),
        members=tuple(members),
    )


def fleet_rows(flight: Flight, of_kinds: Sequence[Any]) -> Any:
    """Stacked rows of each kind's members as those of the fleet, in its order."""
    return in_fleet_order(list(of_kinds), flight.members)


def of_members(rows: Any, kind: Kind, count: int) -> Any:
    """Rows of a kind's members, of those of a fleet of so many aircraft."""
    return rows_at(rows, kind.members, count)


def statuses(flight: Flight, state: FlightState) -> tuple[Array, Bool[Array, " aircraft"]]:
    """Status of each aircraft, and whether it stands still."""
    return fleet_rows(flight, [(one.status, one.stopped) for one in state.vehicles])
