"""A scenario to start from, with every key, its default and its unit."""

import os
from importlib.resources import files
from pathlib import Path

from anser.scenario.errors import reason_of, refused


def starter_scenario() -> str:
    """Text (TOML) of the starter scenario: two aircraft, two drifting buoys, every key commented; a valid one."""
    return files("anser.scenario").joinpath("starter.toml").read_text(encoding="utf-8")


def write_starter(path: str | os.PathLike[str]) -> Path:
    """Write the starter scenario to a new file, and return its path.

    Raises
    ------
    ScenarioError
        If something of this name is there already (it is left alone), or the file cannot be written.
    """
    return write_new(path, starter_scenario())


def write_new(path: str | os.PathLike[str], text: str) -> Path:
    """Write a scenario's text to a new file; raises as `write_starter` does."""
    target = Path(path)
    try:
        with target.open("x", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
    except FileExistsError:
        raise refused(str(target), "a name that is taken", "the name of a new file; nothing was written") from None
    except FileNotFoundError:
        raise refused(str(target), "a folder that does not exist", "the name of a file in a folder that does") from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be written ({reason_of(error)})"
        raise refused(str(target), arrived, "the name of a file that can be written") from None
    return target
