"""Scenario table for a fleet without a centre: radio range, message losses, and the coordination of the clocks."""

import math
from typing import TYPE_CHECKING

from anser.config.errors import Problem, format_number
from anser.config.tables import Table, number
from anser.scenario.schema_settings import Fleet, Limits, multiple_message

if TYPE_CHECKING:
    from anser.scenario.schema import Scenario

AIRCRAFT_MAX = 30
"""Greatest number of aircraft in a fleet without a centre."""
RULES = ("together", "at", "times", "sequence")
EVENTS = ("goal-sensor-lost", "thrust-lost", "goal-stops", "goal-turns")


class Network(Table):
    """Communication in a fleet without a centre (fleet.planner = "decentralised")."""

    range_m: float = number(
        "greatest distance over which two aircraft hear each other", 0, 1e7, "m", 50_000.0, exclusive_minimum=True
    )
    period_s: float = number("time between two broadcasts of an aircraft", 0, 10, "s", 0.1, exclusive_minimum=True)
    delay_s: float = number("delay of a message", 0, 10, "s", 0.0)
    loss: float = number("fraction of the messages between two aircraft that are lost, independently", 0, 1, "", 0.0)
    outage_share: float = number("fraction of the time in which a link is out", 0, 0.99, "", 0.0)
    outage_mean_s: float = number("mean duration of a link outage", 0, 600, "s", 5.0, exclusive_minimum=True)
    agree_within_s: float = number("time before the start for agreement on the first plan", 1, 600, "s", 60.0)
    coupling_per_s: float = number(
        "rate of convergence of the clocks if all aircraft hear each other", 0, 2, "1/s", 0.2, exclusive_minimum=True
    )
    damping_per_s: float = number("rate at which a clock rate returns to 1", 0, 10, "1/s", 1.0, exclusive_minimum=True)
    waiting_per_s2: float = number("slowdown of a clock for each second behind the path", 0, 1, "1/s^2", 0.1)
    rate_range: float = number("greatest deviation of a clock rate from 1", 0, 0.1, "", 0.03, exclusive_minimum=True)
    skew_max_s: float = number(
        "greatest difference of two clocks, allowed for in the separation", 0, 5, "s", 0.5, exclusive_minimum=True
    )
    tube_m: float = number(
        "greatest deviation of an aircraft from its last broadcast path", 0, 1_000, "m", 25.0, exclusive_minimum=True
    )
    window_s: float = number(
        "time window for the network's quality of service", 0, 600, "s", 5.0, exclusive_minimum=True
    )

    def consistency_problems(self) -> list[Problem]:
        """List a clock coupling that oscillates."""
        greatest = 0.25 * self.damping_per_s
        if self.coupling_per_s <= greatest:
            return []
        expected = f"at most {format_number(greatest)} 1/s, a quarter of damping_per_s: beyond that the clocks swing"
        return [Problem("coupling_per_s", format_number(self.coupling_per_s), expected)]


def network_problems(scenario: "Scenario") -> list[Problem]:
    """List a network that no planner uses, and settings that a fleet without a centre does not support."""
    network, fleet, aircraft, arrival = scenario.network, scenario.fleet, scenario.aircraft, scenario.arrival
    if fleet.planner != "decentralised":
        expected = 'no [network], or fleet.planner = "decentralised": nobody else talks over it'
        return (
            [] if network is None else [Problem("network", f'a table with fleet.planner = "{fleet.planner}"', expected)]
        )
    problems = []
    if len(aircraft) > AIRCRAFT_MAX:
        problems.append(Problem("aircraft", f"{len(aircraft)} without a centre", f"at most {AIRCRAFT_MAX}"))
    if arrival.rule not in RULES:
        expected = " or ".join(f'"{rule}"' for rule in RULES) + ": what aircraft can agree on without a centre"
        problems.append(Problem("arrival.rule", f'"{arrival.rule}" with fleet.planner = "decentralised"', expected))
    for index, event in enumerate(scenario.event):
        if event.kind not in EVENTS:
            expected = " or ".join(f'"{kind}"' for kind in EVENTS) + ', or fleet.planner = "certified"'
            problems.append(Problem(f"event[{index}].kind", f'"{event.kind}" without a centre', expected))
    return [*problems, *_number_problems(network or Network(), scenario)]


def _number_problems(network: Network, scenario: "Scenario") -> list[Problem]:
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
    greatest = greatest_rate_range(fleet, scenario.limits, scenario.wind.speed_max_m_s)
    if network.rate_range > greatest:
        expected = (
            f"at most {format_number(math.floor(1e4 * greatest) / 1e4)}: what fleet.reserve = "
            f"{format_number(fleet.reserve)} leaves of "
            "the limits, for a path that is flown faster or more slowly"
        )
        problems.append(Problem("network.rate_range", format_number(network.rate_range), expected))
    return problems


def greatest_rate_range(fleet: Fleet, limits: Limits, wind_m_s: float) -> float:
    """Return the greatest deviation of a clock rate from 1 for which a plan with the reserve keeps its limits.

    Accelerations scale with the square of the clock rate; the tangent of the bank angle grows at least in proportion to
    the angle. The clock rate scales the velocity over the ground; the wind speed is at most `wind_m_s`.
    """
    reserve, speed = fleet.reserve, fleet.speed_m_s
    turning = math.sqrt(1.0 / (1.0 - reserve)) - 1.0
    slow = limits.speed_min_m_s + reserve * (speed - limits.speed_min_m_s)
    fast = limits.speed_max_m_s - reserve * (limits.speed_max_m_s - speed)
    slower = (slow - limits.speed_min_m_s) / (slow + wind_m_s)
    faster = (limits.speed_max_m_s - fast) / (fast + wind_m_s)
    return min(turning, slower, faster, reserve)
