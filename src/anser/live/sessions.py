"""Session of one page: requests and answers.

Plans and flights are computed by worker threads that all pages share. Of several waiting plan requests of a page, only
the newest is answered.
"""

import asyncio
import json
import secrets
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from anser.compiling.measuring import Compilation, awaited_compilation, compilations
from anser.config.errors import ScenarioError
from anser.live import messages
from anser.live.answers import (
    Answer,
    advised_answer,
    invalid_answer,
    invalid_problem,
    make_answer,
    plain_problem,
    preliminary_answer,
    without_arrival_times,
)
from anser.live.controls import GOAL_KINDS, RULES, new_tables, sliders
from anser.live.documents import DocumentFolder
from anser.live.page import render_live_page
from anser.live.preparation import Preparation
from anser.missions.first_plan import FirstPlan, NoPlanError
from anser.missions.runs import FlightResult, run
from anser.planning.certified.search import FailedAttempt
from anser.results.summary_format import format_verdict
from anser.scenario.schema import Scenario
from anser.version import source_version

FLIGHTS_MAX = 16
"""Greatest number of flights that the server keeps for reports and comparisons; the oldest is removed first."""
_SESSIONS_MAX = 64
_SUPERSEDED_AFTER_S = 0.7  # a search that takes longer ends if a newer request waits, s
_PROGRESS_PERIOD_S = 0.3
_PRELIMINARY_AFTER_S = 1.0  # time after which a preliminary answer is sent, s
_ROW_PERIOD_S = 0.5  # time between two rows of a flight on the page, s

Send = Callable[[dict[str, Any]], None]
"""Callback that queues a message (plain data for JSON) to the page; callable from any thread."""


class StoppedError(Exception):
    """Error in a plan or flight that was stopped by a newer request, by the user, or by closing the page."""


@dataclass
class Workbench:
    """State that all pages of a server share: folder, opened document, worker threads, flights and sessions."""

    folder: DocumentFolder
    name: str | None  # name of the opened document's file; None if it is no file of the folder
    document: dict[str, Any]
    # one thread each, so that plans are answered during a flight
    planning: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "planning"))
    flying: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "flying"))
    flights: dict[str, FlightResult] = field(default_factory=dict)
    sessions: dict[str, "Session"] = field(default_factory=dict)
    preparation: Preparation | None = None  # None: programs are compiled when they are needed

    def new_session(self) -> "Session":
        """Return the new session of a page, stored in `sessions`."""
        return self._keep_session(Session(self, secrets.token_urlsafe(12)))

    def resume(self, new: "Session", key: str) -> "Session":
        """Return the stored session `key` of a page that reconnects; the page's session `new` is discarded.

        If no session `key` is stored, as after a restart of the server, `new` gets the key and is returned.
        """
        self.sessions.pop(new.key, None)
        if key not in self.sessions:
            new.key = key
            return self._keep_session(new)
        new.detach()
        return self.sessions[key]

    def is_attached(self, key: str) -> bool:
        """Return whether the session `key` exists and its page is connected."""
        return key in self.sessions and self.sessions[key].is_attached

    def _keep_session(self, session: "Session") -> "Session":
        while len(self.sessions) >= _SESSIONS_MAX:
            oldest = next((key for key in self.sessions if not self.is_attached(key)), next(iter(self.sessions)))
            self.sessions.pop(oldest).detach()
        self.sessions[session.key] = session
        return session

    def keep_flight(self, flight: FlightResult) -> str:
        """Store a flight for reports and comparisons, and return its identifier."""
        while len(self.flights) >= FLIGHTS_MAX:
            del self.flights[next(iter(self.flights))]
        identifier = secrets.token_urlsafe(9)
        self.flights[identifier] = flight
        return identifier

    def close(self) -> None:
        """Cancel waiting work and stop the work in progress, without waiting for its end."""
        for session in list(self.sessions.values()):
            session.detach()
        if self.preparation is not None:
            self.preparation.close()
        for executor in (self.planning, self.flying):
            executor.shutdown(wait=False, cancel_futures=True)


class Session:
    """Requests and results of one page; the session survives a reconnect of the page."""

    def __init__(self, workbench: Workbench, key: str) -> None:
        self.workbench, self.key = workbench, key
        self._send: Send | None = None
        # newest plan request without an answer, and the socket that it came from
        self._waiting: tuple[messages.PlanRequest, Send | None] | None = None
        self._is_planning = False
        self._plan: FirstPlan | None = None  # last plan, flown without a new search
        self._stop_flight = threading.Event()  # of the newest flight
        self._flight_messages: dict[str, dict[str, Any]] = {}  # answers about finished flights, by flight
        self._lock = threading.Lock()

    def attach(self, send: Send) -> None:
        """Connect the session with a page; `send` queues messages to the page."""
        self._send = send

    def detach(self, send: Send | None = None) -> None:
        """Disconnect the page that `send` serves; the result of a flight in progress waits until the page reconnects.

        If `send` is None, the session is disconnected from any page and its flight is stopped.
        """
        if send is None:
            self._stop_flight.set()
        if send is None or self._send is send:
            self._send = None

    @property
    def is_attached(self) -> bool:
        """Whether the page is connected."""
        return self._send is not None

    def welcome(self) -> dict[str, Any]:
        """Return the first message to the page: document, sliders, arrival rules, and new tables."""
        bench = self.workbench
        scenario = bench.folder.scenario(bench.document)
        return {
            "type": "welcome",
            "version": source_version(),
            "session": self.key,
            "folder": bench.folder.path.resolve().name,
            "name": bench.name,
            "scenario": bench.document,
            "sliders": sliders(scenario),
            "rules": list(RULES),
            "goal_kinds": list(GOAL_KINDS),
            "templates": new_tables(scenario),
            "flights": [],
        }

    def handle(self, request: messages.Request) -> None:
        """Answer a request of the page; worker threads answer plan and flight requests later."""
        match request:
            case messages.PlanRequest():
                self._request_plan(request)
            case messages.FlyRequest():
                self._stop_flight.set()
                stop = self._stop_flight = threading.Event()
                self.workbench.flying.submit(self._guarded, request.number, lambda: self._fly(request, stop))
            case messages.StopRequest():
                self._stop_flight.set()
            case messages.RecordedRequest():
                self.workbench.planning.submit(self._guarded, request.number, lambda: self._record(request))
            case messages.ResumeRequest():
                for identifier, message in list(self._flight_messages.items()):
                    if identifier not in request.flight_ids and identifier in self.workbench.flights:
                        self._tell(message | {"number": 0})  # no request of a page that was loaded anew
            case _:
                self._guarded(request.number, lambda: self._answer_file_request(request))

    def _tell(self, message: dict[str, Any]) -> None:
        send = self._send
        if send is not None:
            send(message)

    def _fail(self, number: int, problems: Sequence[dict[str, Any]]) -> None:
        self._tell({"type": "failed", "number": number, "problems": list(problems)})

    def _guarded(self, number: int, work: Callable[[], None]) -> None:
        """Call `work`, and report an error to the page as the failure of request `number`."""
        try:
            work()
        except ScenarioError as error:
            self._fail(number, [invalid_problem(problem) for problem in error.problems])
        except NoPlanError as error:
            self._fail(number, [plain_problem(reason) for reason in error.reasons])
        except StoppedError:
            self._fail(number, [plain_problem("the flight was stopped")])
        except (OSError, ValueError) as error:
            self._fail(number, [plain_problem(str(error))])
        except Exception as error:  # noqa: BLE001  the server outlives a fault, which is printed and told
            traceback.print_exc()
            self._fail(number, [plain_problem(f"an error of anser: {type(error).__name__}: {error}")])

    def _answer_file_request(self, request: messages.Request) -> None:
        folder = self.workbench.folder
        match request:
            case messages.FilesRequest():
                self._tell({"type": "files", "number": request.number, "names": folder.names()})
            case messages.OpenRequest():
                scenario = folder.read(request.name)[1]
                self._tell({"type": "opened", "number": request.number, "name": request.name, "scenario": scenario})
            case messages.SaveRequest():
                kind = "saved"
                try:
                    folder.save(request.name, request.scenario, request.base, request.overwrite)
                except FileExistsError:
                    kind = "exists"
                self._tell({"type": kind, "number": request.number, "name": request.name})
            case messages.TextRequest():
                text = folder.text(request.scenario, request.base)
                self._tell({"type": "text", "number": request.number, "text": text})

    def _request_plan(self, request: messages.PlanRequest) -> None:
        """Queue a plan request for the planning thread, in place of an older waiting request of the page."""
        with self._lock:
            self._waiting = request, self._send
            if self._is_planning:
                return
            self._is_planning = True
        self.workbench.planning.submit(self._plan_newest)

    def _plan_newest(self) -> None:
        """Answer the newest plan request of the page, in the planning thread; queue a request that came meanwhile."""
        with self._lock:
            waiting, self._waiting = self._waiting, None
        if waiting is not None and waiting[1] is self._send:
            self._guarded(waiting[0].number, lambda: self._answer_plan(*waiting))
        with self._lock:
            self._is_planning = self._waiting is not None
        if self._is_planning:
            self.workbench.planning.submit(self._plan_newest)

    def _answer_plan(self, request: messages.PlanRequest, send: Send | None) -> None:
        """Plan a document and send the answer to the page.

        Planning stops without an answer if a final request waits, if planning has taken more than `_SUPERSEDED_AFTER_S`
        and another request waits, or if the page's connection has changed.
        """
        begin = time.monotonic()
        if self.workbench.preparation is not None:
            self.workbench.preparation.pause()

        def is_superseded() -> bool:
            waiting = self._waiting
            is_old = waiting is not None and (waiting[0].final or time.monotonic() - begin > _SUPERSEDED_AFTER_S)
            return self._send is not send or is_old

        try:
            with _Progress(self._tell, request.number) as progress:
                answer, scenario = self._planned(
                    request.scenario, _stop_if(is_superseded, progress.report), progress.set_preliminary
                )
        except StoppedError:
            return
        if send is not None and self._send is send:
            send({"type": "plan", "number": request.number, "answer": answer})
        if self.workbench.preparation is not None and scenario is not None:
            self.workbench.preparation.request(request.scenario, answer["last_s"])

    def _planned(
        self,
        document: dict[str, Any],
        on_progress: Callable[[str], None],
        on_preliminary: Callable[[Answer], None] = lambda answer: None,
    ) -> tuple[Answer, Scenario | None]:
        """Return the answer to a document, and its scenario (None if not valid); store the plan for a later flight.

        `on_preliminary` is called with a preliminary answer before a long search.
        """
        folder = self.workbench.folder
        try:
            scenario = folder.scenario(document)
        except ScenarioError as error:
            free = without_arrival_times(document, error)
            if free is None:
                return invalid_answer(error), None
            on_preliminary(invalid_answer(error))
            on_progress("searching the earliest arrival times")
            try:
                return advised_answer(error, folder.scenario(free)), None
            except ScenarioError:
                return invalid_answer(error), None

        def report(text: str) -> None:
            on_progress(text)
            if isinstance(text, FailedAttempt):
                on_preliminary(preliminary_answer(scenario, text))

        try:
            answer, self._plan = make_answer(scenario, report)
        except ScenarioError as error:
            return invalid_answer(error), None
        return answer, scenario

    def _record(self, request: messages.RecordedRequest) -> None:
        answer, scenario = self._planned(request.scenario, lambda message: None)
        label = "Scenario" if scenario is None else scenario.name
        page = render_live_page([{"label": label, "scenario": request.scenario, "answer": answer}])
        self._tell({"type": "recorded", "number": request.number, "html": page})

    def _fly(self, request: messages.FlyRequest, stop: threading.Event) -> None:
        bench, scenario = self.workbench, self.workbench.folder.scenario(request.scenario)
        last = self._plan
        planned = last if last is not None and last.scenario == scenario and not last.refusals else None
        names = [aircraft.name for aircraft in scenario.aircraft]
        stride = max(1, round(_ROW_PERIOD_S / scenario.timing.step_s))

        def send_rows(time_s: np.ndarray, history: dict[str, np.ndarray]) -> None:
            rows = np.flatnonzero(np.round(time_s / scenario.timing.step_s).astype(int) % stride == 0)
            columns = [("north_m", "north"), ("east_m", "east"), ("altitude_m", "altitude")]
            aircraft = [
                {"name": name} | {column: _finite(history[key][rows, k]) for column, key in columns}
                for k, name in enumerate(names)
            ]
            self._tell(
                {"type": "rows", "number": request.number, "time_s": _finite(time_s[rows]), "aircraft": aircraft}
            )

        with _Progress(self._tell, request.number, _FLIGHT_PROGRAMS) as progress:
            flight = run(scenario, _stop_if(stop.is_set, progress.report), planned, on_segment=send_rows)
        identifier = bench.keep_flight(flight)
        compared = request.compare if request.compare in bench.flights else None
        message = {
            "type": "flight",
            "number": request.number,
            "id": identifier,
            "report": f"report/{identifier}",
            "compare": None if compared is None else f"compare/{compared}/{identifier}",
            "success": flight.met,
            "verdict": format_verdict(flight.summary),
            "arrivals": [
                {"name": entry["name"], "arrival_s": entry["arrival_s"], "miss_m": entry["miss_m"]}
                for entry in flight.summary["aircraft"]
            ],
        }
        self._flight_messages[identifier] = message
        while len(self._flight_messages) > FLIGHTS_MAX:
            del self._flight_messages[next(iter(self._flight_messages))]
        self._tell(message)


def _finite(values: np.ndarray) -> list[float | None]:
    """Return values for the page, rounded to three decimals; None for values that are not finite."""
    return [round(float(value), 3) if np.isfinite(value) else None for value in values]


def _stop_if(is_stopped: Callable[[], bool], report: Callable[..., None]) -> Callable[..., None]:
    """Return a progress callback that calls `report`, or raises StoppedError if `is_stopped()` is True."""

    def on_progress(text: str, share: float | None = None) -> None:
        if is_stopped():
            raise StoppedError
        report(text, share)

    return on_progress


_WORK = {
    "trim": "steady flight at the start",
    "paths": "search for paths",
    "choice of paths": "choice and proof of paths",
    "holds": "holds after the arrivals",
    "arrival times": "search for arrival times",
    "reachable arrivals": "times at which each aircraft can arrive",
    "greatest wind": "wind along the paths",
    "sample demands": "margins of the paths",
    "distances at samples": "distances between aircraft",
    "closest approaches": "distances between aircraft",
    "keep out margins": "distances from keep-outs",
}
"""Description of the work for which a program is compiled, by the title of the program."""


_PLAN_PROGRAMS, _REFUSAL_PROGRAMS, _FLIGHT_PROGRAMS = 10, 4, 2
"""Usual numbers of programs compiled for the first plan of a fleet, for a later refusal, and for a flight."""


def _preparation(record: Compilation, time_left: str | None, before: int, usual_count: int = _REFUSAL_PROGRAMS) -> str:
    """Return the page's text about the compilation in progress, `record`, with the time left if known.

    `before` is the number of programs compiled before the request. `usual_count` is the number of programs that such a
    request usually compiles if the fleet has been planned before.
    """
    since = list(compilations[before:])
    number = since.index(record) + 1 if record in since else 1
    usual = _PLAN_PROGRAMS if any(other.title == "trim" for other in since) else usual_count
    total = f" of about {usual}" if max(number, len(since)) <= usual else ""
    return (
        f"Preparing for a fleet of this kind, program {number}{total}: {_WORK.get(record.title, 'flight')}"
        f"{'' if time_left is None else f', {time_left}'}"
    )


class _Progress:
    """Progress messages of one request to the page, sent by a thread in the `with` block."""

    def __init__(
        self, tell: Callable[[dict[str, Any]], None], number: int, usual_programs: int = _REFUSAL_PROGRAMS
    ) -> None:
        self._usual = usual_programs
        self._tell, self._number, self._state, self._last = tell, number, ("", None), ("", None)
        self._begin_s, self._programs_before = time.monotonic(), len(compilations)
        self._preliminary: Answer | None = None
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> "_Progress":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()

    def report(self, text: str, share: float | None = None) -> None:
        """Set the description of the current work and the completed fraction, 0..1 (None: unknown)."""
        self._state = text, share

    def set_preliminary(self, answer: Answer) -> None:
        """Set a preliminary answer, sent if the final answer takes more than 1 s or waits for a compilation."""
        self._preliminary = answer

    def _watch(self) -> None:
        while not self._end.wait(_PROGRESS_PERIOD_S):
            awaited = awaited_compilation()
            state = (
                self._state if awaited is None else (_preparation(*awaited, self._programs_before, self._usual), None)
            )
            if state != self._last:
                self._last = state
                self._tell({"type": "progress", "number": self._number, "text": state[0], "share": state[1]})
            preliminary = self._preliminary
            if preliminary is not None and (awaited or time.monotonic() - self._begin_s > _PRELIMINARY_AFTER_S):
                self._preliminary = None
                self._tell({"type": "preliminary", "number": self._number, "answer": preliminary})


def queue_sender(loop: asyncio.AbstractEventLoop, queue: "asyncio.Queue[str]") -> Send:
    """Return a callback that puts messages, as JSON text, into a queue of an event loop, from any thread.

    The callback raises ValueError or TypeError for a value that JSON cannot represent.
    """

    def send(message: dict[str, Any]) -> None:
        text = json.dumps(message, allow_nan=False, separators=(",", ":"))
        if not loop.is_closed():
            loop.call_soon_threadsafe(queue.put_nowait, text)

    return send
