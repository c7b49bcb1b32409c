"""Checksums of result files, verified before any content is used.

In a binary file, the checksum follows the end of the format's data: programs for NetCDF (HDF5) and NumPy files ignore
the trailing bytes. A JSON document has the checksum under the key `sha256`.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anser.files import MIB, read_file

_MARK = b"\nanser-sha256:"
TRAILER_BYTES = len(_MARK) + 64 + 1
CHECKSUM_KEY = "sha256"
"""Key of the checksum in a JSON document."""
_BLOCK_BYTES = 1 << 20
_DOCUMENT_BYTES_MAX = 32 * MIB


class DamagedFileError(ValueError):
    """Error for a file whose content is damaged; `str()` is the complete message."""


def damaged_file_error(path: Path, arrived: str, expected: str = "the file as anser wrote it") -> DamagedFileError:
    """Return the error for a damaged file, with its path, the content found (`arrived`) and the content expected."""
    return DamagedFileError(f"{path}: arrived {arrived}; expected {expected}")


def append_checksum(path: Path) -> None:
    """Append to a complete binary file the checksum of its content."""
    trailer = checksum_trailer(file_digest(path))
    with path.open("ab") as file:
        file.write(trailer)


def checksum_trailer(digest: str) -> bytes:
    """Return the bytes that carry a SHA-256 (hexadecimal `digest`) at the end of a file."""
    return _MARK + digest.encode() + b"\n"


def verify_checksum(path: Path) -> bool:
    """Verify the content of a binary file by the checksum at its end.

    Returns whether the file has a checksum; files of older versions have none.

    Raises DamagedFileError if the content differs from the checksum.
    """
    size = path.stat().st_size - TRAILER_BYTES
    if size < 0:
        return False
    with path.open("rb") as file:
        file.seek(size)
        trailer = file.read()
    if not trailer.startswith(_MARK):
        return False
    if trailer != checksum_trailer(file_digest(path, size)):
        raise damaged_file_error(path, "a damaged file, whose content does not match its checksum")
    return True


def file_digest(path: Path, size: int | None = None) -> str:
    """Return the SHA-256, hexadecimal, of the first `size` bytes of a file; of the whole file if None."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        bytes_left = path.stat().st_size if size is None else size
        while block := file.read(min(bytes_left, _BLOCK_BYTES)):
            digest.update(block)
            bytes_left -= len(block)
    return digest.hexdigest()


def add_checksum(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a JSON document with the checksum of its content as the last key."""
    content = {key: value for key, value in document.items() if key != CHECKSUM_KEY}
    return {**content, CHECKSUM_KEY: _content_digest(content)}


def read_document(path: Path) -> tuple[dict[str, Any], bool]:
    """Read a JSON document and verify its checksum.

    Returns the document without its checksum, and whether it has a checksum; documents of older versions have none.

    Raises DamagedFileError if the file is not a JSON object, or the content differs from the checksum. Raises OSError
    if the file cannot be read, or is larger than 32 MiB.
    """
    try:
        document = json.loads(read_file(path, _DOCUMENT_BYTES_MAX).decode(), parse_constant=_reject_constant)
    except (ValueError, RecursionError) as error:  # invalid UTF-8 is a ValueError, too
        raise damaged_file_error(path, f"a file that cannot be read as JSON ({error})") from None
    if not isinstance(document, dict):
        raise damaged_file_error(path, f"JSON that is a {type(document).__name__}", "an object")
    checksum = document.pop(CHECKSUM_KEY, None)
    if checksum is not None and checksum != _content_digest(document):
        raise damaged_file_error(path, "a damaged file, whose content does not match its checksum")
    return document, checksum is not None


def _reject_constant(name: str) -> None:
    raise ValueError(f"{name}, which JSON has not")


def _content_digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a document's values, independent of spacing and order of the keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
