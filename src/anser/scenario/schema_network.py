"""The table of a scenario for a fleet without a centre: who hears whom, and how the clocks are kept together."""

import math
from collections.abc import Sequence

from anser.config.errors import Problem, format_number
from anser.config.tables import Table, number
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_airspace import Arrival
from anser.scenario.schema_event import Event
from anser.scenario.schema_settings import Fleet, Limits, Timing, multiple_message

AIRCRAFT_MAX = 30
"""Most aircraft of a fleet without a centre."""
RULES = ("together", "at", "times", "sequence")
EVENTS = ("goal-sensor-lost", "thrust-lost", "goal-stops", "goal-turns")


class Network(Table):
    """How the aircraft of a fleet without a centre (fleet.planner = "decentralised") talk to each other."""

    range_m: float = number(
        "greatest distance over which two aircraft hear each other", 0, 1e7, "m", 50_000.0, exclusive_minimum=True
    )
    period_s: float = number("between two broadcasts of an aircraft", 0, 10, "s", 0.1, exclusive_minimum=True)
    delay_s: float = number("until a message arrives", 0, 10, "s", 0.0)
    loss: float = number("part of the exchanges between two aircraft that fail, each by itself", 0, 1, "", 0.0)
    outage_share: float = number("part of the time that a link is out altogether", 0, 0.99, "", 0.0)
    outage_mean_s: float = number("mean duration of such an outage", 0, 600, "s", 5.0, exclusive_minimum=True)
    agree_within_s: float = number("how long before the start the fleet may talk about its plan", 1, 600, "s", 60.0)
    coupling_per_s: float = number(
        "how fast the clocks agree where all hear all", 0, 2, "1/s", 0.2, exclusive_minimum=True
    )
    damping_per_s: float = number(
        "how fast the rate of a clock returns to 1", 0, 10, "1/s", 1.0, exclusive_minimum=True
    )
    waiting_per_s2: float = number("how much a clock slows down for each second behind the path", 0, 1, "1/s^2", 0.1)
    rate_range: float = number(
        "by how much the rate of a clock may differ from 1", 0, 0.1, "", 0.03, exclusive_minimum=True
    )
    skew_max_s: float = number(
        "by how much two clocks may differ; the separation reckons with it", 0, 5, "s", 0.5, exclusive_minimum=True
    )
    tube_m: float = number(
        "how far an aircraft may depart from the path that the others know", 0, 1_000, "m", 25.0, exclusive_minimum=True
    )
    window_s: float = number(
        "over which the network's quality of service is judged", 0, 600, "s", 5.0, exclusive_minimum=True
    )

    def consistency_problems(self) -> list[Problem]:
        """Find a law that swings."""
        greatest = 0.25 * self.damping_per_s
        if self.coupling_per_s <= greatest:
            return []
        words = f"at most {format_number(greatest)} 1/s, a quarter of damping_per_s: beyond that the clocks swing"
        return [Problem("coupling_per_s", format_number(self.coupling_per_s), words)]


def network_problems(
    network: Network | None,
    fleet: Fleet,
    limits: Limits,
    timing: Timing,
    arrival: Arrival,
    aircraft: Sequence[Aircraft],
    events: Sequence[Event],
    wind_m_s: float,
) -> list[Problem]:
    """Find a network that nobody belongs to, and what a fleet without a centre cannot do."""
    if fleet.planner != "decentralised":
        words = 'no [network], or fleet.planner = "decentralised": nobody else talks over it'
        return [] if network is None else [Problem("network", f'a table with fleet.planner = "{fleet.planner}"', words)]
    found = []
    if len(aircraft) > AIRCRAFT_MAX:
        found.append(Problem("aircraft", f"{len(aircraft)} without a centre", f"at most {AIRCRAFT_MAX}"))
    if arrival.rule not in RULES:
        words = " or ".join(f'"{rule}"' for rule in RULES) + ": what aircraft can agree on without a centre"
        found.append(Problem("arrival.rule", f'"{arrival.rule}" with fleet.planner = "decentralised"', words))
    for index, event in enumerate(events):
        if event.kind not in EVENTS:
            words = " or ".join(f'"{kind}"' for kind in EVENTS) + ', or fleet.planner = "certified"'
            found.append(Problem(f"event[{index}].kind", f'"{event.kind}" without a centre', words))
    return [*found, *_number_problems(network or Network(), fleet, limits, timing, wind_m_s)]


def _number_problems(network: Network, fleet: Fleet, limits: Limits, timing: Timing, wind_m_s: float) -> list[Problem]:
    found, multiple = [], network.period_s / timing.step_s
    if abs(multiple - round(multiple)) > 1e-6 or round(multiple) < 1:
        words = multiple_message(network.period_s, "timing.step_s", timing.step_s)
        found.append(Problem("network.period_s", format_number(network.period_s), words))
    delayed = network.delay_s / network.period_s
    if abs(delayed - round(delayed)) > 1e-6:
        words = multiple_message(network.delay_s, "period_s", network.period_s)
        found.append(Problem("network.delay_s", format_number(network.delay_s), words))
    if timing.replan_period_s <= 0.0:
        words = "a period above 0: what the others say is answered when the plan is renewed"
        found.append(Problem("timing.replan_period_s", format_number(timing.replan_period_s), words))
    greatest = greatest_rate_range(fleet, limits, wind_m_s)
    if network.rate_range > greatest:
        words = (
            f"at most {format_number(math.floor(1e4 * greatest) / 1e4)}: what fleet.reserve = "
            f"{format_number(fleet.reserve)} leaves of "
            "the limits, for a path that is flown faster or more slowly"
        )
        found.append(Problem("network.rate_range", format_number(network.rate_range), words))
    return found


def greatest_rate_range(fleet: Fleet, limits: Limits, wind_m_s: float) -> float:
    """By how much a clock's rate may differ from 1 so that the limits are kept that a plan leaves a reserve of.

    Accelerations go with the square of the rate; the tangent of the bank angle grows at least as the angle does. What
    the rate changes is the velocity over the ground, in a wind of at most `wind_m_s`.
    """
    reserve, speed = fleet.reserve, fleet.speed_m_s
    turning = math.sqrt(1.0 / (1.0 - reserve)) - 1.0
    slow = limits.speed_min_m_s + reserve * (speed - limits.speed_min_m_s)
    fast = limits.speed_max_m_s - reserve * (limits.speed_max_m_s - speed)
    slower = (slow - limits.speed_min_m_s) / (slow + wind_m_s)
    faster = (limits.speed_max_m_s - fast) / (fast + wind_m_s)
    return min(turning, slower, faster, reserve)
