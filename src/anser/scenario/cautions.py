"""Cautions: settings of a valid scenario that probably do not work as intended; they are reported, not refused."""

import math

from anser.control.loop_separations import LOOP_SEPARATION_MIN, LoopSeparation, loop_separations
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import AttitudeGains, RateGains, VelocityGains
from anser.scenario.schema_reach import reach_problems
from anser.scenario.schema_tables import DEFAULT_PLANNERS, FORMAT
from anser.scenario.unused_keys import unused_key_cautions


def find_cautions(scenario: Scenario, *, with_trim_maps: bool = True) -> tuple[str, ...]:
    """Return the cautions about a scenario, one sentence each; empty if there are none.

    `with_trim_maps` True: limits and gains are compared with the trim map of each aircraft, which takes seconds the
    first time.
    """
    limits = _limit_cautions(scenario) if with_trim_maps else []
    return (
        *_format_cautions(scenario),
        *_seed_cautions(scenario),
        *_duration_cautions(scenario),
        *_separation_cautions(scenario),
        *unused_key_cautions(scenario),
        *limits,
        *_gain_cautions(scenario, with_trim_maps),
    )


def _format_cautions(scenario: Scenario) -> list[str]:
    """Return a caution for a file of an older format without `fleet.planner`, because the formats' defaults differ."""
    if scenario.format == FORMAT or "planner" in scenario.fleet.model_fields_set:
        return []
    format_default, current_default = DEFAULT_PLANNERS[scenario.format], DEFAULT_PLANNERS[FORMAT]
    return [
        f'fleet.planner: left out in a file of format {scenario.format}, which means "{format_default}"; the default '
        f'of format {FORMAT} is "{current_default}", whose plans keep limits and separation: anser convert writes the '
        f"file in format {FORMAT}, and the planner into it"
    ]


def _seed_cautions(scenario: Scenario) -> list[str]:
    """Return a caution for a seed other than the default in a scenario without random numbers."""
    is_random = scenario.is_random or scenario.parts is not None
    if scenario.seed == type(scenario).model_fields["seed"].default or is_random:
        return []
    random_tables = "[turbulence], [navigation] and [goal_sensor] are what is"
    return [f"seed: {scenario.seed} is recorded and changes nothing: nothing in this flight is random; {random_tables}"]


def _duration_cautions(scenario: Scenario) -> list[str]:
    """Return cautions if the duration suffices only with a descent or another altitude's wind; none in a wind field."""
    if scenario.wind.field is not None:  # the checks do not read the field
        return []
    return [
        f"{problem.path}: {problem.arrived} s suffices only if a descent makes the plan faster or another wind carries "
        f"it on; otherwise expected {problem.expected}"
        for problem in reach_problems(scenario, unaided=True)
        if problem.path == "timing.duration_s"
    ]


def _separation_cautions(scenario: Scenario) -> list[str]:
    """Return a caution for two or more aircraft without any separation requirement."""
    if scenario.requires_separation or len(scenario.aircraft) == 1:
        return []
    remedy = "[separation] horizontal_m"
    if not scenario.fleet.is_certified:
        remedy = f'requirements.separation_min_m, or fleet.planner = "certified" and {remedy}'
    count = len(scenario.aircraft)
    return [f"separation: nothing keeps the {count} aircraft apart, and no flight is judged by it; expected {remedy}"]


_TRIM_MAP_KEYS = {"speed_min_m_s", "speed_max_m_s", "bank_max_deg", "climb_rate_max_m_s"}


def _limit_cautions(scenario: Scenario) -> list[str]:
    """Return cautions for limits in the file that an aircraft cannot reach; the library's F-16 is not checked."""
    is_derived = not all(aircraft.is_library_f16 for aircraft in scenario.aircraft)
    if not is_derived or not _TRIM_MAP_KEYS & scenario.limits.model_fields_set:
        return []
    from anser.scenario.build_aircraft import capability_cautions  # here, because it imports JAX

    return list(capability_cautions(scenario))


_LOOPS = ("rates", "attitude", "velocity")


def _gain_cautions(scenario: Scenario, with_trim_maps: bool) -> list[str]:
    """Return cautions about nested loops with bandwidths too close together, for aircraft with gains in the file."""
    return [
        f'aircraft[{index}].gains (aircraft "{aircraft.name}"): the loop of {pair.outer} has a bandwidth of '
        f"{pair.outer_bandwidth:.3g} 1/s and rests on {pair.inner} with {pair.inner_bandwidth:.3g} 1/s, a "
        f"ratio of {pair.ratio:.2f}; below {LOOP_SEPARATION_MIN:g} the two swing against each other (damping "
        f"{0.5 * math.sqrt(pair.ratio):.2f})"
        for index, aircraft in enumerate(scenario.aircraft)
        for pair in _loop_separations(scenario, index, with_trim_maps)
        if pair.ratio < LOOP_SEPARATION_MIN
    ]


def _loop_separations(scenario: Scenario, index: int, with_trim_maps: bool) -> tuple[LoopSeparation, ...]:
    """Return the nested loops of aircraft number `index`; empty if the file gives the gains of no loop.

    If `with_trim_maps` is False, bandwidths that follow from a trim map are NaN.
    """
    aircraft = scenario.aircraft[index]
    written = aircraft.gains.model_fields_set.intersection(_LOOPS)
    if not written:
        return ()
    if aircraft.is_library_f16:
        gains = aircraft.gains
        return loop_separations(_bandwidths(gains.rates), _bandwidths(gains.attitude), _bandwidths(gains.velocity))
    if with_trim_maps:
        from anser.scenario.build_aircraft import resolved_loop_separations  # here, because it imports JAX

        return resolved_loop_separations(scenario, index)
    unknown = (math.nan,) * 3  # causes no caution
    rates, attitude, velocity = (
        _bandwidths(getattr(aircraft.gains, loop)) if loop in written else unknown for loop in _LOOPS
    )
    return loop_separations(rates, attitude, velocity, actuators=math.nan, engine=math.nan)


def _bandwidths(loop: RateGains | AttitudeGains | VelocityGains) -> tuple[float, ...]:
    """Return the bandwidth of each channel of a loop, 1/s: `bandwidth_rad_s`, or K_P / (1 + K_D) if it is None."""
    if loop.bandwidth_rad_s is not None:
        return loop.bandwidth_rad_s
    return tuple(gain / (1.0 + derivative) for gain, derivative in zip(loop.proportional, loop.derivative, strict=True))
