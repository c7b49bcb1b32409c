"""Refusal messages about single aircraft: an aircraft with a path from the search is not called infeasible."""

import dataclasses
import math
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser import load
from anser.config.shipped_files import shipped_files
from anser.environment import SteadyWind
from anser.missions import refusal
from anser.numerics.arrays import stack_rows
from anser.planning.certified.search import FleetTask, SearchOutcome
from anser.planning.certified.task import ArrivalRequest
from support.aircraft_tasks import aircraft_task, airspace

_binding_constraint = refusal._binding_constraint  # as it is without the fixture below
NAMES = ("alpha", "bravo", "charlie")
WINDOWS = ArrivalRequest("windows", 600.0, windows_s=np.array([[90.0, 95.0]] * 3))
AT = ArrivalRequest("at", 600.0, times_s=np.full(3, 92.0))


@pytest.fixture(autouse=True)
def no_binding_constraint(monkeypatch):
    monkeypatch.setattr(refusal, "_binding_constraint", lambda *arguments: ("", ()))


def make_fleet_task(request_):
    """Three aircraft on their way to the same goal."""
    return FleetTask(stack_rows([aircraft_task((8000.0, 0.0, 0.0))] * 3), airspace(SteadyWind(jnp.zeros(3))), request_)


def make_outcome(valid, satisfied):
    best = SimpleNamespace(
        valid=np.array(valid), certificate=SimpleNamespace(satisfied_individually=np.array(satisfied))
    )
    return SearchOutcome(None, 3, best)


@pytest.mark.parametrize("request_", [WINDOWS, AT], ids=["windows", "at"])
def test_an_aircraft_with_a_path_is_not_called_infeasible(request_):
    arrivals = [[], [(120.0, 600.0)], [(80.0, 600.0)]]
    messages = refusal._infeasible_aircraft(NAMES, make_fleet_task(request_), arrivals, SearchOutcome(None, 3), [])
    assert len(messages) == 2
    assert '"alpha" cannot arrive' in messages[0]
    assert '"bravo" cannot arrive' in messages[1]
    assert "by itself it can from 120.0 to 600.0 s" in messages[1]
    # The search found bravo a way, and alpha one that its certificate turned down.
    (message,) = refusal._infeasible_aircraft(
        NAMES, make_fleet_task(request_), arrivals, make_outcome([True, True, True], [False, True, True]), []
    )
    assert '"alpha" cannot arrive' in message


def test_a_time_a_little_outside_the_reachable_ones_is_refused_as_such():
    arrivals = [[(60.0, 91.7), (92.3, 600.0)]] * 3
    messages = refusal._infeasible_aircraft(NAMES, make_fleet_task(AT), arrivals, SearchOutcome(None, 3), [])
    assert [message.split(";")[0] for message in messages] == [
        f'aircraft "{name}" cannot arrive at 92.0 s' for name in NAMES
    ]


def test_a_prescribed_side_that_stands_in_the_way_is_named(monkeypatch):
    fleet = make_fleet_task(AT)
    left = eqx.tree_at(lambda t: t.side, fleet.tasks, np.array([0, -1, 0]))
    searched = []

    def search(_, tasks, *arguments):
        searched.append(np.asarray(tasks.side).tolist())
        return make_outcome([True, True, True], [False, True, True])

    monkeypatch.setattr(refusal, "search", search)
    text, keys = _binding_constraint(1, FleetTask(left, fleet.airspace, AT), 92.0, [])
    assert text == ': the side of the detour (aircraft[1].bend) stands in the way; with "auto", a path exists'
    assert keys == ("aircraft[1].bend",)
    assert searched == [[0, 0, 0]]


def test_the_separation_is_not_blamed_for_a_path_that_is_not_proved():
    fleet, outcome = make_fleet_task(AT), make_outcome([True, True, True], [True, False, True])
    reason = refusal._largest_feasible_separation(NAMES, fleet, outcome)
    assert reason == 'no path was proved for "bravo" in 3 tries, though the time is within reach'
    assert reason.aircraft == ("bravo",)


def crowded_task(goals, moving):
    """Two aircraft side by side on the way to goals with the given east coordinates, m, and their rates, m/s."""
    tasks = stack_rows(
        [aircraft_task((8000.0, east, -1700.0), (0.0, rate, 0.0)) for east, rate in zip(goals, moving, strict=True)]
    )
    return tasks, airspace(SteadyWind(jnp.array([10.0, 5.0, 0.0])), 500.0, 150.0)


def test_conflicting_rendezvous_points_are_named_with_their_distances():
    task = crowded_task((0.0, 400.0), (0.0, 0.0))
    (message,) = refusal._conflicting_rendezvous(
        NAMES, FleetTask(*task, ArrivalRequest("at", 200.0, times_s=np.full(2, 70.0)))
    )
    assert 'of "alpha" and "bravo" are too close' in message
    assert "at 70.0 s they leave 400 m / 0 m at most, 500 m / 150 m asked" in message
    # One that moves away: what it leaves at most, at the latest.
    task = crowded_task((0.0, 200.0), (0.0, 1.0))
    (message,) = refusal._conflicting_rendezvous(NAMES, FleetTask(*task, ArrivalRequest("together", 200.0)))
    assert "when the first of them arrives they leave 400 m / 0 m at most" in message
    assert refusal._conflicting_rendezvous(NAMES, FleetTask(*task, ArrivalRequest("together", 320.0))) == []
    assert refusal._conflicting_rendezvous(NAMES, FleetTask(*task, WINDOWS)) == []
    # A sequence longer than the flight leaves no time to look at.
    late = ArrivalRequest("sequence", 200.0, offsets_s=np.array([0.0, 250.0]))
    assert refusal._conflicting_rendezvous(NAMES, FleetTask(*task, late)) == []


def test_missing_holds_are_reported_without_padding_aircraft():
    rendezvous = SimpleNamespace(path_angle_deg=-3.0)
    scenario = SimpleNamespace(aircraft=[SimpleNamespace(name=name, rendezvous=rendezvous) for name in NAMES])
    fleet = SimpleNamespace(active=np.array([True, True, True]))
    ratios = np.full((4, 4), np.inf)
    ratios[0, 1] = ratios[1, 0] = 0.4
    ratios[3, :3] = ratios[:3, 3] = 0.1  # one that only fills the fleet up
    holds = SimpleNamespace(clear=np.zeros(4, bool), clearance_ratio=ratios, keep_out_clearance=np.full((4, 1), np.inf))
    messages = refusal.diagnose_missing_holds(scenario, fleet, holds)
    assert len(messages) == 2
    assert messages[0].startswith('"alpha" and "bravo" can arrive, but no holds afterwards keep them apart')
    assert "0.40 of the separation" in messages[0]
    assert messages[1].startswith('aircraft "charlie" can arrive, but no hold afterwards keeps it within')
    assert messages[1].endswith("altitude and off its goal; a greater stand-off of its rendezvous may help")
    holds.keep_out_clearance[2] = -20.0
    message = refusal.diagnose_missing_holds(scenario, fleet, holds)[1]
    assert "off its goal and out of the keep-outs; a greater stand-off of its rendezvous or a rendezvous" in message
    rendezvous.path_angle_deg = None
    message = refusal.diagnose_missing_holds(scenario, fleet, holds)[1]
    assert message.endswith("or a level arrival (rendezvous.path_angle_deg = 0) may help")
    assert message.keys[-1] == "aircraft[2].rendezvous.path_angle_deg"


def sequence_case():
    """Three aircraft, the third of which needs a sequence to begin at 70 s: 80 s for 12 km at 150 m/s, less 10 s."""
    tasks = stack_rows([aircraft_task((north, 0.0, -1700.0)) for north in (6000.0, 6000.0, 12000.0)])
    request_ = ArrivalRequest("sequence", 300.0, offsets_s=np.array([0.0, 20.0, 10.0]))
    fleet = FleetTask(tasks, airspace(SteadyWind(jnp.zeros(3))), request_)
    aircraft = [SimpleNamespace(name=name, airspeed_forms=()) for name in NAMES]
    return fleet, SimpleNamespace(
        aircraft=aircraft, fleet=SimpleNamespace(airspeed_key="speed_m_s"), speed_for=lambda aircraft: 150.0
    )


@pytest.mark.long
def test_a_sequence_at_the_preferred_speed_names_the_aircraft_that_needs_longest():
    fleet, scenario = sequence_case()
    text = refusal.describe_sequence_start(scenario, fleet, 70.02 + fleet.offsets, None)
    assert text.startswith(
        'the sequence begins at 70.0 s, no earlier because of "charlie", which arrives 10 s after the first and needs '
        "80.0 s by its direct path at its preferred 150 m/s"
    )
    assert "a higher fleet.speed_m_s or another arrival.order" in text
    scenario.aircraft[2] = SimpleNamespace(name="charlie", airspeed_forms=("mach",), airspeed_key="mach")
    assert "a higher aircraft[2].mach" in refusal.describe_sequence_start(scenario, fleet, 70.02 + fleet.offsets, None)


@pytest.mark.parametrize(
    ("proven_alone", "ratio", "feasible", "reason"),
    [
        ([True, False, True], 2.0, [True, False, True], 'no path within its limits was found for "bravo" at 94.4 s'),
        ([True] * 3, 0.83, [False, True, False], '"alpha", at 74.4 s, and "charlie", at 84.4 s, apart: 0.83 of'),
        ([True] * 3, 1.2, [True] * 3, "could arrive from 74.4 s on, but no holds were found"),
    ],
)
def test_a_delayed_sequence_names_the_failure_of_the_attempt_before(proven_alone, ratio, feasible, reason):
    fleet, scenario = sequence_case()
    ratios = np.full((3, 3), np.inf)
    ratios[0, 2] = ratios[2, 0] = ratio
    earlier = SimpleNamespace(
        arrival_times=74.4 + fleet.offsets,
        valid=np.full(3, True),
        feasible=np.array(feasible),
        certificate=SimpleNamespace(satisfied_individually=np.array(proven_alone), clearance_ratio=ratios),
    )
    outcome = SearchOutcome(None, 9, earlier_attempt=earlier)
    text = refusal.describe_sequence_start(scenario, fleet, 75.0 + fleet.offsets, outcome)
    head = "the sequence begins at 75.0 s, not at 70.0 s as the preferred speeds would allow"
    assert text.startswith(f"{head}: ")
    assert reason in text
    assert refusal.describe_sequence_start(scenario, fleet, 75.0 + fleet.offsets, None) == head


def test_an_aircraft_with_a_path_but_no_interval_does_not_exclude_a_common_time(monkeypatch):
    """The search covers more times than the intervals: the separation is the remaining reason."""
    monkeypatch.setattr(refusal, "_conflicting_rendezvous", lambda *_: [])
    monkeypatch.setattr(refusal, "_largest_feasible_separation", lambda *_: refusal.Refusal("separation"))
    scenario = SimpleNamespace(
        aircraft=[SimpleNamespace(name=name) for name in NAMES], keep_out=[], fleet=SimpleNamespace(airspeed_key="mach")
    )
    fleet = SimpleNamespace(request=ArrivalRequest("together", 600.0))
    outcome = make_outcome([True] * 3, [True] * 3)
    for intervals, expected in (([], "separation"), ([(300.0, 400.0)], "no arrival time up to 600 s is open to all")):
        arrivals = [intervals, [(120.0, 200.0)], [(80.0, 600.0)]]
        (reason,) = refusal.diagnose_refusal(scenario, fleet, dataclasses.replace(outcome, arrivals=arrivals))
        assert reason.startswith(expected)
    assert reason.keys == ("arrival.rule", "fleet.mach", "timing.duration_s")


@pytest.mark.parametrize(
    ("arrivals", "from_s", "earliest_s"),
    [
        ([[(61.53, 200.0)], [(40.0, 55.0), (70.01, np.inf)]], 50.0, 70.1),  # rounded up: what is entered is possible
        ([[(61.53, 200.0)], [(40.0, 90.0)]], 80.0, 80.0),
        ([[(61.53, 65.0)], [(70.0, np.inf)]], 50.0, None),
    ],
)
def test_the_earliest_common_time_lies_in_an_interval_of_every_aircraft(arrivals, from_s, earliest_s):
    assert refusal.earliest_common_time(arrivals, from_s) == earliest_s


def test_a_time_that_is_too_early_is_refused_with_the_earliest_possible():
    (message,) = refusal._later_common_time([[(61.53, 200.0)], [(40.0, 90.0)]], 50.0)
    assert message == "the earliest time found at which all can arrive, each by itself, is 61.6 s"
    assert message.keys == ("arrival.time_s",)
    assert refusal._later_common_time([[(61.53, 200.0)], [(40.0, 90.0)]], 70.0) == ()


def failed_attempt(excess, keep_out_clearance, ratio):
    """An attempt of which the first aircraft of three fails."""
    certificate = SimpleNamespace(
        excess=np.array([excess, [-0.1] * 10, [-0.1] * 10]),
        keep_out_clearance=np.array([keep_out_clearance, [5.0, 5.0], [5.0, 5.0]]),
        clearance_ratio=np.array([[np.inf, 2.0, ratio], [2.0, np.inf, 2.0], [ratio, 2.0, np.inf]]),
    )
    return SimpleNamespace(
        certificate=certificate, arrival_times=np.full(3, 53.7), feasible=np.array([False, True, ratio >= 1.0])
    )


@pytest.mark.parametrize(
    ("attempt", "text", "keys"),
    [
        (failed_attempt([-0.1, 0.2, *[0.1] * 8], [5.0, 5.0], 2.0), "beyond the limit of the greatest airspeed", 1),
        (failed_attempt([-0.1] * 10, [5.0, -8.0], 2.0), 'through the keep-out "ash"', 1),
        (failed_attempt([-0.1] * 10, [5.0, 5.0], 0.7), 'do not keep "alpha" and "charlie" apart', 2),
        (failed_attempt([np.nan] * 10, [5.0, 5.0], 2.0), 'no path of the kinds tried so far takes "alpha"', 0),
        (failed_attempt([0.7, *[0.1] * 9], [5.0, 5.0], 2.0), 'no path of the kinds tried so far takes "alpha"', 0),
    ],
)
def test_a_failed_attempt_names_what_it_violates(attempt, text, keys, monkeypatch):
    resolved = [SimpleNamespace(limits=SimpleNamespace(speed_max_m_s=240.0))] * 3
    monkeypatch.setattr(refusal, "resolve_fleet", lambda scenario: resolved)
    scenario = SimpleNamespace(
        aircraft=[SimpleNamespace(name=name) for name in NAMES],
        keep_out=[SimpleNamespace(name="cell"), SimpleNamespace(name="ash")],
        wind=SimpleNamespace(field="wind.nc"),
    )
    (message,) = refusal.describe_failed_attempt(scenario, attempt)
    assert text in message
    assert len(message.keys) == keys


def test_an_early_time_is_explained_by_the_airspeed_of_the_straight_way():
    scenario = load(shipped_files()["storm-sampling"])
    north = next(aircraft for aircraft in scenario.aircraft if aircraft.name == "north")
    # 14.5 km to 2.6 km north, 3.5 km to 0.6 km west, 300 m higher: 12.25 km; goal and wind move alike
    assert refusal._straight_airspeed_m_s(scenario, north, 50.0) == pytest.approx(math.hypot(11900, 2900, 300) / 50.0)
