"""Numbers as they stand in a file: finite, in decimal notation, and not too many."""

import math
from typing import Final

import numpy as np

from anser.dave_ml.elements import Element
from anser.dave_ml.errors import shown

TABLE_NUMBERS_MAX: Final = 1_000_000
"""Numbers of one table or list."""
_ALLOWED: Final = frozenset("0123456789+-.eE, \t\r\n")


def number_of(text: str, element: Element, what: str) -> float:
    """One finite number.

    Raises
    ------
    DaveMlError
        The text is none.
    """
    stripped = text.strip()
    if not set(stripped) <= _ALLOWED - {","}:
        raise element.fault(f"{shown(stripped)} as {what}", "a number such as -1.5e3")
    try:
        value = float(stripped)
    except ValueError:
        raise element.fault(f"{shown(stripped)} as {what}", "a number such as -1.5e3") from None
    if not math.isfinite(value):
        raise element.fault(f"{shown(stripped)} as {what}", "a number that 64 bits can hold")
    return value


def optional_number(element: Element, attribute: str) -> float | None:
    """The number of an attribute; None where it is missing."""
    if attribute not in element.attributes:
        return None
    return number_of(element.attributes[attribute], element, attribute)


def numbers_of(element: Element, what: str) -> np.ndarray:
    """The numbers in an element, separated by commas or white space; shape (n,), at least one.

    Raises
    ------
    DaveMlError
        One is no finite number, there is none, or there are too many.
    """
    strange = set(element.text) - _ALLOWED
    if strange:
        token = next(word for word in element.text.replace(",", " ").split() if strange & set(word))
        raise element.fault(f"{shown(token)} in {what}", "numbers such as -1.5e3, with commas or blanks between")
    words = element.text.replace(",", " ").split(None, TABLE_NUMBERS_MAX)
    if len(words) > TABLE_NUMBERS_MAX:
        raise element.fault(f"more than {TABLE_NUMBERS_MAX:,} numbers in {what}", "fewer")
    if not words:
        raise element.fault(f"no numbers in {what}", "at least one")
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        token = str(error).partition(": ")[2].strip("'")
        raise element.fault(f"{shown(token)} in {what}", "numbers such as -1.5e3") from None
    if not np.all(np.isfinite(values)):
        token = words[int(np.flatnonzero(~np.isfinite(values))[0])]
        raise element.fault(f"{shown(token)} in {what}", "numbers that 64 bits can hold")
    return values
