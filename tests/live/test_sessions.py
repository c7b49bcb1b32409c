"""A page's session: faults, cut sockets and stopped flights leave the next request unharmed."""

import threading
import time
import tomllib
from types import SimpleNamespace

import pytest

from anser.config.shipped_files import shipped_files
from anser.live import answers, messages, sessions
from anser.live.documents import DocumentFolder

DOCUMENT = tomllib.loads(shipped_files()["storm-sampling"].read_text(encoding="utf-8"))
ANSWER = {"status": "planned", "problems": []}


@pytest.fixture
def bench(tmp_path):
    made = sessions.Workbench(DocumentFolder(tmp_path), None, DOCUMENT)
    yield made
    made.close()


def plan_request(number):
    return messages.PlanRequest(type="plan", number=number, scenario=DOCUMENT)


def wait_for(condition):
    end = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_a_fault_is_told_and_the_next_plan_is_answered(bench, monkeypatch, capsys):
    outcomes = iter([KeyError("fault"), (ANSWER, None)])

    def make_answer(scenario, on_progress):
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    monkeypatch.setattr(sessions, "make_answer", make_answer)
    session, received = bench.new_session(), []
    session.attach(received.append)
    session.handle(plan_request(1))
    wait_for(lambda: received)
    assert "KeyError" in received[0]["problems"][0]["text"]
    assert "Traceback" in capsys.readouterr().err
    session.handle(plan_request(2))
    wait_for(lambda: len(received) == 2)
    assert received[1] == {"type": "plan", "number": 2, "answer": ANSWER}


def test_the_progress_names_the_work_that_is_prepared_and_its_place_among_the_programs(bench, monkeypatch):
    programs = [SimpleNamespace(title=title) for title in ("reachable arrivals", "paths", "unknown")]
    present, awaited = [], iter([(programs[1], "about 20 s left"), (programs[2], None)])
    monkeypatch.setattr(sessions, "compilations", present)
    monkeypatch.setattr(sessions, "awaited_compilation", lambda: next(awaited, None))
    monkeypatch.setattr(sessions, "_PROGRESS_PERIOD_S", 0.01)
    present.append(SimpleNamespace(title="trim"))  # of an earlier request
    told = []
    with sessions._Progress(told.append, 5) as progress:
        present.extend(programs)
        progress.report("planning", 0.5)
        wait_for(lambda: len(told) == 3)
    kind = "Preparing for a fleet of this kind, program"
    assert [message["text"] for message in told] == [
        f"{kind} 2 of about 4: search for paths, about 20 s left",
        f"{kind} 3 of about 4: flight",
        "planning",
    ]
    assert [message["share"] for message in told] == [None, None, 0.5]


def test_the_number_of_programs_to_come_is_left_out_once_there_are_more(monkeypatch):
    present = [SimpleNamespace(title="paths") for _ in range(5)]
    monkeypatch.setattr(sessions, "compilations", present)
    assert sessions._preparation(present[0], None, 0) == (
        "Preparing for a fleet of this kind, program 1: search for paths"
    )
    present.insert(0, SimpleNamespace(title="trim"))
    assert "program 2 of about 10:" in sessions._preparation(present[1], None, 0)


def test_what_is_known_is_told_while_the_answer_waits_for_a_program(bench, monkeypatch):
    monkeypatch.setattr(sessions, "_PROGRESS_PERIOD_S", 0.01)
    monkeypatch.setattr(sessions, "awaited_compilation", lambda: None)
    told, known = [], {"status": "searching", "problems": []}
    with sessions._Progress(told.append, 5) as progress:
        progress.set_preliminary(known)
        time.sleep(0.1)
        assert told == []  # a quick answer needs none
        record = SimpleNamespace(title="paths")
        monkeypatch.setattr(sessions, "awaited_compilation", lambda: (record, None))
        wait_for(lambda: len(told) == 2)
        time.sleep(0.05)
    assert told[1] == {"type": "preliminary", "number": 5, "answer": known}
    assert len(told) == 2  # once


def test_a_page_that_was_loaded_anew_gets_no_answer_to_a_request_of_the_old_one(bench, monkeypatch):
    """Its numbers begin anew: an old answer with a high number would hide all new ones."""
    entered, release = threading.Event(), threading.Event()

    def make_answer(scenario, on_progress):
        entered.set()
        assert release.wait(10.0)
        return ANSWER, None

    monkeypatch.setattr(sessions, "make_answer", make_answer)
    session, old, new = bench.new_session(), [], []
    session.attach(old.append)
    session.handle(plan_request(57))
    assert entered.wait(10.0)
    session.attach(new.append)
    session.handle(plan_request(1))
    release.set()
    wait_for(lambda: new)
    assert [message["number"] for message in new if message["type"] == "plan"] == [1]
    assert not [message for message in old if message["type"] == "plan"]


def document_at(rule, time_s):
    return DOCUMENT | {"arrival": {"rule": rule} | ({} if time_s is None else {"time_s": time_s})}


def test_arrival_times_that_are_too_early_come_with_the_earliest(bench, monkeypatch):
    monkeypatch.setattr(answers, "build_flight", lambda scenario, pad_fleet: None)
    # the times at which each aircraft can arrive, as the planner finds them
    monkeypatch.setattr(answers, "possible_arrivals", lambda scenario, flight: [((90.04, 300.0),)] * 4)
    answer, _ = bench.new_session()._planned(document_at("at", 20.0), lambda text: None)
    (problem,) = answer["problems"]
    expected = "expected at least 90.1 s, the earliest time at which all can arrive, each by itself"
    assert problem["text"].endswith(f"given 20; {expected}")
    late_s = DOCUMENT["timing"]["duration_s"] - 1.0
    aircraft = [dict(table, arrive_s=5.0 if k == 1 else late_s) for k, table in enumerate(DOCUMENT["aircraft"])]
    document = DOCUMENT | {"arrival": {"rule": "times"}, "aircraft": aircraft}
    answer, _ = bench.new_session()._planned(document, lambda text: None)
    (problem,) = answer["problems"]
    assert problem["keys"] == ["aircraft[1].arrive_s"]
    assert problem["text"].endswith(f'the earliest time at which "{aircraft[1]["name"]}" can arrive by itself')
    # a time that is not too early keeps its reason
    monkeypatch.setattr(answers, "possible_arrivals", lambda scenario, flight: [((10.0, 300.0),)] * 4)
    answer, _ = bench.new_session()._planned(document_at("at", 20.0), lambda text: None)
    assert "no sooner, straight at limits.speed_max_m_s" in answer["problems"][0]["text"]


@pytest.mark.parametrize(
    ("rule", "time_s", "reason"),
    [
        ("earliest", 80.0, 'rule = "at", or no time_s'),
        ("at", 5999.0, "duration_s"),
        ("at", "x", "a number"),
        ("at", None, "needs"),
    ],
)
def test_other_problems_of_arrival_times_keep_their_reasons(bench, monkeypatch, rule, time_s, reason):
    monkeypatch.setattr(sessions, "advised_answer", None)  # not called
    answer, _ = bench.new_session()._planned(document_at(rule, time_s), lambda text: None)
    assert answer["status"] == "invalid"
    assert reason in answer["problems"][0]["text"]


def test_a_new_flight_stops_the_one_before(bench, monkeypatch):
    entered = threading.Semaphore(0)

    def run(scenario, on_progress, planned, on_segment):
        entered.release()
        while True:
            on_progress("flying", 0.5)  # raises StoppedError
            time.sleep(0.005)

    monkeypatch.setattr(sessions, "run", run)
    session, received = bench.new_session(), []
    session.attach(received.append)
    for number in (1, 2):
        session.handle(messages.FlyRequest(type="fly", number=number, scenario=DOCUMENT))
        assert entered.acquire(timeout=10.0)
    wait_for(lambda: [message["number"] for message in received if message["type"] == "failed"] == [1])
    session.handle(messages.StopRequest(type="stop", number=3))
    wait_for(lambda: [message["number"] for message in received if message["type"] == "failed"] == [1, 2])


def test_connected_pages_keep_their_sessions(bench):
    first = bench.new_session()
    first.attach(lambda message: None)
    for _ in range(100):
        bench.new_session()
    assert bench.sessions[first.key] is first
    assert len(bench.sessions) == 64


def test_a_page_that_reconnects_gets_the_flight_that_it_missed(bench, monkeypatch):
    release, flight = threading.Event(), SimpleNamespace(met=True, summary={"aircraft": []})

    def run(scenario, on_progress, planned, on_segment):
        assert release.wait(10.0)
        return flight

    monkeypatch.setattr(sessions, "run", run)
    monkeypatch.setattr(sessions, "format_verdict", lambda summary: "met")
    session, old, new = bench.new_session(), [], []
    session.attach(old.append)
    session.handle(messages.FlyRequest(type="fly", number=8, scenario=DOCUMENT))
    session.detach(session._send)
    release.set()
    wait_for(lambda: bench.flights)
    assert not [message for message in old if message["type"] == "flight"]
    resumed = bench.resume(bench.new_session(), session.key)
    assert resumed is session
    resumed.attach(new.append)
    wait_for(lambda: session._flight_messages)
    resumed.handle(messages.ResumeRequest(type="resume", number=1, session=session.key))
    (message,) = new
    assert (message["type"], message["number"], bench.flights[message["id"]]) == ("flight", 0, flight)
    resumed.handle(messages.ResumeRequest(type="resume", number=2, session=session.key, flight_ids=[message["id"]]))
    assert new == [message]
