"""From the samples of a plan to a labelled dataset in the units of the catalogue."""

from typing import Any

import numpy as np
import xarray as xr

from anser.planning import LIMITS
from anser.results.plan_record import ClosestApproach, PlanDetails, PlanSamples
from anser.results.provenance import version_attributes
from anser.results.variable_labels import attributes_of, converted, labels_of, record_coordinates
from anser.variables import CATALOGUE, PLAN_VARIABLES

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
    data: dict[str, Any] = {"even": ("time", samples.even, attributes_of("", "Whether the instant is an even one"))}

    def add(key: str, values: np.ndarray, dims: Any) -> None:
        variable = _VARIABLES[key]
        data[variable.name] = (dims, converted(variable, np.asarray(values)), labels_of(variable))

    for key, values in samples.history.items():
        add(key, values, ("time", "aircraft"))
    for axis, key in enumerate(_GOAL_KEYS):
        add(key, samples.goals_n[:, :, axis] * (-1.0 if key == "goal_altitude" else 1.0), ("time", "aircraft"))
    add("distance_min", samples.nearest.distance_m, "time")
    _add_closest(data, "distance", samples.nearest)
    if samples.separated is not None:
        add("separation", samples.separated.distance_m, "time")
        _add_closest(data, "separation", samples.separated)
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
    if (samples.separated is None) != (details.scenario.separation.asked_m is None):
        raise ValueError("separation must be sampled where it is asked for, and only there")


def _add_closest(data: dict[str, Any], name: str, closest: ClosestApproach) -> None:
    """The pair at each instant, and the nearest of all."""
    pair = np.asarray(closest.pair, dtype=np.int32)
    data[f"{name}_pair"] = (("time", "end"), pair, attributes_of("1", "Indices of the two aircraft; -1: none"))
    least = np.asarray(closest.least_pair, dtype=np.int32)
    data[f"least_{name}_pair"] = ("end", least, attributes_of("1", "Indices of the two that come closest; -1: none"))
    for key, value, unit, words in (
        (f"least_{name}_m", closest.least_m, "m", f"Least {name} between two aircraft at all"),
        (f"least_{name}_at_s", closest.at_s, "s", "When"),
        (f"least_{name}_level_m", closest.level_m, "m", "Their distance in the plane then"),
        (f"least_{name}_height_m", closest.height_m, "m", "Their difference in altitude then"),
    ):
        data[key] = ((), float(value), attributes_of(unit, words))


def _add_paths(data: dict[str, Any], samples: PlanSamples, details: PlanDetails) -> None:
    """What holds for a path as a whole."""
    fleet = details.scenario.aircraft
    arrival = _VARIABLES["arrival_time"]
    data[arrival.name] = ("aircraft", np.asarray(samples.arrival_times_s, dtype=float), labels_of(arrival))
    extremes = samples.extremes
    length = extremes.length if details.lengths_m is None else details.lengths_m
    data["length_m"] = ("aircraft", length, attributes_of("m", "Length of the path through the air, in space"))
    data["airspeed_mean_m_s"] = ("aircraft", extremes.speed_mean, attributes_of("m s-1", "Mean true airspeed"))
    for name, values, unit, words in (
        ("nominal_length_m", details.nominal_lengths_m, "m", "Length of the path without its bend"),
        ("turn_use", details.turn_use, "1", "Turn rate over that of the greatest bank angle"),
        ("hold_radius_m", details.hold_radii_m, "m", "Radius of the hold"),
        ("hold_turn", details.hold_turns, "1", "Sense of the hold's turn, 1: right, -1: left"),
        ("hold_height_m", details.hold_heights_m, "m", "Height of the hold over the goal"),
    ):
        if values is not None:
            data[name] = ("aircraft", values, attributes_of(unit, words))
    planned = {**extremes.values, "level_off_min": np.nan if details.level_off_m is None else details.level_off_m}
    for limit in LIMITS:
        found = {"": planned[limit.key], "limit_": details.limits.get(limit.key, np.nan)}
        if details.bounds is not None and limit.key in details.bounds:
            found["bound_"] = details.bounds[limit.key]
        said = {"": "planned", "limit_": "limit", "bound_": "proven bound"}
        for prefix, values in found.items():
            full = np.broadcast_to(np.asarray(values, dtype=float) * limit.factor, len(fleet)).copy()
            labels = attributes_of(limit.unit, f"{limit.words.capitalize()}, {said[prefix]}")
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
        data[f"keep_out_{name}"] = ("keep_out", np.array(values, dtype=float), attributes_of(unit, words))
    both = ("aircraft", "keep_out")
    data["keep_out_room_m"] = (both, samples.keep_out_room_m, attributes_of("m", "Least distance outside"))
    data["keep_out_at_s"] = (both, samples.keep_out_at_s, attributes_of("s", "When it is least"))
    if details.keep_out_bounds_m is not None:
        data["bound_keep_out_room_m"] = (
            both,
            details.keep_out_bounds_m,
            attributes_of("m", "Least distance outside, proven bound"),
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
    if scenario.separation.asked_m is not None:
        found["separation_horizontal_m"], found["separation_vertical_m"] = scenario.separation.asked_m
    known = {
        "distance_limit_m": scenario.requirements.separation_min_m,
        "separation_bound": details.separation_bound,
        "hold_separation_bound": details.hold_separation_bound,
    }
    return found | {name: value for name, value in known.items() if value is not None} | version_attributes()
