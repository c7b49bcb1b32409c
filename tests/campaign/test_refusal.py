"""What a refusal says of single aircraft: not that one has no way, where the search found it one."""

from types import SimpleNamespace

import numpy as np
import pytest

from anser.campaign import refusal
from anser.planning.certified import ArrivalRequest, Outcome

NAMES = ("alpha", "bravo", "charlie")
WINDOWS = ArrivalRequest("windows", 600.0, windows_s=np.array([[90.0, 95.0]] * 3))
AT = ArrivalRequest("at", 600.0, times_s=np.full(3, 92.0))


@pytest.fixture(autouse=True)
def no_limit_named(monkeypatch):
    monkeypatch.setattr(refusal, "_binding", lambda *about: "")


def outcome(valid, kept):
    closest = SimpleNamespace(valid=np.array(valid), certificate=SimpleNamespace(kept_alone=np.array(kept)))
    return Outcome(None, 3, closest)


@pytest.mark.parametrize("request_", [WINDOWS, AT], ids=["windows", "at"])
def test_a_way_that_was_found_is_not_denied(request_):
    arrivals = [[], [(120.0, 600.0)], [(80.0, 600.0)]]
    denied = refusal._alone(NAMES, None, None, request_, arrivals, Outcome(None, 3))
    assert len(denied) == 2
    assert '"alpha" cannot arrive' in denied[0]
    assert '"bravo" cannot arrive' in denied[1]
    assert "by itself it can from 120.0 to 600.0 s" in denied[1]
    # The search found bravo a way, and alpha one that its certificate turned down.
    (left,) = refusal._alone(NAMES, None, None, request_, arrivals, outcome([True, True, True], [False, True, True]))
    assert '"alpha" cannot arrive' in left
