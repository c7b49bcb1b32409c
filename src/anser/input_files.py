"""Input files, read up to a greatest size, and the text of XML in the encoding that it declares."""

import codecs
import errno
import re
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final

MIB: Final = 1 << 20
XML_ENCODINGS: Final = ("UTF-8", "UTF-16", "ISO-8859-1", "US-ASCII", "windows-1252")
_XML_ENCODING = re.compile(rb"""\s*<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")


def read_file(path: Path | Traversable, size_max: int = 8 * MIB) -> bytes:
    """Content of a file; a device or a file of gigabytes is refused before it fills the memory.

    Parameters
    ----------
    path
        The file.
    size_max
        Greatest size that is read, bytes.

    Raises
    ------
    OSError
        The file cannot be read or is larger.
    ValueError
        The path holds a null character.
    """
    with path.open("rb") as file:
        content = file.read(size_max + 1)
    if len(content) > size_max:
        raise OSError(errno.EFBIG, f"more than {size_max:,} bytes", str(path))
    return content


def xml_text(content: bytes) -> str:
    """Text of an XML document in the encoding that it declares.

    Raises
    ------
    LookupError
        The encoding is none of `XML_ENCODINGS`.
    UnicodeDecodeError
        The document is not in that encoding.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
    declared = None if content.startswith(codecs.BOM_UTF8) else _XML_ENCODING.match(content)
    if declared is None:
        return content.decode("utf-8-sig")
    name = declared[1].decode("ascii")
    if name.lower() not in map(str.lower, XML_ENCODINGS):
        raise LookupError(f'the encoding "{name}"')
    return content.decode(name)
