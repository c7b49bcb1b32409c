"""Descending arrivals of 150 random tasks, planned as published: no aircraft may hit the ground.

Not part of the ordinary tests (which contain a few of the tasks: tests/simulation/test_descents.py). The trial takes
about a quarter of an hour; it prints every task with its verdict, and a summary of the announced plans by reason.
"""

from collections import Counter

from anser.planning.limits import LIMIT_MESSAGES
from anser.planning.published.coordination import PLAN_MESSAGES
from support.descents import flown_descent

SEEDS = range(150)


def test_no_aircraft_reaches_the_ground():
    statuses, reasons, refused = Counter(), Counter(), 0
    for seed in SEEDS:
        result = flown_descent(seed)
        print(result, flush=True)
        statuses.update(result["status"])
        reasons.update(result["problems"])
        refused += bool(result["problems"])
        assert set(result["problems"]) <= {*LIMIT_MESSAGES, *PLAN_MESSAGES}
        assert not result["met"] or set(result["status"]) == {"arrived"}
    print(f"{refused} of {len(SEEDS)} plans announced as not flyable; aircraft by reason:")
    for counts in (reasons, statuses):
        print("\n".join(f"{count:4d}  {message}" for message, count in counts.most_common()), end="\n\n")
    assert not any("reached the ground" in message for message in statuses)
