"""Random planning tasks, planned and judged: a plan by the dense check, a refusal by proofs and the second search."""

import dataclasses
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from anser.compiling import enable_compilation_cache
from anser.planning.certified.search import search
from trials.cases import random_case
from trials.check import dense_check
from trials.data import Paths, PlanCase
from trials.report import Breach, PlanReport
from trials.search import second_search
from trials.task import LATEST_S, planner_task

__all__ = ["VERDICTS", "Answer", "Planner", "Trial", "certified_answer", "run_trial", "run_trials"]

VERDICTS = ("passes", "fails", "proved", "not found", "found", "broken")
"""Of a plan: it passes or fails the dense check. Of a refusal: no plan exists, none was found, or one was. Broken: the
planner or a judge raised."""


class Answer(NamedTuple):
    """What a planner says to a case."""

    paths: Paths | None
    """The plan; None where it refuses."""
    arrival_times: Float[np.ndarray, " aircraft"]
    """Of the plan, or of the try that came closest, s; empty where there is neither."""
    tries: int
    """Sets of arrival times and candidates tried."""
    closest: dict[str, list[int]]
    """Of a refusal: aircraft in trouble in the try that came closest, by what they lack."""


Planner = Callable[[PlanCase], Answer]


@dataclass(frozen=True)
class Trial:
    """A seed, its answer and the verdict; all of it plain values, for JSON."""

    seed: int
    size: int
    """Aircraft."""
    rule: str
    verdict: str
    """One of VERDICTS."""
    plan_s: float
    """How long the planner took, compiling included, s."""
    judge_s: float
    """How long the judge took, s."""
    tries: int = 0
    arrival_times: tuple[float, ...] = ()
    """Of the answer, s; see `Answer.arrival_times`."""
    excess: dict[str, float] = dataclasses.field(default_factory=dict)
    """Of a plan: how far each limit is passed at most, in its unit (negative: left to it); the same of "separation" and
    "keep_out", m, and "arrival_position", m."""
    breaches: tuple[dict[str, Any], ...] = ()
    """Of a plan: kind, who, amount, unit, time; None where amount or time is no finite number."""
    closest: dict[str, list[int]] = dataclasses.field(default_factory=dict)
    """Of a refusal: see `Answer.closest`."""
    reasons: tuple[str, ...] = ()
    """Of a refusal: what the search says; of a broken trial: what was raised."""
    found: tuple[dict[str, float], ...] = ()
    """Of a refusal with a plan: what that plan is like, by aircraft."""

    @property
    def planned(self) -> bool:
        """Whether the planner returned a plan."""
        return self.verdict in ("passes", "fails")

    @property
    def refused(self) -> bool:
        """Whether the planner refused."""
        return self.verdict in ("proved", "not found", "found")


def certified_answer(case: PlanCase) -> Answer:
    """The certified planner's answer to a case."""
    task = planner_task(case)
    outcome = search(0.0, *task)
    plan = outcome.plan if outcome.plan is not None else outcome.best_attempt
    if plan is None:
        return Answer(None, np.empty(0), outcome.attempts, {})
    n, start = case.size, case.starts.time
    times, air, drift = (np.asarray(leaf)[:n] for leaf in (plan.paths.times, plan.paths.air_n, plan.paths.drift_n))
    arrivals = np.asarray(plan.arrival_times)[:n] + start
    if outcome.plan is not None:
        return Answer(Paths(times + start, air, drift), arrivals, outcome.attempts, {})
    proven = plan.certificate
    lacks = {
        "path": ~np.asarray(plan.valid),
        "limits": np.max(np.asarray(proven.excess), axis=1) > 0.0,
        "separation": np.min(np.asarray(proven.clearance_ratio), axis=1) < 1.0,
        "keep-outs": np.min(np.asarray(proven.keep_out_clearance), axis=1, initial=np.inf) < 0.0,
    }
    closest = {what: [int(k) for k in np.flatnonzero(bad[:n])] for what, bad in lacks.items() if bad[:n].any()}
    return Answer(None, arrivals, outcome.attempts, closest)


def run_trial(seed: int, iterations: int, planner: Planner = certified_answer) -> Trial:
    """Plan the case of a seed and have the answer judged.

    Parameters
    ----------
    seed
        Of `random_case`.
    iterations
        Of the second search's solver where the planner refuses, at most.
    planner
        Who answers.

    Returns
    -------
    The trial; one in which something raised is broken and says what was raised.
    """
    case = random_case(seed)
    begin = time.perf_counter()
    try:
        answer = planner(case)
    except Exception as error:  # noqa: BLE001 - one seed that breaks must not end two thousand; it is named and counted
        return _broken(case, "planner", error, time.perf_counter() - begin, 0.0)
    planned = time.perf_counter()
    try:
        trial = _judge(case, answer, iterations)
    except Exception as error:  # noqa: BLE001 - as above
        return _broken(case, "judge", error, planned - begin, time.perf_counter() - planned)
    return dataclasses.replace(trial, plan_s=planned - begin, judge_s=time.perf_counter() - planned)


def run_trials(seeds: Sequence[int], iterations: int, jobs: int = 1) -> Generator[Trial, None, None]:
    """Trials of the certified planner, each as soon as it is done; with several jobs in any order.

    Parameters
    ----------
    seeds
        Of `random_case`.
    iterations
        See `run_trial`.
    jobs
        Processes at work at once; each loads the planner's programs for itself.
    """
    if jobs == 1:
        enable_compilation_cache()
        yield from (run_trial(seed, iterations) for seed in seeds)
        return
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin_job)
    try:
        for done in as_completed([pool.submit(run_trial, seed, iterations) for seed in seeds]):
            yield done.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_job() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is the parent's: it stops handing out seeds
    threading.Thread(target=_end_with_parent, daemon=True).start()
    enable_compilation_cache()


def _end_with_parent() -> None:
    """A parent that is killed cannot end its jobs: they end themselves."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _broken(case: PlanCase, where: str, error: Exception, plan_s: float, judge_s: float) -> Trial:
    what = f"{where}: {type(error).__name__}: {error}"
    return Trial(case.seed, case.size, case.rule.name, "broken", plan_s, judge_s, reasons=(what,))


def _judge(case: PlanCase, answer: Answer, iterations: int) -> Trial:
    about = (case.seed, case.size, case.rule.name)
    on_progress = {"tries": answer.tries, "arrival_times": tuple(float(t) for t in answer.arrival_times)}
    if answer.paths is not None:
        report = dense_check(answer.paths, case, answer.arrival_times)
        verdict = "passes" if report.passes else "fails"
        breaches = tuple(_breach(one) for one in report.breaches)
        return Trial(*about, verdict, 0.0, 0.0, **on_progress, excess=_excess(report), breaches=breaches)
    result = second_search(case, iterations, horizon=LATEST_S, seed=case.seed)
    found = () if result.paths is None else _describe(result.paths, case)
    return Trial(
        *about, result.status, 0.0, 0.0, **on_progress, closest=answer.closest, reasons=result.reasons, found=found
    )


def _breach(breach: Breach) -> dict[str, Any]:
    finite = {
        name: value if np.isfinite(value) else None
        for name, value in (("amount", breach.amount), ("time", breach.time))
    }
    return dataclasses.asdict(breach) | {"who": list(breach.who)} | finite


def _excess(report: PlanReport) -> dict[str, float]:
    """Worst of the fleet by limit; only figures that exist: JSON has no infinity."""
    excess = {limit: float(np.max(values)) for limit, values in report.excess.items()}
    excess["separation"] = float(-np.min(report.pairs.clearance, initial=np.inf))
    excess["keep_out"] = float(-np.min(report.keep_out_clearance, initial=np.inf))
    excess["arrival_position"] = float(np.max(report.arrival_miss, initial=-np.inf))
    return {what: value for what, value in excess.items() if np.isfinite(value)}


def _describe(paths: Paths, case: PlanCase) -> tuple[dict[str, float], ...]:
    """What the paths of a plan are like, from their knots: how long, how fast, how high, how much they turn."""
    rows = []
    for times, knots in zip(paths.times, paths.air_n + paths.drift_n, strict=True):
        place, velocity, altitude = knots[:, 0], knots[:, 1], -knots[:, 0, 2]
        air = velocity - case.wind.at(altitude).T
        speed, heading = np.linalg.norm(air, axis=1), np.unwrap(np.arctan2(air[:, 1], air[:, 0]))
        length = np.sum(np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1))
        straight = np.linalg.norm(place[-1, :2] - place[0, :2])
        ends = altitude[[0, -1]]
        rows.append(
            {
                "arrival_s": float(times[-1]),
                "length_of_straight": float(length / max(straight, 1.0)),
                "speed_first_m_s": float(speed[0]),
                "speed_least_m_s": float(speed.min()),
                "speed_greatest_m_s": float(speed.max()),
                "speed_last_m_s": float(speed[-1]),
                "above_ends_m": float(max(altitude.max() - ends.max(), 0.0)),
                "below_ends_m": float(max(ends.min() - altitude.min(), 0.0)),
                "turned_deg": float(np.rad2deg(np.sum(np.abs(np.diff(heading))))),
            }
        )
    return tuple(rows)
