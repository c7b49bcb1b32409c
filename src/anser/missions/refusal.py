"""Reasons for a missing plan: the binding constraint, the size of the conflict, and the nearest feasible request.

`anser.missions.first_plan` calls these functions after a failed search of the certified planner. The module also gives
the reason for the start time of a planned sequence of arrivals.
"""

import math
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from anser.config.errors import quoted_list
from anser.planning.certified.arrival_times import (
    arrival_conflicts,
    arrival_distances_max,
    arrival_sets,
    common_times,
    reachable,
)
from anser.planning.certified.certified_plan import CertifiedPlan
from anser.planning.certified.fitted_wind import BEYOND_FIELD_M_S
from anser.planning.certified.search import FleetTask, SearchOutcome, search
from anser.planning.certified.task import Intervals
from anser.planning.holds.hold_paths import PlannedHolds
from anser.planning.limits import CERTIFIED_LIMITS, RELAXED_TOGETHER
from anser.planning.separation import Separation
from anser.scenario.build_aircraft import resolve_fleet
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft

_RELAXATIONS = 2.0 ** np.linspace(0.0, 2.0, 9)  # factors on a limit, from the requested value to four times as much
_MESSAGES_MAX = 3
_BISECTIONS = 5
_SAME_START = 1.001  # greatest ratio to the preferred start at which a sequence counts as begun at the preferred start
EXCESS_MEANINGFUL = 0.5
"""Relative excess over a limit above which an attempted path does not count as a path."""
_HIGH_SPEED = 0.9  # a mean airspeed above this share of the greatest airspeed points to the airspeed limit
_EXCESS_NAMED = 1e-6  # relative excess over a limit above which the limit is named as violated
_ALL_PAIRS_MAX = 20  # greatest fleet size for which every pair is checked at every arrival time


class Refusal(str):
    """A reason for a missing plan: one sentence, with the aircraft and the keys of the scenario that it concerns."""

    aircraft: tuple[str, ...]  #: Names of the aircraft.
    keys: tuple[str, ...]  #: Key paths of the constraints that bind, such as "limits.bank_max_deg".

    def __new__(cls, text: str, aircraft: Sequence[str] = (), keys: Sequence[str] = ()) -> "Refusal":
        """Return the sentence `text` with the names of aircraft and the key paths of constraints attached."""
        refusal = super().__new__(cls, text)
        refusal.aircraft, refusal.keys = tuple(aircraft), tuple(keys)
        return refusal


_SEPARATION_KEYS = ("separation.horizontal_m", "separation.vertical_m")
UNPROVEN = "nothing proves that it keeps its limits, the separation and the keep-outs"
"""Message for a path that is delivered although the certificate does not prove it."""


def unproven_paths(scenario: Scenario, feasible: np.ndarray) -> tuple[str, ...]:
    """Return one sentence for each aircraft whose path is not proven (`feasible` is False)."""
    pairs = zip(scenario.aircraft, feasible, strict=True)
    return tuple(
        Refusal(f'aircraft "{aircraft.name}": {UNPROVEN}', [aircraft.name])
        for aircraft, is_proven in pairs
        if not is_proven
    )


def diagnose_wind_field(fleet: FleetTask, outcome: SearchOutcome, *, has_plan_without: bool) -> tuple[Refusal, ...]:
    """Return the reason that no plan was found because the wind field differs from the layers fitted for planning.

    `has_plan_without` must be True if a search in the wind of the layers alone found a plan; if False, the result is
    empty. `outcome` is the result of the failed search.
    """
    if not has_plan_without:
        return ()
    attempts = [plan for plan in (outcome.plan_without_holds, outcome.best_attempt) if plan is not None]
    errors_m_s = [float(np.max(np.asarray(p.certificate.bounds.wind_error_max)[fleet.active])) for p in attempts]
    error_m_s = next(iter(errors_m_s), math.inf)
    if error_m_s >= BEYOND_FIELD_M_S:
        text = (
            "the paths or holds that the other constraints allow leave the wind field of the file; a larger field or "
            'wind.outside = "hold" would help'
        )
        return (Refusal(text, (), ("wind.field", "wind.outside")),)
    text = (
        f"the wind field differs by up to {error_m_s:.1f} m/s from the layers of wind with which the planner computes, "
        "and with this difference no path is proved to keep the limits of airspeed, bank angle and acceleration; with "
        "the layers alone there is a plan"
    )
    return (Refusal(text, (), ("wind.field",)),)


def diagnose_refusal(scenario: Scenario, fleet: FleetTask, outcome: SearchOutcome) -> tuple[Refusal, ...]:
    """Return the reasons for which the search found no plan for a scenario's fleet; all reasons are of one kind.

    The kind is the first that applies: rendezvous points too close; aircraft that cannot meet the request alone; no
    common arrival time; separation. `outcome` is the result of the search, without padding.
    """
    names, request = [aircraft.name for aircraft in scenario.aircraft], fleet.request
    conflicts = _conflicting_rendezvous(names, fleet)
    if conflicts:
        return tuple(conflicts)
    arrival_intervals = outcome.arrivals
    if arrival_intervals is None:
        arrival_intervals = arrival_sets(fleet.tasks, fleet.airspace, request.latest_s)
    keep_outs = [keep_out.name for keep_out in scenario.keep_out]
    infeasible = _infeasible_aircraft(names, fleet, arrival_intervals, outcome, keep_outs)
    if infeasible and request.rule == "at":
        infeasible.extend(_later_common_time(arrival_intervals, float(np.max(fleet.requested_times()))))
    if infeasible:
        return tuple(infeasible)
    # An aircraft without intervals has a path from the search, which covers more than the intervals.
    if request.rule in ("together", "earliest", "sequence") and all(arrival_intervals):
        offsets, latest_s = request.offsets(len(names)), request.latest_s
        common = common_times(arrival_intervals, offsets)
        if all(start > latest_s - float(np.max(offsets)) for start, _ in common):
            keys = "arrival.rule", f"fleet.{scenario.fleet.airspeed_key}", "timing.duration_s"
            return (_no_common_time(names, arrival_intervals, offsets, latest_s, keys),)
    return (_largest_feasible_separation(names, fleet, outcome),)


def describe_failed_attempt(scenario: Scenario, attempt: CertifiedPlan) -> tuple[Refusal, ...]:
    """Describe the worst violation of each failed path in an attempt at a plan, one sentence per aircraft or pair.

    The result has at most three sentences. `attempt` must have no padding.
    """
    names, messages = [aircraft.name for aircraft in scenario.aircraft], {}
    certificate, times = attempt.certificate, np.asarray(attempt.arrival_times)
    ratios, excesses = np.asarray(certificate.clearance_ratio), np.asarray(certificate.excess)
    for k in np.flatnonzero(~np.asarray(attempt.feasible)):
        excess, clearance = excesses[k], np.asarray(certificate.keep_out_clearance)[k, : len(scenario.keep_out)]
        path = f'the paths tried so far take "{names[k]}" to its rendezvous at {times[k]:.1f} s'
        nearest, worst = int(np.argmin(ratios[k])), int(np.argmax(excess))
        if not np.max(excess) <= EXCESS_MEANINGFUL:  # NaN: no path at all
            text = f'no path of the kinds tried so far takes "{names[k]}" to its rendezvous at {times[k]:.1f} s'
            needed, greatest_m_s, keys = "", resolve_fleet(scenario)[k].limits.speed_max_m_s, []
            if scenario.wind.field is None:
                mean_m_s = _straight_airspeed_m_s(scenario, scenario.aircraft[int(k)], float(times[k]))
                keys = ["limits.speed_max_m_s"] if mean_m_s > _HIGH_SPEED * greatest_m_s else []
                needed = f": the straight way takes a mean airspeed of {mean_m_s:.0f} of at most {greatest_m_s:.0f} m/s"
            messages[k] = Refusal(f"{text}{needed}", [names[k]], keys)
        elif excess[worst] > _EXCESS_NAMED:
            limit = CERTIFIED_LIMITS[worst]
            key = f"limits.{limit.scenario_key}"
            messages[k] = Refusal(f"{path} beyond the limit of the {limit.description} ({key})", [names[k]], [key])
        elif clearance.size and np.min(clearance) < 0.0:
            j = int(np.argmin(clearance))
            text = f'{path} through the keep-out "{scenario.keep_out[j].name}"'
            messages[k] = Refusal(text, [names[k]], [f"keep_out[{j}].radius_m"])
        elif ratios[k, nearest] < 1.0:
            pair = tuple(sorted((int(k), nearest)))
            text = f'the paths tried so far do not keep "{names[pair[0]]}" and "{names[pair[1]]}" apart'
            messages[pair] = Refusal(text, [names[i] for i in pair], _SEPARATION_KEYS)
        else:
            messages[k] = Refusal(f"{path}, but not within its limits at every sample", [names[k]])
    return tuple(messages.values())[:_MESSAGES_MAX]


def _straight_airspeed_m_s(scenario: Scenario, aircraft: Aircraft, time_s: float) -> float:
    """Return the mean airspeed, m/s, of a straight flight that arrives at `time_s` (s), in the wind at the start."""
    goal_m = np.add(scenario.goal_of(aircraft).position_m(time_s), aircraft.rendezvous.stand_off_m)
    wind_m_s = np.array(scenario.wind.velocity_m_s(aircraft.start.altitude_m))
    return float(np.linalg.norm(goal_m - aircraft.start.position_m - time_s * wind_m_s)) / max(time_s, 1e-9)


def earliest_common_time(arrival_intervals: Sequence[Intervals], from_s: float) -> float | None:
    """Return the earliest time, s, at or after `from_s` (s) at which every aircraft can arrive if it flies alone.

    Rounded up to 0.1 s; None if no such time exists. `arrival_intervals` has the intervals (s) of each aircraft.
    """
    common = common_times(arrival_intervals, np.zeros(len(arrival_intervals)))
    earliest_s = min((max(start, from_s) for start, end in common if end >= from_s), default=None)
    return None if earliest_s is None else math.ceil(10.0 * earliest_s - 1e-6) / 10.0


def _later_common_time(arrival_intervals: Sequence[Intervals], requested_s: float) -> tuple[Refusal, ...]:
    """Return a sentence with the earliest time after `requested_s` (s) at which all can arrive; () if there is none."""
    earliest_s = earliest_common_time(arrival_intervals, requested_s)
    if earliest_s is None or earliest_s <= requested_s:
        return ()
    text = f"the earliest time found at which all can arrive, each by itself, is {earliest_s:.1f} s"
    return (Refusal(text, (), ["arrival.time_s"]),)


def describe_sequence_start(
    scenario: Scenario, fleet: FleetTask, arrivals_s: np.ndarray, outcome: SearchOutcome | None
) -> str:
    """Return one sentence: when a planned sequence begins, and which aircraft keeps it from beginning earlier.

    `arrivals_s` are the planned times, s after the start. `outcome` is the result of the search, without padding; if
    None, the sentence does not say why an attempt at an earlier start failed.
    """
    names, offsets = [aircraft.name for aircraft in scenario.aircraft], fleet.offsets
    starts = fleet.preferred_times - offsets
    binding, begin_s = int(np.argmax(starts)), float(np.min(arrivals_s - offsets))
    begin = f"the sequence begins at {begin_s:.1f} s"
    if begin_s <= starts[binding] * _SAME_START:
        aircraft = scenario.aircraft[binding]
        table = aircraft if aircraft.airspeed_forms else scenario.fleet
        key = f"{f'aircraft[{binding}]' if table is aircraft else 'fleet'}.{table.airspeed_key}"
        place = f"arrives {offsets[binding]:g} s after the first" if offsets[binding] > 0.0 else "arrives first"
        return (
            f'{begin}, no earlier because of "{aircraft.name}", which {place} and needs '
            f"{fleet.preferred_times[binding]:.1f} s by its direct path at its preferred "
            f"{scenario.speed_for(aircraft):g} m/s, the climb included; a higher {key} or another arrival.order "
            "would let the sequence begin earlier"
        )
    text = f"{begin}, not at {starts[binding]:.1f} s as the preferred speeds would allow"
    earlier = None if outcome is None else outcome.earlier_attempt
    return text if earlier is None else f"{text}: {_earlier_failure(names, fleet, earlier)}"


def _earlier_failure(names: Sequence[str], fleet: FleetTask, attempt: CertifiedPlan) -> str:
    """Return a clause that says why an attempt at earlier arrival times failed."""
    times = np.asarray(attempt.arrival_times)
    alone = fleet.active & ~np.asarray(attempt.valid & attempt.certificate.satisfied_individually)
    if alone.any():
        aircraft = " and ".join(f'"{names[k]}" at {times[k]:.1f} s' for k in np.flatnonzero(alone)[:_MESSAGES_MAX])
        return f"no path within its limits was found for {aircraft}"
    if (fleet.active & ~np.asarray(attempt.feasible)).any():
        ratios = np.asarray(attempt.certificate.clearance_ratio)
        first, second = (int(k) for k in np.unravel_index(int(np.argmin(ratios)), ratios.shape))
        return (
            f'no paths were found that keep "{names[first]}", at {times[first]:.1f} s, and "{names[second]}", at '
            f"{times[second]:.1f} s, apart: {max(float(ratios[first, second]), 0.0):.2f} of the separation at best"
        )
    return (
        f"the aircraft could arrive from {float(np.min(times)):.1f} s on, but no holds were found afterwards that keep "
        "the limits, the distances from goals and keep-outs, and the separation"
    )


def diagnose_missing_holds(scenario: Scenario, fleet: FleetTask, holds: PlannedHolds) -> tuple[Refusal, ...]:
    """Return the reasons for which aircraft can arrive but cannot hold afterwards, at most three.

    A reason names a pair whose holds (holding patterns) come too close, or an aircraft whose hold alone violates
    altitude limits, keep-outs or distance from the goal. `holds` are the best holds found for the planned arrivals.
    """
    names = [aircraft.name for aircraft in scenario.aircraft]
    scenario_aircraft = slice(len(names))  # without the padding
    messages, ratios = [], np.asarray(holds.clearance_ratio)[scenario_aircraft, scenario_aircraft]
    for k in np.flatnonzero(~np.asarray(holds.clear)[scenario_aircraft] & fleet.active):
        nearest = int(np.argmin(ratios[k]))
        if ratios[k, nearest] >= 1.0:
            # The clearance belongs to one circle; a keep-out need not be the cause of all refusals.
            has_keep_outs = np.isfinite(np.asarray(holds.keep_out_clearance)[k]).any()
            # A path whose angle at the arrival is free may arrive in a dive, which no hold can follow.
            is_free = scenario.aircraft[k].rendezvous.path_angle_deg is None
            remedies = ["a greater stand-off of its rendezvous"]
            remedies += ["a rendezvous farther from them"] if has_keep_outs else []
            remedies += ["a level arrival (rendezvous.path_angle_deg = 0)"] if is_free else []
            text = (
                f'aircraft "{names[k]}" can arrive, but no hold afterwards keeps it within the limits of altitude'
                f"{', off its goal and out of the keep-outs' if has_keep_outs else ' and off its goal'}; "
                f"{' or '.join(remedies)} may help"
            )
            keys = [f"aircraft[{k}].rendezvous.path_angle_deg"] if is_free else []
            messages.append(Refusal(text, [names[k]], ["hold.radius_m", "limits.altitude_min_m", *keys]))
        elif k < nearest or ratios[nearest, k] >= 1.0:
            text = (
                f'"{names[k]}" and "{names[nearest]}" can arrive, but no holds afterwards keep them apart until the '
                f"flight ends: {ratios[k, nearest]:.2f} of the separation at best; other courses of arrival, "
                "rendezvous points farther apart or arrivals one after another would help"
            )
            messages.append(Refusal(text, [names[k], names[nearest]], _SEPARATION_KEYS))
    return tuple(messages[:_MESSAGES_MAX])


def format_intervals(intervals: Sequence[tuple[float, float]]) -> str:
    """Return intervals of arrival times (s) as text: the first three, or "at no time" if there are none."""
    if not intervals:
        return "at no time"
    parts = [
        f"from {a:.1f} s on" if np.isinf(b) else f"from {a:.1f} to {b:.1f} s" for a, b in intervals[:_MESSAGES_MAX]
    ]
    suffix = " and later" if len(intervals) > _MESSAGES_MAX else ""
    return " and ".join(parts) + suffix


def _conflicting_rendezvous(names: Sequence[str], fleet: FleetTask) -> list[Refusal]:
    """Return reasons for pairs of aircraft whose rendezvous points are too close at every permitted arrival time.

    The result has at most three reasons. It is empty for arrival windows and for more than 20 aircraft.
    """
    if fleet.request.windows_s is not None or len(names) > _ALL_PAIRS_MAX:
        return []
    times = fleet.requested_times()
    if times.shape[0] == 0:
        return []
    is_conflict = np.all(arrival_conflicts(fleet.tasks, fleet.airspace, times), axis=0)
    horizontal_m, vertical_m = arrival_distances_max(fleet.tasks, fleet.airspace, times)
    time_text = f"at {times[0, 0]:.1f} s" if fleet.request.rule == "at" else "when the first of them arrives"
    separation = fleet.airspace.separation
    required_m = float(separation.horizontal), float(separation.vertical)
    messages = []
    for i, j in zip(*np.nonzero(np.triu(is_conflict)), strict=True):
        widest = int(np.argmax(horizontal_m[:, i, j]))
        attainable_m = horizontal_m[widest, i, j], vertical_m[widest, i, j]
        text = (
            f'the rendezvous points of "{names[i]}" and "{names[j]}" are too close to each other: {time_text} '
            f"they leave {_distances(*attainable_m, required_m[1] > 0.0)} at most, "
            f"{_distances(*required_m, required_m[1] > 0.0)} asked, the reserve included"
        )
        messages.append(Refusal(text, (names[int(i)], names[int(j)]), _SEPARATION_KEYS))
    return messages[:_MESSAGES_MAX]


def _distances(horizontal_m: float, vertical_m: float, with_vertical: bool) -> str:
    """Return a horizontal distance (m) as text, with the vertical distance (m) if `with_vertical`."""
    return f"{horizontal_m:.0f} m" + (f" / {vertical_m:.0f} m" if with_vertical else "")


def _infeasible_aircraft(
    names: Sequence[str],
    fleet: FleetTask,
    arrival_intervals: Sequence[Intervals],
    outcome: SearchOutcome,
    keep_outs: Sequence[str],  # names of the keep-outs
) -> list[Refusal]:
    """Return one reason for each aircraft that cannot meet the arrival request even without the other aircraft."""
    messages, request, best = [], fleet.request, outcome.best_attempt
    # The search covers more than the arrival sets: an aircraft with a path from the search is not infeasible.
    is_feasible = np.zeros(len(names), dtype=bool) if best is None else _proven_alone(best)
    for k, name in enumerate(names):
        if is_feasible[k]:
            continue
        intervals = arrival_intervals[k]
        if not intervals:
            refusal = f"cannot arrive within {request.latest_s:.0f} s"
            requested_s, keys = request.latest_s, ("timing.duration_s",)
        elif request.times_s is not None:
            requested_s = float(request.times_s[k])
            if any(a <= requested_s <= b for a, b in intervals):
                continue
            refusal = f"cannot arrive at {requested_s:.1f} s"
            keys = ("arrival.time_s",) if request.rule == "at" else (f"aircraft[{k}].arrive_s",)
        elif request.windows_s is not None:
            window_start, window_end = request.windows_s[k]
            if any(a <= window_end and b >= window_start for a, b in intervals):
                continue
            refusal, requested_s = f"cannot arrive between {window_start:.1f} and {window_end:.1f} s", float(window_end)
            keys = f"aircraft[{k}].arrive_from_s", f"aircraft[{k}].arrive_to_s"
        else:
            continue
        nearest = f"; by itself it can {format_intervals(intervals)} (coarse search)" if intervals else ""
        constraint, constraint_keys = _binding_constraint(k, fleet, requested_s, keep_outs)
        messages.append(Refusal(f'aircraft "{name}" {refusal}{constraint}{nearest}', [name], constraint_keys + keys))
    return messages


def _proven_alone(attempt: CertifiedPlan) -> np.ndarray:
    """Return for each aircraft whether its path in an attempt keeps its own limits, without regard to the others."""
    return np.asarray(attempt.valid & attempt.certificate.satisfied_individually)


def _relax_constraint(fleet: FleetTask, constraint: str, factor: float, keep_out: int | None = None) -> FleetTask:
    """Return the fleet's task with one constraint relaxed by a factor (1: unchanged).

    `constraint` is a key of `RELAXED_TOGETHER` or "keep-outs". For "keep-outs", the radius of the keep-out with the
    index `keep_out` (None: of every keep-out) is divided by the factor.
    """
    limits = fleet.tasks.limits
    if constraint == "keep-outs":
        radius = np.array(fleet.airspace.keep_outs.radius)
        radius[slice(None) if keep_out is None else keep_out] /= factor
        airspace = eqx.tree_at(lambda a: a.keep_outs.radius, fleet.airspace, radius)
        return FleetTask(fleet.tasks, airspace, fleet.request)
    for limit in RELAXED_TOGETHER[constraint]:
        relaxed = limit.relaxed(getattr(limits, limit.field), factor)
        limits = eqx.tree_at(lambda x, field=limit.field: getattr(x, field), limits, relaxed)
    return FleetTask(eqx.tree_at(lambda t: t.limits, fleet.tasks, limits), fleet.airspace, fleet.request)


def _is_proven_without_side(aircraft: int, fleet: FleetTask) -> bool:
    """Return whether a search finds a path of an aircraft for the request if no side of its detour is prescribed."""
    sides = np.array(fleet.tasks.side)
    sides[aircraft] = 0
    outcome = search(0.0, eqx.tree_at(lambda t: t.side, fleet.tasks, sides), fleet.airspace, fleet.request)
    best = outcome.best_attempt if outcome.plan is None else outcome.plan
    return best is not None and bool(_proven_alone(best)[aircraft])


def _binding_constraint(
    aircraft: int, fleet: FleetTask, requested_s: float, keep_outs: Sequence[str]
) -> tuple[str, tuple[str, ...]]:
    """Find the constraint to be relaxed least so that an aircraft, flying alone, can arrive at `requested_s` (s).

    A prescribed side of the detour is relaxed first. Returns a clause that names the constraint and its relaxation, and
    the scenario's keys of the constraint. If no single constraint relaxed by a factor of up to 4 suffices, the clause
    says so, and the keys are ().
    """
    best: tuple[float, str] | None = None

    def has_path(task: FleetTask) -> bool:
        return bool(reachable(task.tasks, task.airspace, np.array([aircraft]), np.array([requested_s]))[0])

    if np.asarray(fleet.tasks.side)[aircraft] and _is_proven_without_side(aircraft, fleet):
        key = f"aircraft[{aircraft}].bend"
        return f': the side of the detour ({key}) stands in the way; with "auto", a path exists', (key,)
    for constraint in (*RELAXED_TOGETHER, "keep-outs"):
        if constraint == "keep-outs" and fleet.airspace.keep_outs.radius.shape[0] == 0:
            continue
        low, high = 0, len(_RELAXATIONS) - 1

        def is_reachable(step: int, constraint: str = constraint) -> bool:
            return has_path(_relax_constraint(fleet, constraint, float(_RELAXATIONS[step])))

        if not is_reachable(high):
            continue
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if is_reachable(middle) else (middle, high)
        if best is None or _RELAXATIONS[high] < best[0]:
            best = float(_RELAXATIONS[high]), constraint
    if best is None:
        return ": no single limit, loosened up to four times, changes that", ()
    factor, constraint = best
    if constraint == "keep-outs":
        indices: Sequence[int] = range(len(keep_outs))
        # one keep-out that alone stands in the way; if none does, all stand in the way together
        blocking = next((j for j in indices if has_path(_relax_constraint(fleet, constraint, factor, j))), None)
        indices = indices if blocking is None else (blocking,)
        names, smaller = " and ".join(f'"{keep_outs[j]}"' for j in indices), 100.0 * (1.0 - 1.0 / factor)
        subject = f"keep-out {names} stands" if len(indices) == 1 else f"keep-outs {names} stand"
        text = (
            f": the {subject} in the way; with {'a radius' if len(indices) == 1 else 'radii'} {smaller:.0f} % smaller"
        )
        return f"{text}, a path exists", tuple(f"keep_out[{j}].radius_m" for j in indices)
    keys = tuple(f"limits.{limit.scenario_key}" for limit in RELAXED_TOGETHER[constraint])
    loosened = f"loosened by {100.0 * (factor - 1.0):.0f} %, a path exists"
    return f": the {constraint} ({' and '.join(keys)}) stands in the way; {loosened}", keys


def _no_common_time(
    names: Sequence[str],
    arrival_intervals: Sequence[Intervals],
    offsets_s: np.ndarray,
    latest_s: float,
    keys: Sequence[str],  # keys of the scenario that can make a common time possible
) -> Refusal:
    starts = [intervals[0][0] - offset for intervals, offset in zip(arrival_intervals, offsets_s, strict=True)]
    ends = [intervals[-1][1] - offset for intervals, offset in zip(arrival_intervals, offsets_s, strict=True)]
    latest, earliest = int(np.argmax(starts)), int(np.argmin(ends))
    latest_text, earliest_text = (format_intervals(arrival_intervals[k]) for k in (latest, earliest))
    text = (
        f'no arrival time up to {latest_s:.0f} s is open to all: "{names[latest]}" can arrive {latest_text}, '
        f'"{names[earliest]}" {earliest_text}'
    )
    return Refusal(text, [names[latest], names[earliest]], keys)


def _largest_feasible_separation(names: Sequence[str], fleet: FleetTask, outcome: SearchOutcome) -> Refusal:
    """Return a reason with the greatest separation for which a search finds a plan, in steps of 1/32 of the request."""
    separation, best = fleet.airspace.separation, outcome.best_attempt
    horizontal, vertical = float(separation.horizontal), float(separation.vertical)
    unproven = [] if best is None else [names[int(k)] for k in np.flatnonzero(~_proven_alone(best))]
    subjects = unproven or names
    text = (
        f"no path was proved for {quoted_list(subjects)} in {outcome.attempts} tries, though the time is within reach"
    )
    not_proved = Refusal(text, subjects)
    if horizontal == 0.0 or len(names) == 1:
        return not_proved
    pair, pair_names = "", ()
    if best is not None:
        ratios = np.asarray(best.certificate.clearance_ratio)
        aircraft_a, aircraft_b = (int(k) for k in np.unravel_index(int(np.argmin(ratios)), ratios.shape))
        pair_names = names[aircraft_a], names[aircraft_b]
        pair = f' ("{pair_names[0]}" and "{pair_names[1]}" are the closest)'
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        factor = 1.0 / max(middle, 1e-6)
        smaller = Separation(separation.horizontal / factor, separation.vertical / factor)
        airspace = eqx.tree_at(lambda a: a.separation, fleet.airspace, smaller)
        is_feasible = search(0.0, fleet.tasks, airspace, fleet.request, thorough=False).plan is not None
        low, high = (middle, high) if is_feasible else (low, middle)
    if low == 0.0 and unproven:
        return not_proved
    if low == 0.0:
        text = f"the aircraft do not keep apart{pair}: not even a small part of the separation asked was reached"
        return Refusal(text, pair_names, _SEPARATION_KEYS)
    attainable, requested = (_distances(share * horizontal, share * vertical, vertical > 0.0) for share in (low, 1.0))
    text = f"separation {attainable} reachable, {requested} asked{pair}, the reserve included"
    return Refusal(text, pair_names, _SEPARATION_KEYS)
