"""A recorded plan: samples of its paths.

Extremes and closest approaches, what the planner reports, and the labelled dataset of them all.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.planning.limits import LIMITS
from anser.results.documents import version_attributes
from anser.results.variable_labels import catalogue_attributes, record_coordinates, to_dataset_units, unit_attributes
from anser.scenario.schema import Scenario
from anser.variables import CATALOGUE, PLAN_VARIABLES


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
    minimum_m: float
    minimum_pair: tuple[int, int]
    minimum_time_s: float
    horizontal_m: float
    vertical_m: float


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
    is_regular: np.ndarray
    arrival_times_s: np.ndarray
    history: Mapping[str, np.ndarray]
    goal_positions_n: np.ndarray
    extremes: PlanExtremes
    closest_by_distance: ClosestApproach
    closest_by_separation: ClosestApproach | None
    keep_out_margin_m: np.ndarray
    keep_out_margin_time_s: np.ndarray


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
    turn_utilization: np.ndarray | None = None
    level_off_m: np.ndarray | None = None
    hold_radii_m: np.ndarray | None = None
    hold_turns: np.ndarray | None = None
    hold_heights_m: np.ndarray | None = None
    hold_separation_bound: float | None = None
    problems: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


_VARIABLES = {variable.key: variable for variable in (*CATALOGUE, *PLAN_VARIABLES)}
_GOAL_KEYS = ("goal_north", "goal_east", "goal_altitude")


def plan_dataset(samples: PlanSamples, details: PlanDetails) -> xr.Dataset:
    """Label a plan.

    Parameters
    ----------
    samples
        Its paths.
    details
        What was asked of it, and what its planner says.

    Returns
    -------
    xr.Dataset
        Over (time, aircraft) every key of the samples' history under its name in the catalogue, and the goals; over
        (time,) the least distance and separation with their pairs; over (aircraft,) arrival, length, speeds, extremes,
        limits and proven bounds; over (aircraft, keep_out) the room. NaN where there is nothing to tell.

    Raises
    ------
    ValueError
        Samples and details do not tell of the same aircraft, or a key is not in the catalogue.
    """
    _check(samples, details)
    fleet = details.scenario.aircraft
    data: dict[str, Any] = {
        "even": ("time", samples.is_regular, unit_attributes("", "Whether the instant is an even one"))
    }

    def add(key: str, values: np.ndarray, dims: Any) -> None:
        variable = _VARIABLES[key]
        data[variable.name] = (dims, to_dataset_units(variable, np.asarray(values)), catalogue_attributes(variable))

    for key, values in samples.history.items():
        add(key, values, ("time", "aircraft"))
    for axis, key in enumerate(_GOAL_KEYS):
        add(key, samples.goal_positions_n[:, :, axis] * (-1.0 if key == "goal_altitude" else 1.0), ("time", "aircraft"))
    add("distance_min", samples.closest_by_distance.distance_m, "time")
    _add_closest(data, "distance", samples.closest_by_distance)
    if samples.closest_by_separation is not None:
        add("separation", samples.closest_by_separation.distance_m, "time")
        _add_closest(data, "separation", samples.closest_by_separation)
    _add_paths(data, samples, details)
    _add_keep_outs(data, samples, details)
    coordinates = record_coordinates(samples.time_s, [one.name for one in fleet])
    if details.scenario.keep_out:
        names = np.array([one.name for one in details.scenario.keep_out], dtype=np.str_)
        coordinates["keep_out"] = ("keep_out", names, {"long_name": "Keep-out"})
    return xr.Dataset(data, coordinates, _attributes(details))


def _check(samples: PlanSamples, details: PlanDetails) -> None:
    shape = (samples.time_s.size, len(details.scenario.aircraft))
    for key, values in samples.history.items():
        if key not in _VARIABLES:
            raise ValueError(f"the history has the key {key}, which anser.variables does not know")
        if values.shape != shape:
            raise ValueError(f"{key} has shape {values.shape}; (time, aircraft) is {shape}")
    for name in ("paths", "messages"):
        if len(getattr(details, name)) != shape[1]:
            raise ValueError(f"{name} has {len(getattr(details, name))} entries for {shape[1]} aircraft")
    if (samples.closest_by_separation is None) != (details.scenario.separation.required_m is None):
        raise ValueError("separation must be sampled where it is asked for, and only there")


def _add_closest(data: dict[str, Any], name: str, closest: ClosestApproach) -> None:
    """The pair at each instant, and the nearest of all."""
    pair = np.asarray(closest.pair, dtype=np.int32)
    data[f"{name}_pair"] = (("time", "end"), pair, unit_attributes("1", "Indices of the two aircraft; -1: none"))
    least = np.asarray(closest.minimum_pair, dtype=np.int32)
    data[f"least_{name}_pair"] = ("end", least, unit_attributes("1", "Indices of the two that come closest; -1: none"))
    for key, value, unit, words in (
        (f"least_{name}_m", closest.minimum_m, "m", f"Least {name} between two aircraft at all"),
        (f"least_{name}_at_s", closest.minimum_time_s, "s", "When"),
        (f"least_{name}_level_m", closest.horizontal_m, "m", "Their distance in the plane then"),
        (f"least_{name}_height_m", closest.vertical_m, "m", "Their difference in altitude then"),
    ):
        data[key] = ((), float(value), unit_attributes(unit, words))


def _add_paths(data: dict[str, Any], samples: PlanSamples, details: PlanDetails) -> None:
    """What holds for a path as a whole."""
    fleet = details.scenario.aircraft
    arrival = _VARIABLES["arrival_time"]
    data[arrival.name] = ("aircraft", np.asarray(samples.arrival_times_s, dtype=float), catalogue_attributes(arrival))
    extremes = samples.extremes
    length = extremes.length if details.lengths_m is None else details.lengths_m
    data["length_m"] = ("aircraft", length, unit_attributes("m", "Length of the path through the air, in space"))
    data["airspeed_mean_m_s"] = ("aircraft", extremes.speed_mean, unit_attributes("m s-1", "Mean true airspeed"))
    for name, values, unit, words in (
        ("nominal_length_m", details.nominal_lengths_m, "m", "Length of the path without its bend"),
        ("turn_use", details.turn_utilization, "1", "Turn rate over that of the greatest bank angle"),
        ("hold_radius_m", details.hold_radii_m, "m", "Radius of the hold"),
        ("hold_turn", details.hold_turns, "1", "Sense of the hold's turn, 1: right, -1: left"),
        ("hold_height_m", details.hold_heights_m, "m", "Height of the hold over the goal"),
    ):
        if values is not None:
            data[name] = ("aircraft", values, unit_attributes(unit, words))
    planned = {**extremes.values, "level_off_min": np.nan if details.level_off_m is None else details.level_off_m}
    for limit in LIMITS:
        found = {"": planned[limit.key], "limit_": details.limits.get(limit.key, np.nan)}
        if details.bounds is not None and limit.key in details.bounds:
            found["bound_"] = details.bounds[limit.key]
        said = {"": "planned", "limit_": "limit", "bound_": "proven bound"}
        for prefix, values in found.items():
            full = np.broadcast_to(np.asarray(values, dtype=float) * limit.factor, len(fleet)).copy()
            labels = unit_attributes(limit.unit, f"{limit.description.capitalize()}, {said[prefix]}")
            data[f"{prefix}{limit.name}"] = ("aircraft", full, labels)
    for name, values, words in (
        ("goal", [one.goal for one in fleet], "Goal"),
        ("path", details.paths, "How the path goes"),
        ("message", ["" if one is None else one for one in details.messages], "What is wrong with it; empty: nothing"),
    ):
        data[name] = ("aircraft", np.array(values, dtype=np.str_), {"long_name": words})


def _add_keep_outs(data: dict[str, Any], samples: PlanSamples, details: PlanDetails) -> None:
    volumes = details.scenario.keep_out
    if not volumes:
        return
    for name, unit, words, values in (
        ("north_m", "m", "North position of the middle at time 0", [one.north_m for one in volumes]),
        ("east_m", "m", "East position of the middle at time 0", [one.east_m for one in volumes]),
        ("velocity_north_m_s", "m s-1", "North velocity", [one.velocity_m_s()[0] for one in volumes]),
        ("velocity_east_m_s", "m s-1", "East velocity", [one.velocity_m_s()[1] for one in volumes]),
        ("radius_m", "m", "Radius", [one.radius_m for one in volumes]),
        ("bottom_m", "m", "Altitude of the bottom", [one.bottom_m for one in volumes]),
        ("top_m", "m", "Altitude of the top", [one.top_m for one in volumes]),
    ):
        data[f"keep_out_{name}"] = ("keep_out", np.array(values, dtype=float), unit_attributes(unit, words))
    both = ("aircraft", "keep_out")
    data["keep_out_room_m"] = (both, samples.keep_out_margin_m, unit_attributes("m", "Least distance outside"))
    data["keep_out_at_s"] = (both, samples.keep_out_margin_time_s, unit_attributes("s", "When it is least"))
    if details.keep_out_bounds_m is not None:
        data["bound_keep_out_room_m"] = (
            both,
            details.keep_out_bounds_m,
            unit_attributes("m", "Least distance outside, proven bound"),
        )


def _attributes(details: PlanDetails) -> dict[str, Any]:
    scenario = details.scenario
    found: dict[str, Any] = {
        "title": scenario.name,
        "scenario_hash": scenario.hash,
        "seed": scenario.seed,
        "planner": scenario.fleet.planner,
        "rule": scenario.arrival.rule,
        "problems": "\n".join(details.problems),
        "notes": "\n".join(details.notes),
    }
    if scenario.separation.required_m is not None:
        found["separation_horizontal_m"], found["separation_vertical_m"] = scenario.separation.required_m
    known = {
        "distance_limit_m": scenario.requirements.separation_min_m,
        "separation_bound": details.separation_bound,
        "hold_separation_bound": details.hold_separation_bound,
    }
    return found | {name: value for name, value in known.items() if value is not None} | version_attributes()
