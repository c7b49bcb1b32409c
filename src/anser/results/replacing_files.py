"""Files that take the places of others of the same names, all of them or none."""

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replaced_within(folder: Path) -> Iterator[Path]:
    """Give a new, empty folder to write into; at the end its files go to their places in `folder`.

    Files of the same names are replaced, each by one that is complete; all others in `folder` are left alone. Where the
    block raises, nothing in `folder` has changed.

    Parameters
    ----------
    folder
        That exists.

    Raises
    ------
    FileExistsError
        A folder stands where a file is to go: then nothing is replaced.
    """
    with tempfile.TemporaryDirectory(dir=folder, prefix=".anser-") as place:
        beside = Path(place)
        yield beside
        places = {one: folder / one.relative_to(beside) for one in sorted(beside.rglob("*")) if one.is_file()}
        for target in places.values():
            if target.is_dir():
                raise FileExistsError(f"{target} is a folder, which no file replaces")
        for written, target in places.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            written.replace(target)
