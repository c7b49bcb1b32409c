"""Published check figures: those that `anser verify` uses."""

from anser.verification.published import published as reference

__all__ = ["reference"]
