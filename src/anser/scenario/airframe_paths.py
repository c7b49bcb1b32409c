"""Aircraft files of a scenario, whose contents take the places of their paths: it holds all that it flies."""

from pathlib import Path
from typing import Any

from anser.scenario.airframe_file import AirframeFile, DaveMlFile, read_airframe
from anser.scenario.errors import Problem, ScenarioError, show

_BESIDE = ("type", "variant", "x_cg_over_c")


def with_airframes(values: dict[str, Any], source: str) -> dict[str, Any]:
    """Values of a scenario, aircraft files in the places of their paths.

    Parameters
    ----------
    values
        As the TOML file would hold them; not validated.
    source
        Path of the scenario's file, from whose folder paths are seen, or what it is called.

    Raises
    ------
    ScenarioError
        If an aircraft file cannot be read or is no valid aircraft, or stands beside a key of the library's airframes.
    """
    fleet = values.get("aircraft")
    if not isinstance(fleet, list | tuple) or not any(_path_of(one) for one in fleet):
        return values
    read: dict[Path, AirframeFile | DaveMlFile] = {}
    found, problems = [], []
    for k, one in enumerate(fleet):
        path = _path_of(one)
        if path is None:
            found.append(one)
            continue
        beside = [key for key in _BESIDE if one.get(key) is not None]
        if beside:
            words = "either airframe, the path of a file, or type with its variant; not both"
            arrived = f"{show(path)} beside {beside[0]} = {show(one[beside[0]])}"
            problems.append(Problem(f"aircraft[{k}].airframe", arrived, words))
            continue
        place = Path(source).parent / path
        if place not in read:
            read[place] = read_airframe(place)
        found.append({**one, "airframe": read[place]})
    if problems:
        raise ScenarioError(source, problems)
    return {**values, "aircraft": found}


def _path_of(one: object) -> str | None:
    path = one.get("airframe") if isinstance(one, dict) else None
    return path if isinstance(path, str) else None
