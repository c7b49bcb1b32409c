"""Dataset of a plan: samples of the paths, their extremes, closest approaches, and the planner's limits and bounds."""

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.planning.limits import LIMITS, Limit
from anser.results.documents import version_attributes
from anser.results.variable_labels import catalogue_attributes, record_coordinates, to_dataset_units, unit_attributes
from anser.scenario.schema import Scenario
from anser.variables import CATALOGUE, PLAN_VARIABLES


@dataclass(frozen=True)
class ClosestApproach:
    """Closest pair of aircraft in a plan, at each sample time and over the whole plan."""

    # least distance at each time, shape (time,); NaN if fewer than two aircraft are under way. For the approach by
    # separation, vertical distances are multiplied by the ratio of required horizontal to vertical separation
    distance_m: np.ndarray
    pair: np.ndarray  # indices of the two aircraft, shape (time, 2); -1 if there is no pair
    minimum_m: float  # least distance over the plan, m; NaN for a single aircraft
    minimum_pair: tuple[int, int]  # pair with the least distance; -1 for a single aircraft
    minimum_time_s: float  # time of the least distance
    horizontal_m: float  # horizontal distance of `minimum_pair` at `minimum_time_s`
    vertical_m: float  # vertical distance of `minimum_pair` at `minimum_time_s`


@dataclass(frozen=True)
class PlanExtremes:
    """Length, mean airspeed and extremes of each path over closely spaced times; arrays of shape (aircraft,).

    Extremes between the times are not proven.
    """

    length: np.ndarray  # length through the air, m
    speed_mean: np.ndarray  # mean airspeed, m/s
    # extremes in SI units and radians, by key of `anser.planning.limits.LIMITS`: "airspeed_min", "bank_max", ...
    values: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class PlanSamples:
    """Samples of a fleet's planned paths over time; values of an aircraft after its arrival are NaN."""

    time_s: np.ndarray  # sample times, shape (time,): regular times and the arrival times
    is_regular: np.ndarray  # mask of the regular times
    arrival_times_s: np.ndarray
    history: Mapping[str, np.ndarray]  # arrays (time, aircraft) by key of `anser.variables`, SI units and radians
    goal_positions_n: np.ndarray  # positions in NED axes, m; shape (time, aircraft, axis)
    extremes: PlanExtremes
    find_closest_by_distance: Callable[[], ClosestApproach]  # function that computes `closest_by_distance`
    closest_by_separation: ClosestApproach | None  # None if no separation is required
    keep_out_margin_m: np.ndarray  # least distance outside, negative inside; shape (aircraft, keep-out)
    keep_out_margin_time_s: np.ndarray  # time of the least distance

    @functools.cached_property
    def closest_by_distance(self) -> ClosestApproach:
        """Closest approaches by distance in space, computed on the first use."""
        return self.find_closest_by_distance()


@dataclass(frozen=True)
class PlanDetails:
    """Scenario of a plan, and the planner's data on the paths; arrays and tuples have an entry per aircraft."""

    scenario: Scenario  # scenario that was planned
    paths: tuple[str, ...]  # short description of each path
    messages: tuple[str | None, ...]  # problem of each path; None without a problem
    # limits of the scenario by key of `anser.planning.limits.LIMITS`, SI units and radians; common or by aircraft
    limits: Mapping[str, float | np.ndarray]
    # proven bounds of the paths, by the keys of `limits`; None without a proof
    bounds: Mapping[str, np.ndarray] | None = None
    # proven least ratio of distance to the planned separation (required one plus margins); None without a proof
    separation_bound: float | None = None
    # proven least distance outside each keep-out (aircraft, keep-out), m; None without a proof
    keep_out_bounds_m: np.ndarray | None = None
    lengths_m: np.ndarray | None = None  # lengths of the paths through the air, m; None if not reported
    nominal_lengths_m: np.ndarray | None = None  # lengths of the paths without bends, m; None if not reported
    # greatest ratio of the turn rate to the turn rate at the bank limit; None if not reported
    turn_utilization: np.ndarray | None = None
    # least altitude when the aircraft levels off after the arrival, m; None if not reported
    level_off_m: np.ndarray | None = None
    hold_radii_m: np.ndarray | None = None  # radii of the holds, m; None if not planned
    hold_turns: np.ndarray | None = None  # turn directions of the holds, positive to the right; None if not planned
    hold_heights_m: np.ndarray | None = None  # heights of the holds above the goals, m; None if not planned
    # proven least ratio of distance to separation, from the first arrival of a pair to the end of the flight
    hold_separation_bound: float | None = None
    problems: tuple[str, ...] = ()  # reasons why the plan cannot be flown, one sentence each; not per aircraft
    notes: tuple[str, ...] = ()  # differences of the plan from the scenario, one sentence each; not per aircraft


_VARIABLES = {variable.key: variable for variable in (*CATALOGUE, *PLAN_VARIABLES)}
_GOAL_KEYS = ("goal_north", "goal_east", "goal_altitude")


def plan_dataset(samples: PlanSamples, details: PlanDetails) -> xr.Dataset:
    """Arrange a plan, its sampled paths and the planner's data on them, as a dataset in the units of `anser.variables`.

    Returns
    -------
    xr.Dataset
        Missing values are NaN; variables that the planner does not report are left out. By dimensions:

        - (time, aircraft): history under the names of `anser.variables`, goal positions
        - (time,): least distance between two aircraft and, if required, least separation, with the closest pair
        - (aircraft,): arrival, length, mean airspeed, hold; for each limit its value and the path's extreme and bound
        - (keep_out,): position, velocity, radius and altitudes of the cylinders
        - (aircraft, keep_out): least distance outside

    Raises
    ------
    ValueError
        If samples and details do not match, or `anser.variables` lacks a key of the history.
    """
    _check(samples, details)
    fleet = details.scenario.aircraft
    data: dict[str, Any] = {"even": ("time", samples.is_regular, unit_attributes("", "Whether the instant is regular"))}

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
    coordinates = record_coordinates(samples.time_s, [item.name for item in fleet])
    if details.scenario.keep_out:
        names = np.array([item.name for item in details.scenario.keep_out], dtype=np.str_)
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
        raise ValueError("separation must be sampled if, and only if, it is required")


def _add_closest(data: dict[str, Any], name: str, closest: ClosestApproach) -> None:
    """Add the variables of the closest pair to `data`, at each time and over the plan; `name` is the prefix."""
    for key, dims, value, unit, long_name in (
        (f"{name}_pair", ("time", "end"), closest.pair, "1", "Indices of the two aircraft; -1: none"),
        (f"least_{name}_pair", "end", closest.minimum_pair, "1", "Indices of the closest pair; -1: none"),
        (f"least_{name}_m", (), closest.minimum_m, "m", f"Least {name} between two aircraft in the plan"),
        (f"least_{name}_at_s", (), closest.minimum_time_s, "s", f"Time of the least {name}"),
        (f"least_{name}_level_m", (), closest.horizontal_m, "m", "Horizontal distance at that time"),
        (f"least_{name}_height_m", (), closest.vertical_m, "m", "Vertical distance at that time"),
    ):
        data[key] = (dims, np.asarray(value, np.int32 if unit == "1" else float), unit_attributes(unit, long_name))


def _add_paths(data: dict[str, Any], samples: PlanSamples, details: PlanDetails) -> None:
    """Add the variables that describe whole paths to `data`, with the dimension `aircraft`."""
    fleet = details.scenario.aircraft
    arrival, extremes = _VARIABLES["arrival_time"], samples.extremes
    data[arrival.name] = ("aircraft", np.asarray(samples.arrival_times_s, dtype=float), catalogue_attributes(arrival))
    length = extremes.length if details.lengths_m is None else details.lengths_m
    for name, values, unit, long_name in (
        ("length_m", length, "m", "Length of the path through the air, in space"),
        ("airspeed_mean_m_s", extremes.speed_mean, "m s-1", "Mean true airspeed"),
        ("nominal_length_m", details.nominal_lengths_m, "m", "Length of the path without its bend"),
        ("turn_use", details.turn_utilization, "1", "Turn rate over that of the greatest bank angle"),
        ("hold_radius_m", details.hold_radii_m, "m", "Radius of the hold"),
        ("hold_turn", details.hold_turns, "1", "Turn direction of the hold, 1: right, -1: left"),
        ("hold_height_m", details.hold_heights_m, "m", "Height of the hold over the goal"),
    ):
        if values is not None:
            data[name] = ("aircraft", values, unit_attributes(unit, long_name))
    labels_by_prefix = {"": "planned", "limit_": "limit", "bound_": "proven bound"}
    for limit, columns in limit_columns(samples, details):
        for prefix, column in columns.items():
            labels = unit_attributes(limit.unit, f"{limit.description.capitalize()}, {labels_by_prefix[prefix]}")
            data[f"{prefix}{limit.name}"] = ("aircraft", column, labels)
    for name, values, long_name in (
        ("goal", [item.goal for item in fleet], "Goal"),
        ("path", details.paths, "Description of the path"),
        (
            "message",
            ["" if item is None else item for item in details.messages],
            "Problem of the path; empty: none",
        ),
    ):
        data[name] = ("aircraft", np.array(values, dtype=np.str_), {"long_name": long_name})


def limit_columns(samples: PlanSamples, details: PlanDetails) -> Iterator[tuple[Limit, dict[str, np.ndarray]]]:
    """Yield each limit of `LIMITS` with a table of arrays (aircraft,) in dataset units.

    The keys of the table are prefixes of variable names: "" for the planned extreme, "limit_" for the limit (NaN: no
    limit) and, if the planner proves the limit, "bound_" for the proven extreme.
    """
    planned = {
        **samples.extremes.values,
        "level_off_min": np.nan if details.level_off_m is None else details.level_off_m,
    }
    for limit in LIMITS:
        columns = {"": planned[limit.key], "limit_": details.limits.get(limit.key, np.nan)}
        if details.bounds is not None and limit.key in details.bounds:
            columns["bound_"] = details.bounds[limit.key]
        count = len(details.scenario.aircraft)
        yield (
            limit,
            {
                prefix: np.broadcast_to(np.asarray(values, dtype=float) * limit.factor, count).copy()
                for prefix, values in columns.items()
            },
        )


def _add_keep_outs(data: dict[str, Any], samples: PlanSamples, details: PlanDetails) -> None:
    volumes = details.scenario.keep_out
    if not volumes:
        return
    volume_axis, pair_axes = "keep_out", ("aircraft", "keep_out")
    velocities = np.array([volume.velocity_m_s()[:2] for volume in volumes], dtype=float)
    for name, dims, unit, long_name, values in (
        ("keep_out_north_m", volume_axis, "m", "North position of the middle at time 0", [v.north_m for v in volumes]),
        ("keep_out_east_m", volume_axis, "m", "East position of the middle at time 0", [v.east_m for v in volumes]),
        ("keep_out_velocity_north_m_s", volume_axis, "m s-1", "North velocity", velocities[:, 0]),
        ("keep_out_velocity_east_m_s", volume_axis, "m s-1", "East velocity", velocities[:, 1]),
        ("keep_out_radius_m", volume_axis, "m", "Radius", [v.radius_m for v in volumes]),
        ("keep_out_bottom_m", volume_axis, "m", "Altitude of the bottom", [v.bottom_m for v in volumes]),
        ("keep_out_top_m", volume_axis, "m", "Altitude of the top", [v.top_m for v in volumes]),
        ("keep_out_room_m", pair_axes, "m", "Least distance outside", samples.keep_out_margin_m),
        ("keep_out_at_s", pair_axes, "s", "Time of the least distance", samples.keep_out_margin_time_s),
        ("bound_keep_out_room_m", pair_axes, "m", "Least distance outside, proven bound", details.keep_out_bounds_m),
    ):
        if values is not None:
            data[name] = (dims, np.array(values, dtype=float), unit_attributes(unit, long_name))


def _attributes(details: PlanDetails) -> dict[str, Any]:
    scenario = details.scenario
    attributes: dict[str, Any] = {
        "title": scenario.name,
        "scenario_hash": scenario.hash,
        "seed": scenario.seed,
        "planner": scenario.fleet.planner,
        "rule": scenario.arrival.rule,
        "problems": "\n".join(details.problems),
        "notes": "\n".join(details.notes),
    }
    if scenario.separation.required_m is not None:
        attributes["separation_horizontal_m"], attributes["separation_vertical_m"] = scenario.separation.required_m
    optional = {
        "distance_limit_m": scenario.requirements.separation_min_m,
        "separation_bound": details.separation_bound,
        "hold_separation_bound": details.hold_separation_bound,
    }
    return attributes | {name: value for name, value in optional.items() if value is not None} | version_attributes()
