"""XML elements of a DAVE-ML file with their line and column.

The numbers in them, and the error that a file can cause. Nothing is fetched, expanded or executed, and sizes are
bounded.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final
from xml.parsers import expat

import numpy as np

from anser.files import XML_ENCODINGS, decode_xml

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


def quote(text: str) -> str:
    """A text that arrived, in quotes, on one line and not too long."""
    quoted = f'"{text}"' if text.isprintable() else repr(text)
    return quoted if len(quoted) <= _SHOWN_MAX + 2 else f'{quoted[:_SHOWN_MAX]}..." ({len(text)} characters)'


FILE_BYTES_MAX: Final = 8 * 2**20
"""Size of the largest file that is read."""
NESTING_MAX: Final = 100
"""Elements within elements, and operations within a formula."""
ELEMENTS_MAX: Final = 100_000
"""Elements of a file."""


@dataclass(slots=True, eq=False)
class Element:
    """An XML element.

    Attributes
    ----------
    tag
        Name without its namespace's prefix.
    attributes
        With their prefixes.
    text
        Its own character data, without those of its children.
    children
        In their order.
    file, line, column
        Where it begins, counted from 1.
    """

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    column: int
    text: str = ""
    children: list["Element"] = field(default_factory=list)

    def fault(self, arrived: str, expected: str) -> DaveMlError:
        """The error at this place."""
        return DaveMlError(self.file, arrived, expected, self.line, self.column)

    def permit(self, attributes: Iterable[str] = (), once: Iterable[str] = (), many: Iterable[str] = ()) -> None:
        """Refuse other attributes and children than these, and a second child of those that may stand once.

        Raises
        ------
        DaveMlError
            There is one.
        """
        known = set(attributes)
        for name in self.attributes:
            if name not in known and not name.startswith("xml") and ":" not in name:
                raise self.fault(f"attribute {quote(name)} of <{self.tag}>", _format_choices("attributes", known))
        single, several = set(once), set(many)
        seen: set[str] = set()
        for child in self.children:
            if child.tag not in single | several:
                raise child.fault(f"<{child.tag}> in <{self.tag}>", _format_choices("elements", single | several))
            if child.tag in single and child.tag in seen:
                raise child.fault(f"a second <{child.tag}> in <{self.tag}>", "one")
            seen.add(child.tag)

    def all(self, *tags: str) -> list["Element"]:
        """The children of these names."""
        return [child for child in self.children if child.tag in tags]

    def first(self, *tags: str) -> "Element | None":
        """The first child of one of these names."""
        return next(iter(self.all(*tags)), None)

    def require(self, *tags: str) -> "Element":
        """The first child of one of these names, which has to be there."""
        found = self.first(*tags)
        if found is None:
            raise self.fault(f"<{self.tag}> without <{tags[0]}>", f"<{'> or <'.join(tags)}> in it")
        return found

    def attribute(self, name: str) -> str:
        """An attribute that has to be there, without blanks around it."""
        value = self.attributes.get(name, "").strip()
        if name not in self.attributes or not (value or name == "units"):
            raise self.fault(f"<{self.tag}> without attribute {name}", f'{name}="..."')
        return value


def _format_choices(kind: str, known: set[str]) -> str:
    return f"{kind} {', '.join(sorted(known))}" if known else f"no {kind}"


class _Builder:
    """Handlers of the parser."""

    def __init__(self, name: str, parser: Any) -> None:
        self.name = name
        self.parser = parser
        self.root: Element | None = None
        self.open: list[tuple[Element, list[str]]] = []
        self.count = 0
        parser.buffer_text = True
        parser.StartElementHandler = self.start
        parser.EndElementHandler = self.end
        parser.CharacterDataHandler = self.characters
        parser.StartDoctypeDeclHandler = self.document_type
        parser.EntityDeclHandler = self.entity
        parser.SkippedEntityHandler = self.entity
        parser.ExternalEntityRefHandler = self.entity

    def fault(self, arrived: str, expected: str) -> DaveMlError:
        line, column = self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1
        return DaveMlError(self.name, arrived, expected, line, column)

    def document_type(self, _name: str, _system: str | None, _public: str | None, has_subset: int) -> None:
        if has_subset:
            raise self.fault("a document type with declarations of its own", "a document type by name only, or none")

    def entity(self, name: str, *_more: object) -> int:
        raise self.fault(
            f"entity {quote(str(name))}", "characters, or the entities of XML: &lt; &gt; &amp; &quot; &apos;"
        )

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if self.count > ELEMENTS_MAX:
            raise self.fault(f"more than {ELEMENTS_MAX:,} elements", "fewer")
        if len(self.open) >= NESTING_MAX:
            raise self.fault(f"elements nested more than {NESTING_MAX} deep", "fewer")
        line, column = self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1
        element = Element(tag.rpartition(":")[2], attributes, self.name, line, column)
        if self.open:
            self.open[-1][0].children.append(element)
        else:
            self.root = element
        self.open.append((element, []))

    def end(self, _tag: str) -> None:
        element, texts = self.open.pop()
        element.text = "".join(texts)

    def characters(self, text: str) -> None:
        self.open[-1][1].append(text)


def parse_elements(content: str | bytes, name: str) -> Element:
    """The root element of an XML document.

    Parameters
    ----------
    content
        The document; bytes in the encoding that it declares.
    name
        What errors call it.

    Raises
    ------
    DaveMlError
        It is no well-formed XML, declares or uses an entity of its own, or is too large.
    """
    if len(content) > FILE_BYTES_MAX:
        raise DaveMlError(name, f"{len(content):,} bytes", f"at most {FILE_BYTES_MAX:,}")
    try:
        text = content if isinstance(content, str) else decode_xml(content)
        data = text.removeprefix("\ufeff").encode()
    except UnicodeEncodeError as error:
        raise DaveMlError(name, f"character {error.object[error.start]!r}", "text of Unicode") from None
    except UnicodeDecodeError as error:
        raise DaveMlError(
            name, f"bytes that are not {error.encoding}", "text in the encoding that it declares"
        ) from None
    except LookupError as error:
        raise DaveMlError(name, error.args[0], ", ".join(XML_ENCODINGS), 1, 1) from None
    parser = expat.ParserCreate("utf-8")
    builder = _Builder(name, parser)
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        problem = expat.ErrorString(error.code) or "a fault"
        raise DaveMlError(name, f"no XML: {problem}", "well-formed XML", error.lineno, error.offset + 1) from None
    if builder.root is None:
        raise DaveMlError(name, "no element", "<DAVEfunc>")
    return builder.root


TABLE_NUMBERS_MAX: Final = 1_000_000
"""Numbers of one table or list."""
_ALLOWED: Final = frozenset("0123456789+-.eE, \t\r\n")


def parse_number(text: str, element: Element, what: str) -> float:
    """One finite number.

    Raises
    ------
    DaveMlError
        The text is none.
    """
    stripped = text.strip()
    if not set(stripped) <= _ALLOWED - {","}:
        raise element.fault(f"{quote(stripped)} as {what}", "a number such as -1.5e3")
    try:
        value = float(stripped)
    except ValueError:
        raise element.fault(f"{quote(stripped)} as {what}", "a number such as -1.5e3") from None
    if not math.isfinite(value):
        raise element.fault(f"{quote(stripped)} as {what}", "a number that 64 bits can hold")
    return value


def optional_number(element: Element, attribute: str) -> float | None:
    """The number of an attribute; None where it is missing."""
    if attribute not in element.attributes:
        return None
    return parse_number(element.attributes[attribute], element, attribute)


def parse_numbers(element: Element, what: str) -> np.ndarray:
    """The numbers in an element, separated by commas or white space; shape (n,), at least one.

    Raises
    ------
    DaveMlError
        One is no finite number, there is none, or there are too many.
    """
    strange = set(element.text) - _ALLOWED
    if strange:
        token = next(word for word in element.text.replace(",", " ").split() if strange & set(word))
        raise element.fault(f"{quote(token)} in {what}", "numbers such as -1.5e3, with commas or blanks between")
    words = element.text.replace(",", " ").split(None, TABLE_NUMBERS_MAX)
    if len(words) > TABLE_NUMBERS_MAX:
        raise element.fault(f"more than {TABLE_NUMBERS_MAX:,} numbers in {what}", "fewer")
    if not words:
        raise element.fault(f"no numbers in {what}", "at least one")
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        token = str(error).partition(": ")[2].strip("'")
        raise element.fault(f"{quote(token)} in {what}", "numbers such as -1.5e3") from None
    if not np.all(np.isfinite(values)):
        token = words[int(np.flatnonzero(~np.isfinite(values))[0])]
        raise element.fault(f"{quote(token)} in {what}", "numbers that 64 bits can hold")
    return values
