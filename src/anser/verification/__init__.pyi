from .checks import Check
from .suite import CHECKS, verify

__all__ = [
    "CHECKS",
    "Check",
    "verify",
]
