"""What a valid scenario had better not do: said, not refused."""

import math

from anser.scenario.schema import DEFAULT_PLANNERS, FORMAT, Scenario
from anser.scenario.schema_aircraft import Aircraft, Gains
from anser.scenario.schema_reach import reach_problems
from anser.scenario.unused_keys import unused_key_cautions


def find_cautions(scenario: Scenario, *, with_trim_maps: bool = True) -> tuple[str, ...]:
    """Say what will probably not work as meant, one sentence each; empty where nothing is to be said.

    Parameters
    ----------
    scenario
        The scenario.
    built
        Whether the aircraft are built and their trim maps computed for it, which takes seconds the first time.
    """
    gains = [text for index, one in enumerate(scenario.aircraft) for text in _gain_cautions(index, one)]
    limits = _limit_cautions(scenario) if with_trim_maps else []
    return (
        *_format_cautions(scenario),
        *_seed_cautions(scenario),
        *_duration_cautions(scenario),
        *_separation_cautions(scenario),
        *unused_key_cautions(scenario),
        *limits,
        *gains,
    )


def _format_cautions(scenario: Scenario) -> list[str]:
    """A file of before that leaves the planner to the default, which is another one now."""
    if scenario.format == FORMAT or "planner" in scenario.fleet.model_fields_set:
        return []
    meant, now = DEFAULT_PLANNERS[scenario.format], DEFAULT_PLANNERS[FORMAT]
    return [
        f'fleet.planner: left out in a file of format {scenario.format}, which means "{meant}"; the default of format '
        f'{FORMAT} is "{now}", whose plans keep limits and separation: anser convert writes the file in format '
        f"{FORMAT}, and the planner into it"
    ]


def _seed_cautions(scenario: Scenario) -> list[str]:
    """A seed that was chosen in the belief that it changes something."""
    if scenario.seed == type(scenario).model_fields["seed"].default or scenario.is_random:
        return []
    words = "[turbulence], [navigation] and [goal_sensor] are what is"
    return [f"seed: {scenario.seed} is recorded and changes nothing: nothing in this flight is random; {words}"]


def _duration_cautions(scenario: Scenario) -> list[str]:
    """A flight that lasts long enough only if something helps, which only planning and flying tell."""
    return [
        f"{one.path}: {one.arrived} s suffices only if a descent makes the plan faster or another wind carries it on; "
        f"otherwise expected {one.expected}"
        for one in reach_problems(scenario, unaided=True)
        if one.path == "timing.duration_s"
    ]


def _separation_cautions(scenario: Scenario) -> list[str]:
    """A fleet whose aircraft may come as near to each other as they like."""
    if scenario.requires_separation or len(scenario.aircraft) == 1:
        return []
    remedy = "[separation] horizontal_m"
    if not scenario.fleet.is_certified:
        remedy = f'requirements.separation_min_m, or fleet.planner = "certified" and {remedy}'
    count = len(scenario.aircraft)
    return [f"separation: nothing keeps the {count} aircraft apart, and no flight is judged by it; expected {remedy}"]


_TRIM_MAP_KEYS = {"speed_min_m_s", "speed_max_m_s", "bank_max_deg", "climb_rate_max_m_s"}


def _limit_cautions(scenario: Scenario) -> list[str]:
    """Limits that are given and lie beyond what an aircraft can do; left out, they follow from its trim map."""
    is_own = any(one.airframe is not None or one.type != "f16" for one in scenario.aircraft)
    if not is_own or not _TRIM_MAP_KEYS & scenario.limits.model_fields_set:
        return []
    from anser.scenario.build_aircraft import capability_cautions  # here: it loads JAX, which most scenarios do without

    return list(capability_cautions(scenario))


def _gain_cautions(index: int, aircraft: Aircraft) -> list[str]:
    """Loops too close to those that they rest on; the published gains are far enough apart."""
    if aircraft.gains == Gains():
        return []
    from anser.control.gains import (  # here: it loads JAX, which most scenarios do without
        LOOP_SEPARATION_MIN,
        loop_separations,
    )
    from anser.scenario.build_aircraft import build_gains

    found = []
    for pair in loop_separations(build_gains(aircraft)):
        ratio = float(pair.ratio)
        if ratio < LOOP_SEPARATION_MIN:
            found.append(
                f'aircraft[{index}].gains (aircraft "{aircraft.name}"): the loop of {pair.outer} has a bandwidth '
                f"of {float(pair.outer_bandwidth):.3g} 1/s and rests on {pair.inner} with "
                f"{float(pair.inner_bandwidth):.3g} 1/s, a ratio of {ratio:.2f}; below {LOOP_SEPARATION_MIN:g} the two "
                f"swing against each other (damping {0.5 * math.sqrt(ratio):.2f})"
            )
    return found
