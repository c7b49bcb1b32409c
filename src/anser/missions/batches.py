"""Many flights in batches of one compiled size, with the time that compiling and running took."""

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
"""Flights of one compiled call: larger batches are no faster on a few cores."""

Progress = Callable[[str, float | None], None]
"""Called with what is being done and the part that is done, 0..1; None where nobody knows how long it takes."""


def no_progress(what: str, done: float | None) -> None:
    """Tell nobody: `Progress` where none is wanted."""


@dataclass(frozen=True)
class SurveyResult:
    """What was computed in batches.

    Attributes
    ----------
    dataset
        All of it, labelled.
    compile_s, run_s
        Wall time spent compiling and running.
    """

    dataset: "xr.Dataset"
    compile_s: float
    run_s: float


class Stopwatch:
    """Compile and run, and keep the time of each.

    Attributes
    ----------
    compile_s, run_s
        Wall time spent so far.
    """

    def __init__(self) -> None:
        self.compile_s = self.run_s = 0.0

    def run(self, program: Program[..., _R], *of: Any) -> _R:
        """Call a program with arguments."""
        began = time.perf_counter()
        ready = program.ready(*of)
        compiled = time.perf_counter()
        result = jax.block_until_ready(ready())
        self.compile_s += compiled - began
        self.run_s += time.perf_counter() - compiled
        return result


def run_in_batches(run: Callable[[np.ndarray], Any], total: int, size: int, tell: Callable[[int], None]) -> Any:
    """Run items 0 to `total` - 1 in batches of one size; the last is filled up with repetitions.

    Parameters
    ----------
    run
        From the numbers of the items of a batch, shape (size,), to a tree of arrays with a row for each.
    total
        Number of items, 1 or more.
    size
        Of a batch.
    tell
        Called before each batch how many are done, and at the end.

    Returns
    -------
    The tree with a row for each item.
    """
    done = []
    for first in range(0, total, size):
        tell(first)
        batch = run(np.arange(first, first + size) % total)
        done.append(jax.tree.map(np.asarray, batch))
    tell(total)
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:total], *done)
