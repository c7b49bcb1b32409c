"""Checksums (SHA-256) of result files, verified before the content is used.

A binary file has the checksum at its end, which programs for NetCDF (HDF5) and NumPy files ignore. A JSON document has
the checksum under the key `sha256`.
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
    """Return the error for a damaged file; `arrived` says what the file contains, `expected` what is required."""
    return DamagedFileError(f"{path}: arrived {arrived}; expected {expected}")


def append_checksum(path: Path) -> None:
    """Append the checksum of a complete binary file to the file."""
    trailer = checksum_trailer(file_digest(path))
    with path.open("ab") as file:
        file.write(trailer)


def checksum_trailer(digest: str) -> bytes:
    """Return the bytes at the end of a binary file that contain the SHA-256 `digest`, hexadecimal."""
    return _MARK + digest.encode() + b"\n"


def verify_checksum(path: Path) -> bool:
    """Verify a binary file by the checksum at its end; return False if the file has no checksum, as in older versions.

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
    """Return the SHA-256 (64 hexadecimal digits) of the first `size` bytes of a file; None: of the whole file."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        bytes_left = path.stat().st_size if size is None else size
        while block := file.read(min(bytes_left, _BLOCK_BYTES)):
            digest.update(block)
            bytes_left -= len(block)
    return digest.hexdigest()


def add_checksum(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a JSON document with an additional last key `sha256`, the checksum of the other values."""
    content = {key: value for key, value in document.items() if key != CHECKSUM_KEY}
    return {**content, CHECKSUM_KEY: _content_digest(content)}


def read_document(path: Path) -> tuple[dict[str, Any], bool]:
    """Return a JSON document without its checksum, and whether the file has a checksum; older files have none.

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
    """Return the SHA-256, hexadecimal, of a document's content; spacing and order of the keys have no effect."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
