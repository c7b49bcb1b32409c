"""Published check figures: those that `anser verify` uses."""

from anser.verification.checks import load_published as reference

__all__ = ["reference"]
