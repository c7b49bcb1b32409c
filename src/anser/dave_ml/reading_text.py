"""What a file says in words, kept as it is."""

from typing import Final

from anser.dave_ml.definition import Note
from anser.dave_ml.elements import Element

NOTES: Final = ("provenance", "provenanceRef", "uncertainty", "confidenceBound")
"""Elements that are kept as notes of what they stand in."""


def whole_note(element: Element) -> Note:
    """An element with all that stands in it."""
    return Note(
        element.tag,
        tuple(element.attributes.items()),
        element.text.strip(),
        tuple(whole_note(child) for child in element.children),
    )


def notes_of(element: Element) -> tuple[Note, ...]:
    """The notes that stand in an element."""
    return tuple(whole_note(child) for child in element.all(*NOTES))


def description_of(element: Element) -> str:
    """The description in an element, its blanks and line breaks as one blank each."""
    found = element.first("description")
    return "" if found is None else " ".join(found.text.split())
