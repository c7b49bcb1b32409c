"""Random planning tasks, planned and checked: a plan by the dense check, a refusal by proofs and the second search."""

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
"""Of a plan: it passes or fails the dense check. Of a refusal: proved, not contradicted, or contradicted by a plan.
Broken: the planner or the checker raised an exception."""


class Answer(NamedTuple):
    """A planner's answer to a case."""

    paths: Paths | None
    """The plan; None for a refusal."""
    arrival_times: Float[np.ndarray, " aircraft"]
    """Of the plan, or of the closest attempt, s; empty without either."""
    tries: int
    """Number of attempts."""
    closest: dict[str, list[int]]
    """Of a refusal: failed aircraft in the closest attempt, by the violated constraint."""


Planner = Callable[[PlanCase], Answer]


@dataclass(frozen=True)
class Trial:
    """A seed, its answer and the verdict; plain values, for JSON."""

    seed: int
    size: int
    """Number of aircraft."""
    rule: str
    verdict: str
    """One of VERDICTS."""
    plan_s: float
    """Planning time including compilation, s."""
    judge_s: float
    """Checking time, s."""
    tries: int = 0
    arrival_times: tuple[float, ...] = ()
    """Of the answer, s; see `Answer.arrival_times`."""
    excess: dict[str, float] = dataclasses.field(default_factory=dict)
    """Of a plan: greatest excess over each limit, in its unit (negative: margin); also "separation", "keep_out" and
    "arrival_position", m."""
    breaches: tuple[dict[str, Any], ...] = ()
    """Of a plan: kind, who, amount, unit, time; None for a non-finite amount or time."""
    closest: dict[str, list[int]] = dataclasses.field(default_factory=dict)
    """Of a refusal: see `Answer.closest`."""
    reasons: tuple[str, ...] = ()
    """Of a refusal: reasons of the search; of a broken trial: the exception."""
    found: tuple[dict[str, float], ...] = ()
    """Of a contradicted refusal: description of the plan found, by aircraft."""

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
    certificate = plan.certificate
    violations = {
        "path": ~np.asarray(plan.valid),
        "limits": np.max(np.asarray(certificate.excess), axis=1) > 0.0,
        "separation": np.min(np.asarray(certificate.clearance_ratio), axis=1) < 1.0,
        "keep-outs": np.min(np.asarray(certificate.keep_out_clearance), axis=1, initial=np.inf) < 0.0,
    }
    closest = {
        constraint: [int(k) for k in np.flatnonzero(bad[:n])] for constraint, bad in violations.items() if bad[:n].any()
    }
    return Answer(None, arrivals, outcome.attempts, closest)


def run_trial(seed: int, iterations: int, planner: Planner = certified_answer) -> Trial:
    """Plan the case of a seed and check the answer.

    Parameters
    ----------
    seed
        Seed of `random_case`.
    iterations
        Limit on the iterations of the second search's solver after a refusal.
    planner
        Planner to test.

    Returns
    -------
    The trial; broken, with the exception, if the planner or the checker raised one.
    """
    case = random_case(seed)
    begin = time.perf_counter()
    try:
        answer = planner(case)
    except Exception as error:  # noqa: BLE001 - one seed that breaks must not end two thousand; it is named and counted
        return _broken(case, "planner", error, time.perf_counter() - begin, 0.0)
    planned = time.perf_counter()
    try:
        trial = _check(case, answer, iterations)
    except Exception as error:  # noqa: BLE001 - as above
        return _broken(case, "checker", error, planned - begin, time.perf_counter() - planned)
    return dataclasses.replace(trial, plan_s=planned - begin, judge_s=time.perf_counter() - planned)


def run_trials(seeds: Sequence[int], iterations: int, jobs: int = 1) -> Generator[Trial, None, None]:
    """Trials of the certified planner, in order of completion.

    Parameters
    ----------
    seeds
        Seeds of `random_case`.
    iterations
        See `run_trial`.
    jobs
        Number of parallel processes; each loads the planner's programs separately.
    """
    if jobs == 1:
        enable_compilation_cache()
        yield from (run_trial(seed, iterations) for seed in seeds)
        return
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin_job)
    try:
        for future in as_completed([pool.submit(run_trial, seed, iterations) for seed in seeds]):
            yield future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_job() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the parent handles an interrupt: it submits no further seeds
    threading.Thread(target=_end_with_parent, daemon=True).start()
    enable_compilation_cache()


def _end_with_parent() -> None:
    """Exit after the end of the parent process: a killed parent cannot end its jobs."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _broken(case: PlanCase, stage: str, error: Exception, plan_s: float, judge_s: float) -> Trial:
    reason = f"{stage}: {type(error).__name__}: {error}"
    return Trial(case.seed, case.size, case.rule.name, "broken", plan_s, judge_s, reasons=(reason,))


def _check(case: PlanCase, answer: Answer, iterations: int) -> Trial:
    identity = (case.seed, case.size, case.rule.name)
    attempt = {"tries": answer.tries, "arrival_times": tuple(float(t) for t in answer.arrival_times)}
    if answer.paths is not None:
        report = dense_check(answer.paths, case, answer.arrival_times)
        verdict = "passes" if report.passes else "fails"
        breaches = tuple(_breach(breach) for breach in report.breaches)
        return Trial(*identity, verdict, 0.0, 0.0, **attempt, excess=_excess(report), breaches=breaches)
    result = second_search(case, iterations, horizon=LATEST_S, seed=case.seed)
    description = () if result.paths is None else _describe(result.paths, case)
    return Trial(
        *identity, result.status, 0.0, 0.0, **attempt, closest=answer.closest, reasons=result.reasons, found=description
    )


def _breach(breach: Breach) -> dict[str, Any]:
    finite = {
        name: value if np.isfinite(value) else None
        for name, value in (("amount", breach.amount), ("time", breach.time))
    }
    return dataclasses.asdict(breach) | {"who": list(breach.who)} | finite


def _excess(report: PlanReport) -> dict[str, float]:
    """Greatest excess of the fleet by limit; finite values only, because JSON has no infinity."""
    excess = {limit: float(np.max(values)) for limit, values in report.excess.items()}
    excess["separation"] = float(-np.min(report.pairs.clearance, initial=np.inf))
    excess["keep_out"] = float(-np.min(report.keep_out_clearance, initial=np.inf))
    excess["arrival_position"] = float(np.max(report.arrival_miss, initial=-np.inf))
    return {quantity: value for quantity, value in excess.items() if np.isfinite(value)}


def _describe(paths: Paths, case: PlanCase) -> tuple[dict[str, float], ...]:
    """Description of a plan's paths from their knots: length, airspeed, altitude, turns."""
    descriptions = []
    for times, knots in zip(paths.times, paths.air_n + paths.drift_n, strict=True):
        positions, velocity, altitude = knots[:, 0], knots[:, 1], -knots[:, 0, 2]
        air = velocity - case.wind.at(altitude).T
        speed, heading = np.linalg.norm(air, axis=1), np.unwrap(np.arctan2(air[:, 1], air[:, 0]))
        length = np.sum(np.linalg.norm(np.diff(positions[:, :2], axis=0), axis=1))
        straight = np.linalg.norm(positions[-1, :2] - positions[0, :2])
        end_altitudes = altitude[[0, -1]]
        descriptions.append(
            {
                "arrival_s": float(times[-1]),
                "length_of_straight": float(length / max(straight, 1.0)),
                "speed_first_m_s": float(speed[0]),
                "speed_least_m_s": float(speed.min()),
                "speed_greatest_m_s": float(speed.max()),
                "speed_last_m_s": float(speed[-1]),
                "above_ends_m": float(max(altitude.max() - end_altitudes.max(), 0.0)),
                "below_ends_m": float(max(end_altitudes.min() - altitude.min(), 0.0)),
                "turned_deg": float(np.rad2deg(np.sum(np.abs(np.diff(heading))))),
            }
        )
    return tuple(descriptions)
