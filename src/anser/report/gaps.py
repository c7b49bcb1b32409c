"""Gaps in drawn lines where an angle wraps."""

import numpy as np

__all__ = ["with_gaps"]


def with_gaps(x: np.ndarray, y: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Put a gap wherever y jumps by more than `jump`, so that no line is drawn across a wrapped angle.

    Parameters
    ----------
    x, y
        Samples, shape (samples,).
    jump
        Greatest difference of neighbours that is still drawn, in the unit of y.
    """
    steps = np.abs(np.diff(y))
    at = np.flatnonzero(np.where(np.isfinite(steps), steps, 0.0) > jump) + 1
    return np.insert(x, at, x[at]), np.insert(y, at, np.nan)
