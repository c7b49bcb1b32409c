"""The shortest time to a moving point: an interception, and the first."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.scenario.schema_reach import time_to_go_s

component = st.floats(-200.0, 200.0)
distance = st.floats(-2e4, 2e4)


@given(
    st.tuples(distance, distance, distance).filter(lambda r: math.hypot(*r) > 1.0),
    st.tuples(component, component, component),
    st.floats(50.0, 300.0),
)
@settings(deadline=None, max_examples=50)
def test_time_to_go_is_the_first_interception(relative, velocity, speed) -> None:
    time_s = time_to_go_s(relative, velocity, speed)

    def gap_m(t: float) -> float:
        return math.hypot(*(r + w * t for r, w in zip(relative, velocity, strict=True))) - speed * t

    if time_s is None:
        # never within reach (theory section 7): the gap stays open at all times looked at
        assert all(gap_m(t) > 0 for t in (1.0, 10.0, 100.0, 1e3, 1e4, 1e6))
        return
    # the path flown until then, to the rounding of distances that long
    assert abs(gap_m(time_s)) <= 1e-8 * (math.hypot(*relative) + (math.hypot(*velocity) + speed) * time_s)
    assert all(gap_m(share * time_s) > -1e-8 * speed * time_s for share in (0.1, 0.5, 0.9))


def test_time_to_go_equals_hand_calculations() -> None:
    # standing: distance/speed; equal speeds, head on: closing at twice the speed; equal speeds, tail chase: never
    assert time_to_go_s((3000.0, 4000.0, 0.0), (0.0, 0.0, 0.0), 100.0) == 50.0
    assert time_to_go_s((1000.0, 0.0, 0.0), (-100.0, 0.0, 0.0), 100.0) == 5.0
    assert time_to_go_s((1000.0, 0.0, 0.0), (100.0, 0.0, 0.0), 100.0) is None
    # faster than the aircraft but coming: (2 V, V): 1000/(300) s
    assert time_to_go_s((1000.0, 0.0, 0.0), (-200.0, 0.0, 0.0), 100.0) == pytest.approx(1000.0 / 300.0, rel=1e-14)
