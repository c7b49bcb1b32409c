"""What became of a fleet without a centre: its links and clocks, and what the theorem of time coordination promises."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from anser.planning.decentralised.time_coordination import coordination_error, guaranteed_rate, quality_of_service
from anser.scenario.schema import Scenario
from anser.scenario.schema_network import Network

_EVERY_S = 1.0  # between two entries of the series
_APART = 1e-9  # a quality of service up to this is none


def summarize_network(
    time_s: np.ndarray, history: Mapping[str, np.ndarray], scenario: Scenario, agreed_after_s: float
) -> dict[str, Any]:
    """Links, clocks, and the convergence that is promised, up to when the first aircraft's path stands still.

    Parameters
    ----------
    time_s, history
        Of every step; arrays (time, aircraft).
    scenario
        With `fleet.planner = "decentralised"`.
    agreed_after_s
        How long the fleet talked about its plan.

    Returns
    -------
    dict
        `links_up` (mean part of the pairs that hear each other), `quality_of_service_min` and `_mean` over windows of
        `window_s`, `promised_rate_per_s` at the least quality, `clock_lag_max_s`, `coordination_error_max_s`,
        `offers` (paths offered to the others), `condition_met`, `message`, and the series `time_s`,
        `quality_of_service`, `coordination_error_s`.
    """
    numbers, names = scenario.network or Network(), [one.name for one in scenario.aircraft]
    stride = round(numbers.period_s / scenario.timing.step_s)
    until_s = float(np.min(history["arrival_time"][-1])) - scenario.timing.freeze_s
    rows = np.arange(0, time_s.size, stride)
    rows = rows[time_s[rows] <= max(until_s, numbers.window_s)]
    links = decode_links(np.asarray(history["heard_from"])[rows], len(names))
    clocks = time_s[rows, None] - np.asarray(history["clock_lag"])[rows]
    quality = quality_of_service(links, numbers.period_s, numbers.window_s)
    apart = coordination_error(clocks)
    pairs = max(len(names) * (len(names) - 1), 1)
    every = max(round(_EVERY_S / numbers.period_s), 1)
    shown = np.arange(0, quality.size, every)
    least = float(quality.min())
    bad = time_s[rows[: quality.size]][quality <= _APART]
    offered = np.asarray(history["path_offered"])
    return {
        "agreed_after_s": float(agreed_after_s),
        "links_up": float(links.sum(axis=(1, 2)).mean() / pairs),
        "window_s": numbers.window_s,
        "quality_of_service_min": least,
        "quality_of_service_mean": float(quality.mean()),
        "promised_rate_per_s": guaranteed_rate(least, numbers.coupling_per_s, numbers.window_s),
        "clock_lag_max_s": float(np.abs(history["clock_lag"][rows]).max()),
        "coordination_error_max_s": float(apart.max()),
        "offers": int(np.sum(np.diff(offered.astype(int), axis=0) > 0)),
        "condition_met": not bad.size,
        "message": _message(bad, numbers, least),
        "series": {
            "time_s": time_s[rows[shown]].tolist(),
            "quality_of_service": quality[shown].tolist(),
            "coordination_error_s": apart[shown].tolist(),
        },
    }


def decode_links(heard_from: np.ndarray, count: int) -> np.ndarray:
    """Who heard whom, (time, receiver, sender), from numbers in which bit k stands for aircraft k; (time, receiver)."""
    return (heard_from[:, :, None] >> np.arange(count)) & 1 == 1


def _message(bad_s: np.ndarray, numbers: Network, least: float) -> str:
    if bad_s.size:
        return (
            f"the network falls apart for {numbers.window_s:g} s or longer, first from {bad_s[0]:.1f} s on: "
            "the clocks are not promised to come together"
        )
    rate = guaranteed_rate(least, numbers.coupling_per_s, numbers.window_s)
    return (
        f"quality of service at least {least:.2f} over any {numbers.window_s:g} s: "
        f"differences of the clocks are promised to fall at {rate:.3f} per second or faster"
    )
