"""XML elements with their position in the file, number parsing, and the error for invalid files.

The parser refuses entities, fetches nothing, and limits the size of the file and the depth of nesting.
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
    """A DAVE-ML file is invalid, or no model can be built from the file; ``str()`` is one line.

    `name` is the name of the file; line and column count from 1 and are None for a fault of the whole file.
    """

    def __init__(self, name: str, arrived: str, expected: str, line: int | None = None, column: int | None = None):
        self.name = name
        self.arrived = arrived
        self.expected = expected
        self.line = line
        self.column = column
        super().__init__(name, arrived, expected, line, column)

    def __str__(self) -> str:
        position = "" if self.line is None else f", line {self.line}, column {self.column}"
        return f"{self.name or 'DAVE-ML'}{position}: arrived {self.arrived}; expected {self.expected}"


def quote(text: str) -> str:
    """Return a text in quotation marks for a message, on one line, cut after 80 characters."""
    quoted = f'"{text}"' if text.isprintable() else repr(text)
    return quoted if len(quoted) <= _SHOWN_MAX + 2 else f'{quoted[:_SHOWN_MAX]}..." ({len(text)} characters)'


FILE_BYTES_MAX: Final = 8 * 2**20
"""Greatest size of a file, bytes."""
NESTING_MAX: Final = 100
"""Greatest depth of nested elements."""
ELEMENTS_MAX: Final = 100_000
"""Greatest number of elements in a file."""


@dataclass(slots=True, eq=False)
class Element:
    """XML element with the position of its start tag in the file; line and column count from 1.

    The namespace prefix is removed from `tag`, but not from the names of attributes. `text` excludes the text of
    children.
    """

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    column: int
    text: str = ""
    children: list["Element"] = field(default_factory=list)

    def fault(self, arrived: str, expected: str) -> DaveMlError:
        """Return an error at this element; `arrived` describes the faulty content, `expected` the correct one."""
        return DaveMlError(self.file, arrived, expected, self.line, self.column)

    def permit(self, attributes: Iterable[str] = (), once: Iterable[str] = (), repeatable: Iterable[str] = ()) -> None:
        """Raise DaveMlError for attributes and children that no argument lists, and for repeated children in `once`.

        Attributes of XML itself (``xml...``) and attributes with a namespace prefix are always permitted.
        """
        attribute_names = set(attributes)
        for name in self.attributes:
            if name not in attribute_names and not name.startswith("xml") and ":" not in name:
                arrived = f"attribute {quote(name)} of <{self.tag}>"
                raise self.fault(arrived, _format_choices("attributes", attribute_names))
        single_tags, tags = set(once), {*once, *repeatable}
        present_tags: set[str] = set()
        for child in self.children:
            if child.tag not in tags:
                raise child.fault(f"<{child.tag}> in <{self.tag}>", _format_choices("elements", tags))
            if child.tag in single_tags and child.tag in present_tags:
                raise child.fault(f"a second <{child.tag}> in <{self.tag}>", "one")
            present_tags.add(child.tag)

    def all(self, *tags: str) -> list["Element"]:
        """Return the children whose tag is among `tags`, in file order."""
        return [child for child in self.children if child.tag in tags]

    def first(self, *tags: str) -> "Element | None":
        """Return the first child whose tag is among `tags`; None if no child has such a tag."""
        return next(iter(self.all(*tags)), None)

    def require(self, *tags: str) -> "Element":
        """Return the first child whose tag is among `tags`. Raises DaveMlError if no child has such a tag."""
        child = self.first(*tags)
        if child is None:
            raise self.fault(f"<{self.tag}> without <{tags[0]}>", f"<{'> or <'.join(tags)}> in it")
        return child

    def attribute(self, name: str) -> str:
        """Return the value of a required attribute without outer blanks.

        Raises DaveMlError if the attribute is absent or, except for `units`, empty.
        """
        value = self.attributes.get(name, "").strip()
        if name not in self.attributes or not (value or name == "units"):
            raise self.fault(f"<{self.tag}> without attribute {name}", f'{name}="..."')
        return value


def _format_choices(kind: str, permitted: set[str]) -> str:
    return f"{kind} {', '.join(sorted(permitted))}" if permitted else f"no {kind}"


class _Builder:
    """Handlers of an Expat parser that build the tree of elements; `root` is None before the first element."""

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
        expected = "characters, or the entities of XML: &lt; &gt; &amp; &quot; &apos;"
        raise self.fault(f"entity {quote(str(name))}", expected)

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
    """Parse an XML document (bytes in the declared encoding) and return its root element.

    `name` is the file name in messages. Raises DaveMlError if the document is not well-formed XML in a supported
    encoding, declares entities, uses entities other than the five of XML, or exceeds the limits of this module.
    """
    if len(content) > FILE_BYTES_MAX:
        raise DaveMlError(name, f"{len(content):,} bytes", f"at most {FILE_BYTES_MAX:,}")
    try:
        text = content if isinstance(content, str) else decode_xml(content)
        data = text.removeprefix("\ufeff").encode()
    except UnicodeEncodeError as error:
        raise DaveMlError(name, f"character {error.object[error.start]!r}", "text of Unicode") from None
    except UnicodeDecodeError as error:
        arrived = f"bytes that are not {error.encoding}"
        raise DaveMlError(name, arrived, "text in the encoding that it declares") from None
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
"""Greatest number of values in a table or in a list of numbers."""
_ALLOWED: Final = frozenset("0123456789+-.eE, \t\r\n")


def parse_number(text: str, element: Element, description: str) -> float:
    """Parse one finite number; `description` names the number in messages.

    Raises DaveMlError, at `element`, if the text is not a finite number.
    """
    stripped = text.strip()
    try:
        if not set(stripped) <= _ALLOWED - {","}:
            raise ValueError
        value = float(stripped)
    except ValueError:
        raise element.fault(f"{quote(stripped)} as {description}", "a number such as -1.5e3") from None
    if not math.isfinite(value):
        raise element.fault(f"{quote(stripped)} as {description}", "a number that 64 bits can hold")
    return value


def optional_number(element: Element, attribute: str) -> float | None:
    """Return the number in an attribute, None if absent. Raises DaveMlError if the text is no finite number."""
    if attribute not in element.attributes:
        return None
    return parse_number(element.attributes[attribute], element, attribute)


def parse_numbers(element: Element, description: str) -> np.ndarray:
    """Return the numbers in the text of an element, separated by commas or white space, as an array of shape (n,).

    Raises DaveMlError if the text has no numbers, more than `TABLE_NUMBERS_MAX`, or a word that is no finite number.
    `description` names the numbers in the message.
    """
    invalid_characters = set(element.text) - _ALLOWED
    if invalid_characters:
        token = next(t for t in element.text.replace(",", " ").split() if invalid_characters & set(t))
        raise element.fault(f"{quote(token)} in {description}", "numbers such as -1.5e3, with commas or blanks between")
    tokens = element.text.replace(",", " ").split(None, TABLE_NUMBERS_MAX)
    if len(tokens) > TABLE_NUMBERS_MAX:
        raise element.fault(f"more than {TABLE_NUMBERS_MAX:,} numbers in {description}", "fewer")
    if not tokens:
        raise element.fault(f"no numbers in {description}", "at least one")
    try:
        values = np.array([float(token) for token in tokens])
    except ValueError as error:
        token = str(error).partition(": ")[2].strip("'")
        raise element.fault(f"{quote(token)} in {description}", "numbers such as -1.5e3") from None
    if not np.all(np.isfinite(values)):
        token = tokens[int(np.flatnonzero(~np.isfinite(values))[0])]
        raise element.fault(f"{quote(token)} in {description}", "numbers that 64 bits can hold")
    return values
