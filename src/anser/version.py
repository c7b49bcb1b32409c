"""Version of the package, and the commit of its source.

An installed wheel carries both from the clone in which the wheel was built. A clone, also as an editable install, asks
git on the first use, so that neither needs a new installation after a commit.
"""

import functools
import importlib.metadata
import json
import os
import re
import subprocess
from pathlib import Path
from typing import Final, NamedTuple

BUILD_INFO: Final = "build_info.json"
"""File of an installed package and of a source distribution, with the commit; a clone has none."""
UNKNOWN: Final = "unknown"
_DESCRIPTION = re.compile(r"v?(?P<tag>\d[^-]*)-(?P<distance>\d+)-g(?P<commit>[0-9a-f]{40})(?P<dirty>-dirty)?")
_NODE_LENGTH = 9
"""Number of the commit's digits in a version, as hatch-vcs writes it."""


class SourceVersion(NamedTuple):
    """Version (PEP 440), and commit: 40 hexadecimal digits, followed by "-dirty" if files differ from it."""

    version: str
    commit: str


@functools.cache
def source_version() -> SourceVersion:
    """Return version and commit of the running package; the commit is "unknown" if neither wheel nor git has it."""
    package = Path(__file__).parent
    cloned = None if (package / BUILD_INFO).exists() else read_clone(package.parents[1])
    return SourceVersion(importlib.metadata.version("anser"), read_commit(package)) if cloned is None else cloned


def read_commit(package: Path) -> str:
    """Return the commit from which an installed package was built."""
    info = package / BUILD_INFO
    return json.loads(info.read_text(encoding="utf-8"))["commit"] if info.exists() else UNKNOWN


def read_clone(root: Path) -> SourceVersion | None:
    """Return version and commit of a clone; None for other folders, and without git.

    The versions are those of hatch-vcs: before the first tag 0.1.dev3+g0123456789, at the tag v0.1.0 0.1.0, three
    commits later 0.1.1.dev3+g0123456789. Uncommitted changes append ".dirty" instead of a date, so that an edited clone
    has the same version on the next day.
    """
    if not (root / ".git").exists():
        return None
    description = _git(root, "describe", "--tags", "--long", "--dirty", "--abbrev=40", "--match", "v[0-9]*")
    if description is None:
        commit = _git(root, "describe", "--always", "--dirty", "--abbrev=40", "--exclude", "*")
        description = f"0.0-{_git(root, 'rev-list', '--count', 'HEAD')}-g{commit}"
    match = _DESCRIPTION.fullmatch(description)
    if match is None:
        return None
    dirty = match["dirty"] or ""
    return SourceVersion(
        _format_version(match["tag"], int(match["distance"]), match["commit"], bool(dirty)), match["commit"] + dirty
    )


def _format_version(tag: str, distance: int, commit: str, dirty: bool) -> str:
    if not distance and not dirty:
        return tag
    next_version = re.sub(r"\d+$", lambda digits: str(int(digits[0]) + 1), tag)
    return f"{next_version}.dev{distance}+g{commit[:_NODE_LENGTH]}{'.dirty' if dirty else ''}"


def _git(root: Path, *arguments: str) -> str | None:
    """Return the output of a git command that only reads; None if git is missing or fails."""
    # GIT_DIR and the like, set within a hook of another repository, would name that repository
    environment = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}
    try:
        completed = subprocess.run(
            ["git", "-C", str(root), *arguments],
            capture_output=True,
            text=True,
            check=False,
            env=environment | {"GIT_OPTIONAL_LOCKS": "0"},
        )
    except OSError:
        return None
    return completed.stdout.strip() if completed.returncode == 0 else None
