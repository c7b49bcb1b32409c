"""A hundred random tasks and fifty milder ones: descending arrivals, planned as published; none may reach the ground.

Not part of the ordinary tests (a few of the tasks are: tests/simulation/test_descents.py). It takes a quarter of an
hour or so; every task is printed with its verdict, and at the end what the plans were announced as, by reason.
"""

from collections import Counter

from anser.planning.limits import LIMIT_MESSAGES
from anser.planning.published.coordination import PLAN_MESSAGES
from support.descents import flown_descent

SEEDS = range(150)


def test_none_reaches_the_ground():
    fates, reasons, refused = Counter(), Counter(), 0
    for seed in SEEDS:
        found = flown_descent(seed)
        print(found, flush=True)
        fates.update(found["status"])
        reasons.update(found["problems"])
        refused += bool(found["problems"])
        assert set(found["problems"]) <= {*LIMIT_MESSAGES, *PLAN_MESSAGES}
        assert not found["met"] or set(found["status"]) == {"arrived"}
    print(f"{refused} of {len(SEEDS)} plans announced as not flyable; aircraft by reason:")
    for counted in (reasons, fates):
        print("\n".join(f"{count:4d}  {words}" for words, count in counted.most_common()), end="\n\n")
    assert not any("reached the ground" in words for words in fates)
