"""What a refused DAVE-ML file says: where, what arrived, and what would be right."""

from typing import Final

_SHOWN_MAX: Final = 80


class DaveMlError(ValueError):
    """A DAVE-ML file that cannot be read, or a model that cannot be built from it; ``str()`` is one line.

    Parameters
    ----------
    name
        The file, or another name of the place that the text came from.
    arrived
        What stands there.
    expected
        What would be right.
    line, column
        Place in the file, counted from 1; None for the file as a whole.
    """

    def __init__(self, name: str, arrived: str, expected: str, line: int | None = None, column: int | None = None):
        self.name = name
        self.arrived = arrived
        self.expected = expected
        self.line = line
        self.column = column
        super().__init__(name, arrived, expected, line, column)

    def __str__(self) -> str:
        place = "" if self.line is None else f", line {self.line}, column {self.column}"
        return f"{self.name or 'DAVE-ML'}{place}: arrived {self.arrived}; expected {self.expected}"


def shown(text: str) -> str:
    """A text that arrived, in quotes, on one line and not too long."""
    quoted = f'"{text}"' if text.isprintable() else repr(text)
    return quoted if len(quoted) <= _SHOWN_MAX + 2 else f'{quoted[:_SHOWN_MAX]}..." ({len(text)} characters)'
