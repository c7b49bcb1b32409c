"""The constants behind the printed results of Stevens & Lewis, as used by `anser verify`."""

from anser.verification.textbook import (
    TextbookAtmosphere,
    TextbookF16,
    textbook_aircraft,
    textbook_controls,
    textbook_environment,
    textbook_rates,
    textbook_state,
)

__all__ = [
    "TextbookAtmosphere",
    "TextbookF16",
    "textbook_aircraft",
    "textbook_controls",
    "textbook_environment",
    "textbook_rates",
    "textbook_state",
]
