"""Published check figures, as used by `anser verify`."""

from anser.verification.checks import load_published as reference

__all__ = ["reference"]
