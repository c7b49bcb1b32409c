"""Version of the package, and the git commit of its source.

An installed wheel contains version and commit. In a clone, also with an editable install, git gives them when needed.
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
"""Name of the file with the commit in an installed package and in a source distribution; a clone has no such file."""
UNKNOWN: Final = "unknown"
_DESCRIPTION = re.compile(r"v?(?P<tag>\d[^-]*)-(?P<distance>\d+)-g(?P<commit>[0-9a-f]{40})(?P<dirty>-dirty)?")
_NODE_LENGTH = 9
"""Number of hexadecimal digits of the commit in a version, as in versions by hatch-vcs."""


class SourceVersion(NamedTuple):
    """Version and git commit of the source."""

    version: str  # by PEP 440
    commit: str  # 40 hexadecimal digits, with "-dirty" appended if changes are uncommitted; or "unknown"


@functools.cache
def source_version() -> SourceVersion:
    """Return version and commit of the running package: from git in a clone, from the installed package elsewhere."""
    package = Path(__file__).parent
    cloned = None if (package / BUILD_INFO).exists() else read_clone(package.parents[1])
    return SourceVersion(importlib.metadata.version("anser"), read_commit(package)) if cloned is None else cloned


def read_commit(package: Path) -> str:
    """Return the commit from which an installed package was built; "unknown" if the file `BUILD_INFO` is missing."""
    info = package / BUILD_INFO
    return json.loads(info.read_text(encoding="utf-8"))["commit"] if info.exists() else UNKNOWN


def read_clone(root: Path) -> SourceVersion | None:
    """Return version and commit of the clone in folder `root`; None if `root` is no clone, or git is missing.

    Versions are as by hatch-vcs: "0.1.0" at the tag v0.1.0, "0.1.1.dev3+g012345678" three commits later. Uncommitted
    changes append ".dirty".
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
    # ".dirty" instead of the date of hatch-vcs: the version of an edited clone does not change from day to day
    next_version = re.sub(r"\d+$", lambda digits: str(int(digits[0]) + 1), tag)
    return f"{next_version}.dev{distance}+g{commit[:_NODE_LENGTH]}{'.dirty' if dirty else ''}"


def _git(root: Path, *arguments: str) -> str | None:
    """Return the output, stripped, of a git command in folder `root`; None if git is missing or the command fails."""
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
