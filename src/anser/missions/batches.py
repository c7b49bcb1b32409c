"""Batched computation in one compiled size, with the time spent compiling and running."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import jax
import numpy as np

from anser.compiling.program import Program

if TYPE_CHECKING:
    import xarray as xr


_R = TypeVar("_R")
BATCH = 128
"""Flights in one compiled call: larger batches are no faster on a few cores."""

Progress = Callable[[str, float | None], None]
"""Callback with a description of the current work and the completed share, 0..1 (None: the duration is unknown)."""


def no_progress(message: str, completed_share: float | None) -> None:
    """`Progress` callback without any effect."""


@dataclass(frozen=True)
class SurveyResult:
    """Result of a batched computation.

    Attributes
    ----------
    dataset
        Labelled values.
    compile_s, run_s
        Wall time spent compiling and running, s.
    """

    dataset: "xr.Dataset"
    compile_s: float
    run_s: float


class Stopwatch:
    """Total compile time and run time of several programs.

    Attributes
    ----------
    compile_s, run_s
        Wall time spent so far, s.
    """

    def __init__(self) -> None:
        self.compile_s = self.run_s = 0.0

    def run(self, program: Program[..., _R], *arguments: Any) -> _R:
        """Compile a program for the arguments, run it and add both durations."""
        start_time = time.perf_counter()
        compiled_call = program.ready(*arguments)
        compiled_time = time.perf_counter()
        result = jax.block_until_ready(compiled_call())
        self.compile_s += compiled_time - start_time
        self.run_s += time.perf_counter() - compiled_time
        return result


def run_in_batches(run: Callable[[np.ndarray], Any], total: int, size: int, on_batch: Callable[[int], None]) -> Any:
    """Run items 0 to `total` - 1 in batches of equal size; the last batch is padded with repeated items.

    Parameters
    ----------
    run
        Function of the item numbers of a batch, shape (size,); returns a tree of arrays with one row per item.
    total
        Number of items, 1 or more.
    size
        Number of items in a batch.
    on_batch
        Called with the number of finished items, before every batch and at the end.

    Returns
    -------
    Tree of arrays with `total` rows.
    """
    batches = []
    for start in range(0, total, size):
        on_batch(start)
        batch = run(np.arange(start, start + size) % total)
        batches.append(jax.tree.map(np.asarray, batch))
    on_batch(total)
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:total], *batches)
