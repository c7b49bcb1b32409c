"""An aircraft file to start from, with its keys, their defaults and units."""

import os
from importlib.resources import files
from pathlib import Path

from anser.scenario.template import write_new


def airframe_starter() -> str:
    """Text (TOML) of the starter: a light aircraft, every key commented; a valid one."""
    return files("anser.scenario.airframe_file").joinpath("starter.toml").read_text(encoding="utf-8")


def write_airframe_starter(path: str | os.PathLike[str]) -> Path:
    """Write the starter to a new file, and return its path; raises ScenarioError where it cannot."""
    return write_new(path, airframe_starter())
