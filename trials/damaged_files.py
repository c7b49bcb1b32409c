"""Damage of files, drawn at random: bits, cuts, zeros, noise, other content; files gone, empty, swapped, copied over.

Each mutation takes files of one folder and a random generator, changes some, and returns those that it changed. All
content that is written differs from what was there.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Mutation = Callable[[Sequence[Path], np.random.Generator], list[Path]]


def files_of(folder: Path) -> list[Path]:
    """Files of a campaign's store and its checksums, in a fixed order."""
    found = (path for part in ("flights.zarr", "checksums") for path in (folder / part).rglob("*"))
    return sorted(path for path in found if path.is_file())


def flip_bit(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Turn one bit of a file."""
    path, content = _any(files, draw)
    place = draw.integers(len(content))
    content[place] ^= 1 << draw.integers(8)
    return _written(path, content)


def flip_bytes(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Turn eight bytes of a file round."""
    path, content = _any(files, draw)
    for place in np.unique(draw.integers(len(content), size=8)):
        content[place] ^= 0xFF
    return _written(path, content)


def cut(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Cut a file anywhere."""
    path, content = _any(files, draw)
    return _written(path, content[: draw.integers(len(content))])


def lengthen(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Write noise behind the end of a file."""
    path, content = _any(files, draw)
    return _written(path, content + draw.bytes(int(draw.integers(1, 300))))


def garble(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Write noise over a part of a file."""
    path, content = _any(files, draw)
    place, size = int(draw.integers(len(content))), int(draw.integers(1, 2000))
    size = min(size, len(content) - place)
    noise = bytearray(draw.bytes(size))
    noise[0] = content[place] ^ 0x55
    content[place : place + size] = noise
    return _written(path, content)


def zero(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Write zeros over a part of a file, from a byte that is none."""
    path, content = _any(files, draw)
    place = int(draw.choice(np.flatnonzero(np.frombuffer(content, np.uint8))))
    size = min(int(draw.integers(1, 2000)), len(content) - place)
    content[place : place + size] = bytes(size)
    return _written(path, content)


def empty(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Take the content of a file away."""
    return _written(_any(files, draw)[0], b"")


def delete(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Delete a file."""
    path, _ = _any(files, draw)
    path.unlink()
    return [path]


def swap(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Put two files of different content into each other's places."""
    path, content = _any(files, draw)
    others = [(other, other.read_bytes()) for other in files if other != path]
    others = [pair for pair in others if pair[1] != content]
    other, its_content = others[draw.integers(len(others))]
    return _written(path, its_content) + _written(other, content)


def copy_over(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Write the content of another file over a file, of its own folder where one differs."""
    path, content = _any(files, draw)
    others = [other.read_bytes() for other in files if other.parent == path.parent]
    others = [other for other in others if other != content]
    if not others:
        others = [other for other in (any_.read_bytes() for any_ in files) if other != content]
    return _written(path, others[draw.integers(len(others))])


def edit_json(files: Sequence[Path], draw: np.random.Generator) -> list[Path]:
    """Change, remove or add one entry of a JSON document, leaving it JSON."""
    documents = [path for path in files if path.suffix == ".json" or path.name in (".zattrs", ".zarray", ".zmetadata")]
    path = documents[draw.integers(len(documents))]
    document = json.loads(path.read_text(encoding="utf-8"))
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
"""By name, each of which changes files of a folder."""
OF_ONE_FILE = tuple(name for name in MUTATIONS if name not in ("swap", "copy over", "edit JSON"))
"""Those that one binary file is enough for."""


def _any(files: Sequence[Path], draw: np.random.Generator) -> tuple[Path, bytearray]:
    filled = [path for path in files if path.stat().st_size]
    path = filled[draw.integers(len(filled))]
    return path, bytearray(path.read_bytes())


def _written(path: Path, content: bytes | bytearray) -> list[Path]:
    path.write_bytes(content)
    return [path]


def _entry(document: Any, draw: np.random.Generator) -> tuple[Any, Any]:
    """One entry of a document, at any depth: what holds it, and its key there."""
    found: list[tuple[Any, Any]] = []

    def collect(holder: Any) -> None:
        keys = holder if isinstance(holder, dict) else range(len(holder)) if isinstance(holder, list) else ()
        for key in keys:
            found.append((holder, key))
            collect(holder[key])

    collect(document)
    return found[draw.integers(len(found))]
