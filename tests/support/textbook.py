"""The numbers with which Stevens & Lewis computed what they print: those that `anser verify` uses."""

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
