"""XML as a tree of elements that know their place; nothing is fetched, expanded or executed, and size is bounded."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final
from xml.parsers import expat

from anser.dave_ml.errors import DaveMlError, shown
from anser.input_files import XML_ENCODINGS, xml_text

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
                raise self.fault(f"attribute {shown(name)} of <{self.tag}>", _one_of("attributes", known))
        single, several = set(once), set(many)
        seen: set[str] = set()
        for child in self.children:
            if child.tag not in single | several:
                raise child.fault(f"<{child.tag}> in <{self.tag}>", _one_of("elements", single | several))
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


def _one_of(kind: str, known: set[str]) -> str:
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
            f"entity {shown(str(name))}", "characters, or the entities of XML: &lt; &gt; &amp; &quot; &apos;"
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
        text = content if isinstance(content, str) else xml_text(content)
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
