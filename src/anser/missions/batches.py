"""Default number of flights in a batch, and the callback by which long computations report progress."""

from collections.abc import Callable

BATCH = 128
"""Default number of flights in one compiled call; larger batches are no faster on a few cores."""

Progress = Callable[[str, float | None], None]
"""Callback with a description of the current work and the completed share, 0..1 (None: the duration is unknown)."""


def no_progress(message: str, completed_share: float | None) -> None:
    """Do nothing. This function is the `Progress` callback of computations whose progress is not displayed."""
