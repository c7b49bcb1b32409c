"""Numbers of a campaign's page as JSON has them."""

import numpy as np


def plain(values: np.ndarray) -> list[float | None]:
    """Nine digits of each number; None where it is not finite."""
    return [float(f"{value:.9g}") if np.isfinite(value) else None for value in np.asarray(values, dtype=float)]
