"""What a plan is recorded as: its paths at instants, what is least and greatest of them, what was asked of it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from anser.scenario import Scenario


@dataclass(frozen=True)
class ClosestApproach:
    """The two aircraft of a fleet that are nearest to each other, at every instant and at all.

    Attributes
    ----------
    distance_m
        Least distance at each instant (time,), NaN where fewer than two are under way.
    pair
        Which two, indices (time, 2); -1 there.
    least_m, least_pair, at_s
        The least of all, which two, and when; NaN and -1 for a single aircraft.
    level_m, height_m
        How far apart the two are then in the plane and in altitude.
    """

    distance_m: np.ndarray
    pair: np.ndarray
    least_m: float
    least_pair: tuple[int, int]
    at_s: float
    level_m: float
    height_m: float


@dataclass(frozen=True)
class PlanExtremes:
    """Least and greatest of each path, from instants that lie close; leading axis aircraft, SI units and radians.

    Attributes
    ----------
    length, speed_mean
        Of the path through the air, m, and along it, m/s.
    values
        By key as in `anser.planning.LIMITS`: "airspeed_min", "bank_max", ...
    """

    length: np.ndarray
    speed_mean: np.ndarray
    values: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class PlanSamples:
    """Paths of a fleet at instants; NaN where an aircraft has arrived.

    Attributes
    ----------
    time_s
        Instants (time,), increasing: even ones and every arrival.
    even
        Which of them are even ones.
    arrival_times_s
        When each aircraft arrives, one of the instants.
    history
        Arrays (time, aircraft), SI units and radians, by key of `anser.variables`.
    goals_n
        Where the goal of each aircraft is, (time, aircraft, NED axis), m.
    extremes
        Of each path.
    nearest
        By distance in space.
    separated
        By the separation that is asked for; None where none is.
    keep_out_room_m, keep_out_at_s
        How far each aircraft stays out of each keep-out at least, (aircraft, volume), negative inside, and when.
    """

    time_s: np.ndarray
    even: np.ndarray
    arrival_times_s: np.ndarray
    history: Mapping[str, np.ndarray]
    goals_n: np.ndarray
    extremes: PlanExtremes
    nearest: ClosestApproach
    separated: ClosestApproach | None
    keep_out_room_m: np.ndarray
    keep_out_at_s: np.ndarray


@dataclass(frozen=True)
class PlanDetails:
    """What was asked of a plan, and what its planner says of it; rows have one entry per aircraft.

    Attributes
    ----------
    scenario
        What asked for it.
    paths
        How each path goes, in a word or two.
    messages
        What is wrong with each path, None where nothing is.
    limits
        Limits of the scenario by key as in `anser.planning.LIMITS`, SI units and radians; one for all or one for each.
    bounds
        What the planner proves each path to keep within, by the names of `limits`; None: nothing is proven.
    separation_bound
        Proven least ratio of distance to the separation that was planned with, its reserve included; None: nothing is.
    keep_out_bounds_m
        Proven least room (aircraft, volume).
    lengths_m, nominal_lengths_m, turn_use
        Lengths of the paths through the air, in space, and without their bends, and turn rate as a part of that of the
        greatest bank angle, where a planner tells them.
    hold_radii_m, hold_turns, hold_heights_m
        Circles of the holds, their sense (positive: right) and their height over the goals, where a planner chooses
        them.
    hold_separation_bound
        Proven least ratio of distance to separation from the first arrival of two to the end of the flight.
    level_off_m
        Where the hold ends the descent with which each path arrives, altitude, where a planner tells it.
    problems
        Why the plan cannot be flown as it stands, one sentence each.
    notes
        Where it differs from the scenario's words, one sentence each.
    """

    scenario: Scenario
    paths: tuple[str, ...]
    messages: tuple[str | None, ...]
    limits: Mapping[str, float | np.ndarray]
    bounds: Mapping[str, np.ndarray] | None = None
    separation_bound: float | None = None
    keep_out_bounds_m: np.ndarray | None = None
    lengths_m: np.ndarray | None = None
    nominal_lengths_m: np.ndarray | None = None
    turn_use: np.ndarray | None = None
    level_off_m: np.ndarray | None = None
    hold_radii_m: np.ndarray | None = None
    hold_turns: np.ndarray | None = None
    hold_heights_m: np.ndarray | None = None
    hold_separation_bound: float | None = None
    problems: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
