"""Numbers as plain data, for JSON."""

import math
from typing import Any


def finite_or_none(value: Any) -> float | None:
    """Number; None where there is none, where it is not finite, or no number at all."""
    return float(value) if value is not None and math.isfinite(value) else None


def plain_attributes(attributes: Any) -> dict[str, Any]:
    """Attributes of a dataset, those of NumPy as Python's own."""
    return {name: getattr(value, "item", lambda v=value: v)() for name, value in attributes.items()}
