"""Summary of a decentralised fleet's network: links, clock differences, and their guaranteed rate of convergence.

Each aircraft flies its path by its own clock, and adjusts this clock to the clocks in the messages that arrive. The
clocks converge at a guaranteed rate if the fleet is connected within every time window.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from anser.planning.certified.replanning import CORRECTED, REPLANNED
from anser.planning.decentralised.time_coordination import coordination_error, guaranteed_rate, quality_of_service
from anser.scenario.schema import Scenario
from anser.scenario.schema_settings import Network
from anser.simulation.closed_loop import is_off_plan

_SERIES_STEP_S = 1.0  # time between two entries of the series
_QUALITY_ZERO = 1e-9  # greatest quality of service that counts as zero

_PATH_END = [(point, axis) for point in ("reference", "rendezvous") for axis in ("north", "east", "altitude")]


def summarize_network(
    # times of every step, s, and recorded arrays by key, shape (time, aircraft)
    time_s: np.ndarray,
    history: Mapping[str, np.ndarray],
    scenario: Scenario,  # scenario with `fleet.planner = "decentralised"`
    agreed_after_s: float,  # duration of the fleet's consensus on the plan, s
) -> dict[str, Any]:
    """Return the entry `network` of a flight's summary, as plain data: links, clocks, guaranteed convergence, paths.

    Links and clocks are evaluated until `scenario.timing.freeze_s` before the first planned arrival. An aircraft that
    leaves its plan or crashes is excluded from then on. Some of the entries:

    - `links_up`: mean fraction of the pairs of aircraft that have a link
    - `quality_of_service_min`, `quality_of_service_mean`: least and mean value of the time windows of length `window_s`
    - `promised_rate_per_s`: guaranteed rate of decay of clock differences, at the least quality of service
    - `offers`: number of new paths that aircraft offered to the fleet
    - `condition_met`: whether the quality of service was positive in every window
    - `outdated_paths`: aircraft whose last path ends too far from the rendezvous, see `_outdated_paths`
    - `message`: the results as text
    - `series`: samples at intervals of about 1 s
    """
    network, names = scenario.network or Network(), [aircraft.name for aircraft in scenario.aircraft]
    stride = round(network.period_s / scenario.timing.step_s)
    until_s = float(np.min(history["arrival_time"][-1])) - scenario.timing.freeze_s
    samples = np.arange(0, time_s.size, stride)
    samples = samples[time_s[samples] <= max(until_s, network.window_s)]
    links = decode_links(np.asarray(history["heard_from"])[samples], len(names))
    clocks = time_s[samples, None] - np.asarray(history["clock_lag"])[samples]
    takes_part = np.cumsum(is_off_plan(np.asarray(history["status"])), axis=0)[samples] == 0
    quality, clock_error = _coordination_of_participants(links, clocks, takes_part, network)
    both_take_part = takes_part[:, :, None] & takes_part[:, None, :] & ~np.eye(len(names), dtype=bool)
    series_stride = max(round(_SERIES_STEP_S / network.period_s), 1)
    series_samples = np.arange(0, quality.size, series_stride)
    quality_min = float(quality.min())
    outage_times_s = time_s[samples[: quality.size]][quality <= _QUALITY_ZERO]
    path_offered = np.asarray(history["path_offered"])
    outdated_paths = _outdated_paths(time_s, history, names, network)
    return {
        "agreed_after_s": float(agreed_after_s),
        "links_up": float(links[both_take_part].mean()) if both_take_part.any() else 0.0,
        "window_s": network.window_s,
        "quality_of_service_min": quality_min,
        "quality_of_service_mean": float(quality.mean()),
        "promised_rate_per_s": guaranteed_rate(quality_min, network.coupling_per_s, network.window_s),
        "clock_lag_max_s": float(np.abs(history["clock_lag"][samples]).max(where=takes_part, initial=0.0)),
        "coordination_error_max_s": float(clock_error.max()),
        "offers": int(np.sum(np.diff(path_offered.astype(int), axis=0) > 0)),
        "condition_met": not outage_times_s.size,
        "outdated_paths": outdated_paths,
        "message": "; ".join(
            [
                _message(outage_times_s, network, quality_min),
                *(
                    f'"{path["aircraft"]}" flew from {path["from_s"]:.1f} s on a path that ends '
                    f"{path['distance_m']:.0f} m from its rendezvous, because the fleet agreed on no other in time"
                    for path in outdated_paths
                ),
            ]
        ),
        "series": {
            "time_s": time_s[samples[series_samples]].tolist(),
            "quality_of_service": quality[series_samples].tolist(),
            "coordination_error_s": clock_error[series_samples].tolist(),
        },
    }


def _coordination_of_participants(
    links: np.ndarray,  # shape (time, receiver, sender)
    clocks: np.ndarray,  # s, shape (time, aircraft)
    takes_part: np.ndarray,  # shape (time, aircraft); never true again after it was false
    network: Network,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the quality of service in each complete window, and the coordination error (s) at each time.

    The coordination error is the norm of the clocks' deviations from their mean. Only aircraft that take part are
    included; for a window, its last sample decides. If fewer than two take part, the quality is 1 and the error 0.
    """
    count = quality_of_service(links, network.period_s, network.window_s).size
    quality, clock_error = np.ones(count), np.zeros(len(clocks))
    for participants in np.unique(takes_part, axis=0):
        at = np.all(takes_part == participants, axis=1)
        if participants.sum() > 1:
            own = quality_of_service(links[:, participants][:, :, participants], network.period_s, network.window_s)
            ends = at[len(at) - count :]
            quality[ends] = own[ends]
            clock_error[at] = coordination_error(clocks[np.ix_(at, participants)])
    return quality, clock_error


def _outdated_paths(
    time_s: np.ndarray, history: Mapping[str, np.ndarray], names: list[str], network: Network
) -> list[dict[str, Any]]:
    """List the aircraft with a last path that ends farther than `network.tube_m` from the rendezvous at arrival.

    An entry has `aircraft` (name), `from_s` (time since which the path was not renewed, s) and `distance_m` (between
    end of the path and rendezvous). Aircraft that left their plan before, and planned arrivals after the end of the
    record, are left out.
    """
    outdated = []
    for k, name in enumerate(names):
        arrival_s = float(history["arrival_time"][-1, k])
        if not arrival_s <= time_s[-1]:
            continue
        arrival = int(np.searchsorted(time_s, arrival_s))
        if is_off_plan(history["status"][: arrival + 1, k]).any():
            continue
        ends = np.stack([history[f"{point}_{axis}"][arrival, k] for point, axis in _PATH_END])
        distance_m = float(np.linalg.norm(ends[:3] - ends[3:]))
        is_renewed = np.isin(history["renewal"][: arrival + 1, k], (CORRECTED, REPLANNED))
        if distance_m > network.tube_m and not is_renewed[-1]:
            renewed = np.flatnonzero(is_renewed)
            from_s = float(time_s[renewed[-1] + 1]) if renewed.size else 0.0
            outdated.append({"aircraft": name, "from_s": from_s, "distance_m": distance_m})
    return outdated


def decode_links(heard_from: np.ndarray, count: int) -> np.ndarray:
    """Return whether each receiver heard each sender, shape (time, receiver, sender), in a fleet of `count` aircraft.

    Bit k of `heard_from` (time, receiver) is set if a message from aircraft k arrived.
    """
    return (heard_from[:, :, None] >> np.arange(count)) & 1 == 1


def _message(outage_times_s: np.ndarray, network: Network, quality_min: float) -> str:
    if outage_times_s.size:
        return (
            f"the network falls apart for {network.window_s:g} s or longer, first from {outage_times_s[0]:.1f} s on: "
            "the clocks are not promised to come together"
        )
    rate = guaranteed_rate(quality_min, network.coupling_per_s, network.window_s)
    return (
        f"quality of service at least {quality_min:.2f} over any {network.window_s:g} s: differences of the clocks are "
        f"promised to fall at {rate:.3f} per second or faster"
    )
