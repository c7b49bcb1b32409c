"""Random damage of files: bits, cuts, zeros, noise, changed content; files deleted, emptied, swapped, copied over.

A mutation takes the files of a folder and a random generator, changes some files, and returns the changed ones. The
written content always differs from the original.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Mutation = Callable[[Sequence[Path], np.random.Generator], list[Path]]


def files_of(folder: Path) -> list[Path]:
    """Files of a campaign's store and its checksums, in a fixed order."""
    paths = (path for part in ("flights.zarr", "checksums") for path in (folder / part).rglob("*"))
    return sorted(path for path in paths if path.is_file())


def flip_bit(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Flip one bit of a file."""
    path, content = _any(files, draw)
    position = draw.integers(len(content))
    content[position] ^= 1 << draw.integers(8)
    return _written(path, content)


def flip_bytes(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Invert eight bytes of a file."""
    path, content = _any(files, draw)
    for position in np.unique(draw.integers(len(content), size=8)):
        content[position] ^= 0xFF
    return _written(path, content)


def cut(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Truncate a file at a random position."""
    path, content = _any(files, draw)
    return _written(path, content[: draw.integers(len(content))])


def lengthen(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Append noise to a file."""
    path, content = _any(files, draw)
    return _written(path, content + draw.bytes(int(draw.integers(1, 300))))


def garble(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Overwrite a part of a file with noise."""
    path, content = _any(files, draw)
    position, size = int(draw.integers(len(content))), int(draw.integers(1, 2000))
    size = min(size, len(content) - position)
    noise = bytearray(draw.bytes(size))
    noise[0] = content[position] ^ 0x55
    content[position : position + size] = noise
    return _written(path, content)


def zero(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Overwrite a part of a file with zeros, from a nonzero byte on."""
    path, content = _any(files, draw)
    position = int(draw.choice(np.flatnonzero(np.frombuffer(content, np.uint8))))
    size = min(int(draw.integers(1, 2000)), len(content) - position)
    content[position : position + size] = bytes(size)
    return _written(path, content)


def empty(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Remove the content of a file."""
    return _written(_any(files, draw)[0], b"")


def delete(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Delete a file."""
    path, _ = _any(files, draw)
    path.unlink()
    return [path]


def swap(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Exchange two files of different content."""
    path, content = _any(files, draw)
    candidates = [(second_path, second_path.read_bytes()) for second_path in files if second_path != path]
    candidates = [candidate for candidate in candidates if candidate[1] != content]
    second_path, second_content = candidates[draw.integers(len(candidates))]
    return _written(path, second_content) + _written(second_path, content)


def copy_over(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Overwrite a file with the content of another file, preferably of the same folder."""
    path, content = _any(files, draw)
    contents = [candidate.read_bytes() for candidate in files if candidate.parent == path.parent]
    contents = [candidate for candidate in contents if candidate != content]
    if not contents:
        contents = [candidate for candidate in (file.read_bytes() for file in files) if candidate != content]
    return _written(path, contents[draw.integers(len(contents))])


def edit_json(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Change or remove one entry of a JSON document that is not empty; the result is valid JSON."""
    paths = [path for path in files if path.suffix == ".json" or path.name in (".zattrs", ".zarray", ".zmetadata")]
    documents = [(path, json.loads(path.read_text(encoding="utf-8"))) for path in paths]
    documents = [candidate for candidate in documents if candidate[1]]
    path, document = documents[draw.integers(len(documents))]
    holder, key = _entry(document, draw)
    kind, value = draw.integers(4), holder[key]
    if kind == 0:
        del holder[key]
    elif kind == 1:
        holder[key] = None if value is not None else 1
    elif kind == 2 and isinstance(value, int | float) and not isinstance(value, bool):
        holder[key] = value + 1
    else:
        holder[key] = [value] if draw.integers(2) else "changed"
    path.write_text(json.dumps(document), encoding="utf-8")
    return [path]


MUTATIONS: dict[str, Mutation] = {
    "flip one bit": flip_bit,
    "flip eight bytes": flip_bytes,
    "cut": cut,
    "lengthen": lengthen,
    "garble": garble,
    "zero": zero,
    "empty": empty,
    "delete": delete,
    "swap": swap,
    "copy over": copy_over,
    "edit JSON": edit_json,
}
"""Mutations by name."""
OF_ONE_FILE = tuple(name for name in MUTATIONS if name not in ("swap", "copy over", "edit JSON"))
"""Mutations applicable to a single binary file."""


def _any(files: Sequence[Path], draw: np.random.Generator) -> tuple[Path, bytearray]:
    filled = [path for path in files if path.stat().st_size]
    path = filled[draw.integers(len(filled))]
    return path, bytearray(path.read_bytes())


def _written(path: Path, content: bytes | bytearray) -> list[Path]:
    path.write_bytes(content)
    return [path]


def _entry(document: Any, draw: np.random.Generator) -> tuple[Any, Any]:
    """A random entry of a document, at any depth: its container and its key."""
    entries: list[tuple[Any, Any]] = []

    def collect(holder: Any) -> None:
        keys = holder if isinstance(holder, dict) else range(len(holder)) if isinstance(holder, list) else ()
        for key in keys:
            entries.append((holder, key))
            collect(holder[key])

    collect(document)
    return entries[draw.integers(len(entries))]
