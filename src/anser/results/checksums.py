"""Checksums of result files, verified before anything in a file is believed.

A binary file ends with its checksum, behind the end that its own format knows: NetCDF (HDF5), NumPy's arrays and
archives are read as ever by programs that know nothing of it. A JSON document holds its checksum under the key
`sha256`.
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
"""Of the checksum in a JSON document."""
_BLOCK_BYTES = 1 << 20
_DOCUMENT_BYTES_MAX = 32 * MIB


class DamagedFileError(ValueError):
    """A file whose content is not what was written; `str()` is the finished message."""


def damaged_file_error(path: Path, arrived: str, expected: str = "the file as anser wrote it") -> DamagedFileError:
    """Error that names a file, what arrived in it and what would be right."""
    return DamagedFileError(f"{path}: arrived {arrived}; expected {expected}")


def append_checksum(path: Path) -> None:
    """Append the checksum of a complete binary file to it."""
    trailer = checksum_trailer(file_digest(path))
    with path.open("ab") as file:
        file.write(trailer)


def checksum_trailer(digest: str) -> bytes:
    """Last bytes of a file whose other bytes have this SHA-256 (hexadecimal)."""
    return _MARK + digest.encode() + b"\n"


def verify_checksum(path: Path) -> bool:
    """Compare the content of a binary file with the checksum at its end.

    Returns
    -------
    Whether the file has one: files of older versions have none.

    Raises
    ------
    DamagedFileError
        The content differs from the checksum.
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
    """SHA-256 of the first `size` bytes of a file, or of all, hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        left = path.stat().st_size if size is None else size
        while block := file.read(min(left, _BLOCK_BYTES)):
            digest.update(block)
            left -= len(block)
    return digest.hexdigest()


def add_checksum(document: Mapping[str, Any]) -> dict[str, Any]:
    """A JSON document with the checksum of its content as its last key."""
    content = {key: value for key, value in document.items() if key != CHECKSUM_KEY}
    return {**content, CHECKSUM_KEY: _content_digest(content)}


def read_document(path: Path) -> tuple[dict[str, Any], bool]:
    """Read a JSON document without its checksum, and whether it has one: those of older versions have none.

    Raises
    ------
    DamagedFileError
        The file is no JSON object, or its content differs from its checksum.
    OSError
        The file cannot be read, or is larger than 32 MiB.
    """
    try:
        document = json.loads(read_file(path, _DOCUMENT_BYTES_MAX).decode(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:  # text that is no UTF-8 is a ValueError, too
        raise damaged_file_error(path, f"a file that cannot be read as JSON ({error})") from None
    if not isinstance(document, dict):
        raise damaged_file_error(path, f"JSON that is a {type(document).__name__}", "an object")
    checksum = document.pop(CHECKSUM_KEY, None)
    if checksum is not None and checksum != _content_digest(document):
        raise damaged_file_error(path, "a damaged file, whose content does not match its checksum")
    return document, checksum is not None


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name}, which JSON has not")


def _content_digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of the values, however they are spaced and ordered."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
