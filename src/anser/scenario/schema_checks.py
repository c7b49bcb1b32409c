"""Checks of consistency between the tables of a scenario: planner, names, flight limits, stand-off, sensors, network.

Each `*_problems` function returns a list of problems, empty if the tables are consistent.
"""

import math
from collections.abc import Iterable

from anser.config.errors import Problem, format_number, format_value, quoted_list
from anser.config.tables import Table, ordering_problems
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, STANDARD_GRAVITY_M_S2, SURFACE_STAND_OFF_MIN_M
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_airspace import AIRCRAFT_CHANGES
from anser.scenario.schema_excitation import EXCITED_INPUTS, LOOP_INPUTS
from anser.scenario.schema_sensing import goal_sigma_m
from anser.scenario.schema_settings import (
    Limits,
    Network,
    greatest_rate_range,
    is_multiple,
    multiple_message,
    rate_range_problems,
)
from anser.scenario.schema_tables import ScenarioTables

AIRBORNE_ALTITUDE_MIN_M = 50.0
DECENTRALISED_AIRCRAFT_MAX = 30

_SCOPE = "this is the scope of anser: a rendezvous is never the goal itself"
_CERTIFIED_LIMITS = ("altitude_max_m", "roll_rate_max_deg_s", "acceleration_max_m_s2", "deceleration_max_m_s2")
_CERTIFIED_AIRCRAFT_KEYS = ("speed_m_s", "arrive_s", "arrive_from_s", "arrive_to_s")
_DECENTRALISED_RULES = ("together", "at", "times", "sequence")
_DECENTRALISED_EVENTS = ("goal-sensor-lost", "thrust-lost", AIRCRAFT_CHANGES, "goal-stops", "goal-turns")


def order_problems(scenario: ScenarioTables) -> list[Problem]:
    """List limits of airspeed and angle of attack whose lower bound is not below the upper bound."""
    problems = [
        *ordering_problems(scenario.limits, "speed_min_m_s", "speed_max_m_s", "m/s"),
        *ordering_problems(scenario.limits, "alpha_min_deg", "alpha_max_deg", "deg"),
    ]
    return [Problem(f"limits.{problem.path}", problem.arrived, problem.expected) for problem in problems]


def range_problems(scenario: ScenarioTables) -> list[Problem]:
    """List limits of airspeed and angle of attack beyond the range of an aircraft's data, once for each limit.

    Altitudes beyond the range are allowed; the results mark the time outside the range.
    """
    problems: dict[str, Problem] = {}
    for data_range in dict.fromkeys(aircraft.range for aircraft in scenario.aircraft):
        limits = scenario.limits.within(data_range)
        for bounds, low_key, high_key, unit in (
            (data_range.airspeed_m_s, "speed_min_m_s", "speed_max_m_s", "m/s"),
            (data_range.alpha_deg, "alpha_min_deg", "alpha_max_deg", "deg"),
        ):
            if bounds is None:
                continue
            low, high = getattr(limits, low_key), getattr(limits, high_key)
            for key, value, is_exceeded, bound in (
                (low_key, low, low < bounds[0], f"at least {format_number(bounds[0])}"),
                (high_key, high, high > bounds[1], f"at most {format_number(bounds[1])}"),
            ):
                if is_exceeded:
                    expected = f"{bound} {unit}, where the data of {data_range.name} hold"
                    problems.setdefault(key, Problem(f"limits.{key}", format_number(value), expected))
    return list(problems.values())


def name_problems(scenario: ScenarioTables) -> list[Problem]:
    """List names used twice and references to goals that do not exist."""
    problems = []
    for kind, items in (("aircraft", scenario.aircraft), ("goal", scenario.goal)):
        names = [item.name for item in items]
        for index, name in enumerate(names):
            if name in names[:index]:
                arrived = f'"{name}", already the name of {kind}[{names.index(name)}]'
                problems.append(Problem(f"{kind}[{index}].name", arrived, "a name of its own"))
    goal_names = [goal.name for goal in scenario.goal]
    expected = f"the name of a goal of this scenario ({quoted_list(goal_names)})"
    return problems + [
        Problem(f"aircraft[{index}].goal", f'"{aircraft.goal}"', expected, aircraft.label)
        for index, aircraft in enumerate(scenario.aircraft)
        if aircraft.goal not in goal_names
    ]


def speed_problems(scenario: ScenarioTables) -> list[Problem]:
    """List preferred airspeeds outside the limits, winds not slower than an aircraft, and too small a hold radius.

    The least hold radius is the turn radius with `limits.bank_max_deg` at the airspeed plus the greatest horizontal
    wind. A wind field counts as still air, because its file is not read.
    """
    problems: dict[str, Problem] = {}
    for index, aircraft in enumerate(scenario.aircraft):
        for problem in _aircraft_speed_problems(scenario, index, aircraft):
            problems.setdefault(problem.path, problem)
    return list(problems.values())


def _aircraft_speed_problems(scenario: ScenarioTables, index: int, aircraft: Aircraft) -> list[Problem]:
    problems, limits, wind = [], scenario.limits_for(aircraft), scenario.wind
    speed_m_s = scenario.speed_for(aircraft)
    table, table_path = (aircraft, f"aircraft[{index}]") if aircraft.airspeed_forms else (scenario.fleet, "fleet")
    key = f"{table_path}.{table.airspeed_key}"
    if not limits.speed_min_m_s < speed_m_s < limits.speed_max_m_s:
        expected = f"a speed between {_speed_bounds(limits, 'and')}{_limits_owner(scenario, aircraft)}"
        subject = aircraft.label if aircraft.airspeed_forms else ""
        problems.append(Problem(key, table.airspeed_text, expected, subject))
    if wind.field is None and wind.speed_max_m_s >= speed_m_s:
        expected = f"a wind slower than {table.airspeed_name(table_path)}, which is {format_number(speed_m_s)} m/s"
        path, wind_m_s = ("speed_m_s", wind.speed_m_s) if wind.layers is None else ("layers", wind.speed_max_m_s)
        problems.append(Problem(f"wind.{path}", format_number(wind_m_s), expected))
    ground_speed_m_s = speed_m_s + max(math.hypot(*velocity[:2]) for _, velocity in wind.profile_m_s)
    tightest_m = ground_speed_m_s**2 / (STANDARD_GRAVITY_M_S2 * math.tan(math.radians(limits.bank_max_deg)))
    if scenario.hold.radius_m < tightest_m:
        expected = (
            f"at least {math.ceil(tightest_m)} m, the turn at {ground_speed_m_s:.1f} m/s over the ground with "
            f"limits.bank_max_deg = {format_number(limits.bank_max_deg)}"
        )
        arrived = format_number(scenario.hold.radius_m)
        if "radius_m" not in scenario.hold.model_fields_set:
            arrived += ", the default"
            expected += f"; write [hold] with radius_m = {math.ceil(tightest_m / 100.0) * 100:.1f}, or more"
        problems.append(Problem("hold.radius_m", arrived, expected))
    return problems


def _speed_bounds(limits: Limits, conjunction: str) -> str:
    return (
        f"limits.speed_min_m_s ({format_number(limits.speed_min_m_s)} m/s) {conjunction} limits.speed_max_m_s "
        f"({format_number(limits.speed_max_m_s)} m/s)"
    )


def _limits_owner(scenario: ScenarioTables, aircraft: Aircraft) -> str:
    """Return the end of a message on airspeed limits: whose limits they are, and a remedy; empty if all share them."""
    if len({fleet_member.range for fleet_member in scenario.aircraft}) == 1:
        return ""
    remedy = "" if aircraft.airspeed_forms else "; aircraft[].speed_m_s gives an aircraft an airspeed of its own"
    return f", those of {aircraft.range.name}{remedy}"


def start_problems(scenario: ScenarioTables) -> list[Problem]:
    """List starts outside the limits of airspeed, altitude and climb rate."""
    problems = []
    for index, aircraft in enumerate(scenario.aircraft):
        path, start, limits = f"aircraft[{index}].start", aircraft.start, scenario.limits_for(aircraft)
        if not limits.speed_min_m_s <= start.airspeed_m_s <= limits.speed_max_m_s:
            expected = f"a speed from {_speed_bounds(limits, 'to')}"
            problems.append(Problem(f"{path}.{start.airspeed_key}", start.airspeed_text, expected, aircraft.label))
        for is_exceeded, bound, key, limit_m in (
            (start.altitude_m < limits.altitude_min_m, "at least", "altitude_min_m", limits.altitude_min_m),
            (start.altitude_m > limits.altitude_max_m, "at most", "altitude_max_m", limits.altitude_max_m),
        ):
            if is_exceeded:
                expected = f"{bound} limits.{key}, which is {format_number(limit_m)} m"
                problems.append(
                    Problem(f"{path}.altitude_m", format_number(start.altitude_m), expected, aircraft.label)
                )
        problems.extend(_climb_rate_problems(path, aircraft, start.path_angle_deg, start.airspeed_m_s, limits))
    return problems


def rendezvous_problems(scenario: ScenarioTables) -> list[Problem]:
    """List stand-offs below the minimum for the kind of goal, and arrivals beyond the limit of the climb rate.

    The goal of every aircraft must exist.
    """
    problems = []
    for index, aircraft in enumerate(scenario.aircraft):
        path, rendezvous = f"aircraft[{index}].rendezvous", aircraft.rendezvous
        is_surface, distance_m = scenario.goal_of(aircraft).kind == "surface", rendezvous.stand_off_distance_m
        if is_surface and rendezvous.stand_off_up_m < SURFACE_STAND_OFF_MIN_M:
            arrived = format_number(rendezvous.stand_off_up_m)
            expected = f'at least {SURFACE_STAND_OFF_MIN_M:g} m above the surface goal "{aircraft.goal}"; {_SCOPE}'
            problems.append(Problem(f"{path}.stand_off_up_m", arrived, expected, aircraft.label))
        if not is_surface and distance_m < AIRBORNE_STAND_OFF_MIN_M:
            expected = f'at least {AIRBORNE_STAND_OFF_MIN_M:g} m from the airborne goal "{aircraft.goal}"; {_SCOPE}'
            problems.append(Problem(path, f"a stand-off of {distance_m:.1f} m", expected, aircraft.label))
        if rendezvous.path_angle_deg is not None:
            speed_m_s, limits = scenario.speed_for(aircraft), scenario.limits_for(aircraft)
            problems.extend(_climb_rate_problems(path, aircraft, rendezvous.path_angle_deg, speed_m_s, limits))
    return problems


def margin_problems(scenario: ScenarioTables) -> list[Problem]:
    """List stand-offs that are too small for the uncertainty of the goal's position at the arrival.

    The least stand-off is the minimum for the kind of goal, plus `estimator.margin_sigma` standard deviations. The goal
    of every aircraft must exist.
    """
    sensor, estimator, navigation = scenario.goal_sensor, scenario.estimator, scenario.navigation
    problems = []
    for index, aircraft in enumerate(scenario.aircraft):
        is_airborne = scenario.goal_of(aircraft).kind == "airborne"
        stand_off_min_m = AIRBORNE_STAND_OFF_MIN_M if is_airborne else SURFACE_STAND_OFF_MIN_M
        distance_m = aircraft.rendezvous.stand_off_distance_m
        speed_m_s = scenario.speed_for(aircraft)
        sigma_m = goal_sigma_m(sensor, estimator, navigation, scenario.timing, speed_m_s, distance_m)
        required_m = stand_off_min_m + estimator.margin_sigma * sigma_m
        # a stand-off below the scope's minimum is reported elsewhere
        if sigma_m > 0.0 and stand_off_min_m <= distance_m < required_m:
            expected = (
                f"a stand-off of {math.ceil(required_m)} m or more: the {format_number(stand_off_min_m)} m of the "
                f"scope and estimator.margin_sigma = {format_number(estimator.margin_sigma)} standard deviations of "
                f"the goal's place at the arrival, which the sensor leaves at {sigma_m:.1f} m"
            )
            problems.append(Problem(f"aircraft[{index}].rendezvous", f"{distance_m:.1f} m", expected, aircraft.label))
    return problems


def goal_problems(scenario: ScenarioTables) -> list[Problem]:
    """List airborne goals that are ever below `AIRBORNE_ALTITUDE_MIN_M`, and surface goals with a climb rate."""
    problems = []
    for index, goal in enumerate(scenario.goal):
        if goal.kind == "surface":
            if goal.waypoints is None and goal.climb_rate_m_s:
                arrived, expected = format_number(goal.climb_rate_m_s), 'nothing, or 0, for a goal of kind = "surface"'
                problems.append(Problem(f"goal[{index}].climb_rate_m_s", arrived, expected, goal.label))
            continue
        expected = f'an airborne goal at {AIRBORNE_ALTITUDE_MIN_M:g} m or higher; for a lower one, kind = "surface"'
        bounds_m = AIRBORNE_ALTITUDE_MIN_M, math.inf
        problems.extend(_altitude_problems(index, goal, scenario.timing.duration_s, bounds_m, expected))
    return problems


def _altitude_problems(
    index: int, goal: Goal, duration_s: float, bounds_m: tuple[float, float], expected: str
) -> list[Problem]:
    """List problems, with the text `expected`, of goal number `index` whose altitude is ever beyond `bounds_m`."""
    low_m, high_m = bounds_m
    if goal.waypoints is not None:
        altitudes_m = {f"waypoints[{k}].altitude_m": point.altitude_m for k, point in enumerate(goal.waypoints)}
        arrived = {key: format_number(altitude_m) for key, altitude_m in altitudes_m.items()}
    elif low_m <= goal.altitude_m <= high_m:
        end_m, rate = goal.position_m(duration_s)[2], format_number(goal.climb_rate_m_s)
        altitudes_m = {"climb_rate_m_s": end_m}
        arrived = {"climb_rate_m_s": f"{rate}, which brings it to {end_m:.1f} m at the end of the flight"}
    else:
        altitudes_m, arrived = {"altitude_m": goal.altitude_m}, {"altitude_m": format_number(goal.altitude_m)}
    return [
        Problem(f"goal[{index}].{key}", arrived[key], expected, goal.label)
        for key, altitude_m in altitudes_m.items()
        if not low_m <= altitude_m <= high_m
    ]


def _climb_rate_problems(
    path: str, aircraft: Aircraft, angle_deg: float, speed_m_s: float, limits: Limits
) -> list[Problem]:
    """Return a problem if an aircraft at a path angle climbs or descends faster than `climb_rate_max_m_s`."""
    rate_m_s = speed_m_s * math.sin(math.radians(angle_deg))
    if abs(rate_m_s) <= limits.climb_rate_max_m_s:
        return []
    arrived = f"{format_number(angle_deg)}, a climb rate of {rate_m_s:.1f} m/s"
    expected = f"a climb rate within limits.climb_rate_max_m_s, which is {format_number(limits.climb_rate_max_m_s)} m/s"
    return [Problem(f"{path}.path_angle_deg", arrived, expected, aircraft.label)]


def planner_problems(scenario: ScenarioTables) -> list[Problem]:
    """List keys that the planner of the scenario does not support.

    If the file contains ``planner = "published"``, unsupported keys with their default values are accepted: a scenario
    recorded with all defaults loads again.
    """
    fleet = scenario.fleet
    if fleet.is_certified:
        expected = '"even", or fleet.planner = "published", which alone has such polynomials'
        arrived = f'"published" with fleet.planner "{fleet.planner}"'
        return [Problem("fleet.speed_profile", arrived, expected)] if fleet.speed_profile == "published" else []
    explicit = "planner" in fleet.model_fields_set
    certified_keys: list[tuple[str, Table, Iterable[str], str]] = [
        ("fleet", fleet, ("reserve",), ""),
        ("limits", scenario.limits, _CERTIFIED_LIMITS, ""),
        ("arrival", scenario.arrival, type(scenario.arrival).model_fields, ""),
        ("separation", scenario.separation, type(scenario.separation).model_fields, ""),
    ]
    for index, aircraft in enumerate(scenario.aircraft):
        certified_keys.append((f"aircraft[{index}]", aircraft, _CERTIFIED_AIRCRAFT_KEYS, aircraft.label))
    planner, expected = (
        'with fleet.planner "published"',
        'fleet.planner = "certified" beside it, which alone knows this key',
    )
    problems = []
    for path, table, keys, subject in certified_keys:
        for key in keys:
            value, default = getattr(table, key), type(table).model_fields[key].default
            if key in table.model_fields_set and not (explicit and value == default):
                problems.append(Problem(f"{path}.{key}", f"{format_value(value)} {planner}", expected, subject))
    if scenario.keep_out:
        problems.append(Problem("keep_out", f"a list of {len(scenario.keep_out)} {planner}", expected))
    return problems


def sounding_problems(scenario: ScenarioTables) -> list[Problem]:
    """List starts and altitudes of airborne goals that are below or above the levels of the sounding."""
    atmosphere = scenario.atmosphere
    if atmosphere is None or atmosphere.sounding is None:
        return []
    low_m, high_m = (atmosphere.sounding.level[k].altitude_m for k in (0, -1))
    expected = f"an altitude within the sounding, {format_number(low_m)} to {format_number(high_m)} m"
    problems = [
        Problem(f"aircraft[{k}].start.altitude_m", format_number(altitude_m), expected, aircraft.label)
        for k, aircraft in enumerate(scenario.aircraft)
        if not low_m <= (altitude_m := aircraft.start.altitude_m) <= high_m
    ]
    for k, goal in enumerate(scenario.goal):
        if goal.kind == "airborne":
            problems += _altitude_problems(k, goal, scenario.timing.duration_s, (low_m, high_m), expected)
    return problems


def gust_problems(scenario: ScenarioTables) -> list[Problem]:
    """List discrete gusts for aircraft that do not exist."""
    names = [aircraft.name for aircraft in scenario.aircraft]
    expected = f"the name of an aircraft of this scenario ({quoted_list(names)})"
    return [
        Problem(f"gust[{k}].aircraft", f'"{gust.aircraft}"', expected)
        for k, gust in enumerate(scenario.gust)
        if gust.aircraft not in (None, *names)
    ]


def sensing_problems(scenario: ScenarioTables) -> list[Problem]:
    """List sensor periods that are not whole numbers of integration steps; exact sensors have no period."""
    navigation, sensor, step_s = scenario.navigation, scenario.goal_sensor, scenario.timing.step_s
    periods_s = {}
    if navigation.sensors != "exact":
        periods_s["navigation.period_s"] = navigation.period_s
    if sensor.preset != "exact":
        periods_s["goal_sensor.period_s"] = sensor.number("period_s")
    return [
        Problem(path, format_number(period_s), multiple_message(period_s, "timing.step_s", step_s))
        for path, period_s in periods_s.items()
        if not is_multiple(period_s, step_s)
    ]


_ONCE = {
    "aircraft-leaves": ("leaves", "an aircraft that has not left"),
    "thrust-lost": ("loses thrust", "one loss of thrust for each aircraft; further changes by aircraft-changes"),
    "goal-sensor-lost": ("loses its goal sensor", "one loss of the sensor for each aircraft"),
}
"""Kinds of event that an aircraft can have once: verb, and expected events, for the message."""


def event_problems(scenario: ScenarioTables) -> list[Problem]:
    """List events without support by the planner, with unknown names, too late, or impossible for their aircraft.

    Impossible events are a second event of a kind in `_ONCE`, a loss of thrust or sensor after the aircraft has left,
    and a change of a surface or engine that the aircraft does not have.
    """
    events, duration_s, step_s, problems = scenario.event, scenario.timing.duration_s, scenario.timing.step_s, []
    if scenario.planned_events and scenario.fleet.planner == "published":
        expected = 'no events, or fleet.planner = "certified": only that planner plans on after them'
        return [Problem("event", f'{len(scenario.planned_events)} with fleet.planner = "published"', expected)]
    former: dict[tuple[str, str], int] = {}  # index of the event by kind and aircraft
    for index, event in enumerate(events):
        path = f"event[{index}]"
        for key, kind, items in (("aircraft", "an aircraft", scenario.aircraft), ("goal", "a goal", scenario.goal)):
            name, names = getattr(event, key), [item.name for item in items]
            if name not in (None, *names):
                expected = f"the name of {kind} of this scenario ({quoted_list(names)})"
                problems.append(Problem(f"{path}.{key}", f'"{name}"', expected))
        # an event takes effect at the first sample at or after its time
        if math.ceil(round(event.time_s / step_s, 6)) >= round(duration_s / step_s):
            expected = f"a time before the last step of the flight, timing.duration_s = {format_number(duration_s)} s"
            problems.append(Problem(f"{path}.time_s", format_number(event.time_s), expected))
        if event.kind in _ONCE and event.aircraft is not None:
            verb, expected = _ONCE[event.kind]
            if (event.kind, event.aircraft) in former:
                arrived = f'"{event.aircraft}", which {verb} by event[{former[event.kind, event.aircraft]}] already'
                problems.append(Problem(f"{path}.aircraft", arrived, expected))
            former[event.kind, event.aircraft] = index
        gone = next((e for e in events if (e.kind, e.aircraft) == ("aircraft-leaves", event.aircraft)), None)
        if event.kind in ("thrust-lost", "goal-sensor-lost") and gone is not None and gone.time_s <= event.time_s:
            arrived = f'"{event.aircraft}", which has left at {format_number(gone.time_s)} s'
            problems.append(Problem(f"{path}.aircraft", arrived, _ONCE["aircraft-leaves"][1]))
        if event.deviation is not None:
            changed = [aircraft for aircraft in scenario.aircraft if aircraft.name == event.aircraft]
            problems += [
                Problem(f"{path}.{problem.path}", problem.arrived, problem.expected, aircraft.label)
                for aircraft in changed
                for problem in aircraft.change_problems(event.deviation)
            ]
    return problems


def excitation_problems(scenario: ScenarioTables) -> list[Problem]:
    """List test inputs with an unknown aircraft or input, a start after the flight, or a too high frequency.

    If the controller is user-defined, test inputs to commands between the autopilot's loops are also problems.
    """
    timing, problems = scenario.timing, []
    names = [aircraft.name for aircraft in scenario.aircraft]
    for index, excitation in enumerate(scenario.excitation):
        path = f"excitation[{index}]"
        if excitation.aircraft not in (None, *names):
            expected = f"the name of an aircraft of this scenario ({quoted_list(names)})"
            problems.append(Problem(f"{path}.aircraft", f'"{excitation.aircraft}"', expected))
        excited = [aircraft for aircraft in scenario.aircraft if excitation.aircraft in (None, aircraft.name)]
        for k, name in enumerate(excitation.inputs):
            unfit = [a for a in excited if a.surfaces is not None and name not in (*a.surfaces, *EXCITED_INPUTS)]
            if unfit:
                expected = f"an input of it: {', '.join((*(unfit[0].surfaces or ()), *EXCITED_INPUTS))}"
                problems.append(Problem(f"{path}.inputs[{k}]", f'"{name}"', expected, unfit[0].label))
        if excitation.start_s >= timing.duration_s:
            expected = f"a time before the end of the flight, timing.duration_s = {format_number(timing.duration_s)} s"
            problems.append(Problem(f"{path}.start_s", format_number(excitation.start_s), expected))
        if excitation.width_s is not None and excitation.width_s < timing.step_s:
            expected = f"at least timing.step_s, {format_number(timing.step_s)} s"
            problems.append(Problem(f"{path}.width_s", format_number(excitation.width_s), expected))
        highest_hz = 0.0 if excitation.frequencies_hz is None else excitation.frequencies_hz[1]
        if highest_hz > 0.5 / timing.step_s:
            expected = f"at most {format_number(0.5 / timing.step_s)} Hz, half the rate of the samples"
            problems.append(Problem(f"{path}.frequencies_hz[1]", format_number(highest_hz), expected))
        loops = [name for name in excitation.inputs if name in LOOP_INPUTS]
        if loops and scenario.parts is not None and scenario.parts.controller is not None:
            arrived = f'"{loops[0]}" beside a user-defined controller'
            expected = "a surface, the throttle, or a command of the path: the controller may have no such loop"
            problems.append(Problem(f"{path}.inputs", arrived, expected))
    return problems


def network_problems(scenario: ScenarioTables) -> list[Problem]:
    """List a network that the planner does not use, and settings that the decentralised planner does not support."""
    network, fleet, rule = scenario.network, scenario.fleet, scenario.arrival.rule
    if fleet.is_central:
        expected = 'no [network], or fleet.planner = "decentralised": nobody else talks over it'
        arrived = f'a table with fleet.planner = "{fleet.planner}"'
        return [] if network is None else [Problem("network", arrived, expected)]
    problems, count = [], len(scenario.aircraft)
    if count > DECENTRALISED_AIRCRAFT_MAX:
        problems.append(Problem("aircraft", f"{count} without a centre", f"at most {DECENTRALISED_AIRCRAFT_MAX}"))
    if rule not in _DECENTRALISED_RULES:
        expected = f"{quoted_list(_DECENTRALISED_RULES, ' or ')}: what aircraft can agree on without a centre"
        problems.append(Problem("arrival.rule", f'"{rule}" with fleet.planner = "decentralised"', expected))
    for index, event in enumerate(scenario.event):
        if event.kind not in _DECENTRALISED_EVENTS:
            expected = f'{quoted_list(_DECENTRALISED_EVENTS, " or ")}, or fleet.planner = "certified"'
            problems.append(Problem(f"event[{index}].kind", f'"{event.kind}" without a centre', expected))
    return problems + _network_number_problems(network or Network(), scenario)


def _network_number_problems(network: Network, scenario: ScenarioTables) -> list[Problem]:
    fleet, timing = scenario.fleet, scenario.timing
    problems, multiple = [], network.period_s / timing.step_s
    if abs(multiple - round(multiple)) > 1e-6 or round(multiple) < 1:
        expected = multiple_message(network.period_s, "timing.step_s", timing.step_s)
        problems.append(Problem("network.period_s", format_number(network.period_s), expected))
    delayed = network.delay_s / network.period_s
    if abs(delayed - round(delayed)) > 1e-6:
        expected = multiple_message(network.delay_s, "period_s", network.period_s)
        problems.append(Problem("network.delay_s", format_number(network.delay_s), expected))
    if timing.replan_period_s <= 0.0:
        expected = "a period above 0: what the others say is answered when the plan is renewed"
        problems.append(Problem("timing.replan_period_s", format_number(timing.replan_period_s), expected))
    greatest = min(
        greatest_rate_range(
            fleet.reserve, scenario.speed_for(aircraft), scenario.limits_for(aircraft), scenario.wind.speed_max_m_s
        )
        for aircraft in scenario.aircraft
    )
    return problems + rate_range_problems(network.rate_range, fleet.reserve, greatest)
