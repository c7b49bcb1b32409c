"""Common part of the surveys: evaluation of a compiled program for many rows of inputs, in batches of one size.

A row holds the inputs of one evaluation, such as a trim point. Margins, envelope and robustness are surveys: their
modules define rows, compiled program and dataset. Progress and wall time are reported.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import jax
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from anser.analysis.survey_outcomes import FlightOutcomes, classify_flights
from anser.compiling.options import enable_compilation_cache
from anser.compiling.program import Program
from anser.control.limits import FlightLimits
from anser.missions.batches import BATCH, Progress, no_progress
from anser.results.documents import version_attributes
from anser.simulation.survey_flight import SurveySummary
from anser.steady.trim import TrimPoint
from anser.units import DEG_RAD

_R = TypeVar("_R")


@dataclass(frozen=True)
class SurveyResult:
    """Result of a survey.

    Attributes
    ----------
    dataset
        Labelled values.
    compile_s, run_s
        Wall time spent compiling and running, s.
    """

    dataset: xr.Dataset
    compile_s: float
    run_s: float


_Result = TypeVar("_Result", bound=SurveyResult)


class Survey:
    """Evaluation of compiled programs for many rows.

    Parameters
    ----------
    progress
        Called with a description of the current work and the completed part, 0..1; None: no reports.

    Attributes
    ----------
    compile_s, run_s
        Wall time spent so far, s.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        enable_compilation_cache()
        self._report = progress or no_progress
        self.compile_s = self.run_s = 0.0

    def start(self, description: str) -> None:
        """Report the first work of the survey."""
        self._report(description, 0.0)

    def call(self, program: Program[..., _R], *arguments: Any) -> _R:
        """Compile a program for the arguments and run it; both durations are added to the survey's."""
        start_time = time.perf_counter()
        compiled_call = program.ready(*arguments)
        compiled_time = time.perf_counter()
        result = jax.block_until_ready(compiled_call())
        self.compile_s += compiled_time - start_time
        self.run_s += time.perf_counter() - compiled_time
        return result

    def evaluate(
        self,
        description: str,
        program: Program[..., _R],
        fixed: Any,
        rows: Any,
        *options: Any,
        batch_size: int = BATCH,
        span: tuple[float, float] = (0.0, 1.0),
        select: Callable[[_R], Any] = lambda result: result,
    ) -> Any:
        """Evaluate a program for every row, in batches of equal size; the last batch is padded with repeated rows.

        Parameters
        ----------
        description
            Current work, for progress reports.
        program
            Function of `fixed`, a batch of rows and `options`; returns a tree of arrays with one row per input row.
        fixed, rows, options
            Arguments common to the rows; tree of arrays with at least one row; further common arguments.
        batch_size
            Rows of one compiled call.
        span
            Completed part of the survey before and after this evaluation.
        select
            Part of the program's result to store.

        Returns
        -------
        Tree of NumPy arrays with one row per input row.

        Raises
        ------
        ValueError
            There is no row.
        """
        rows = jax.tree.map(np.asarray, rows)
        total = len(jax.tree.leaves(rows)[0])
        if not total:
            raise ValueError(f"{description}: there is no steady flight to evaluate")
        batches = []
        for start in range(0, total, batch_size):
            self._report(description, _interpolate(span, start / total))
            batch = np.arange(start, start + batch_size) % total
            result = self.call(program, fixed, select_rows(rows, batch), *options)
            batches.append(jax.tree.map(np.asarray, select(result)))
        self._report(description, span[1])
        return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:total], *batches)

    def fly(
        self,
        description: str,
        program: Program[..., SurveySummary],
        fixed: Any,
        rows: Any,
        step: Any,
        count: int,
        *,
        tolerances: np.ndarray,
        start_beyond: np.ndarray,
        span: tuple[float, float] = (0.0, 1.0),
    ) -> tuple[SurveySummary, FlightOutcomes]:
        """Evaluate a program of flights of `count` samples and classify the flights; see `classify_flights`."""
        summaries = self.evaluate(description, program, fixed, rows, step, count, span=span)
        return summaries, classify_flights(summaries, tolerances, count * float(step), start_beyond)

    def result(
        self,
        result_class: type[_Result],
        data: Mapping[str, Any],
        coordinates: Mapping[str, Any],
        attributes: Mapping[str, str | int | float],
    ) -> _Result:
        """Return the labelled result, with the software versions and the wall time."""
        dataset = xr.Dataset(data, coordinates, {**attributes, **version_attributes()})
        return result_class(dataset, self.compile_s, self.run_s)


def sample_count(duration_s: float, step_s: float) -> int:
    """Return the number of samples of a flight. Raises ValueError for fewer than 100."""
    count = round(duration_s / step_s)
    if count < 100:
        raise ValueError(f"duration_s: arrived {duration_s:g} with step_s {step_s:g}; expected 100 samples or more")
    return count


def select_rows(rows: Any, index: np.ndarray) -> Any:
    """Select rows of a tree of arrays by their indices."""
    return jax.tree.map(lambda leaf: leaf[index], rows)


def limit_attributes(limits: FlightLimits) -> dict[str, float]:
    """Return the autopilot's limits as attributes of a dataset."""
    speeds = {name: float(getattr(limits, name)) for name in ("speed_min", "speed_max")}
    angles = {name: float(getattr(limits, name)) / DEG_RAD for name in ("bank_max", "alpha_min", "alpha_max")}
    factors = {name: float(getattr(limits, name)) for name in ("load_factor_min", "load_factor_max")}
    return {
        **{f"limit_{name}_m_s": value for name, value in speeds.items()},
        **{f"limit_{name}_deg": round(value, 9) for name, value in angles.items()},
        **{f"limit_{name}": value for name, value in factors.items()},
    }


def flight_attributes(count: int, step_s: float, limits: FlightLimits) -> dict[str, float]:
    """Return duration, sampling period and autopilot limits of surveyed flights as attributes of a dataset."""
    return {"duration_s": count * step_s, "step_s": step_s, **limit_attributes(limits)}


def is_beyond_limits(trim: TrimPoint, airspeeds: ArrayLike, limits: FlightLimits) -> np.ndarray:
    """Return True for each trim beyond the autopilot's limits of alpha, bank or airspeed (m/s)."""
    alpha, bank, airspeed = np.asarray(trim.alpha), np.abs(np.asarray(trim.mu)), np.asarray(airspeeds)
    return np.asarray(
        (alpha < limits.alpha_min)
        | (alpha > limits.alpha_max)
        | (bank > limits.bank_max)
        | (airspeed < limits.speed_min)
        | (airspeed > limits.speed_max)
    )


def _interpolate(span: tuple[float, float], part: float) -> float:
    return span[0] * (1.0 - part) + span[1] * part
