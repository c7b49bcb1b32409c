"""The live page from Python: inline in a notebook, or in a browser."""

import html
import os
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anser.config.toml_text import read_text
from anser.scenario.files import parse_scenario
from anser.scenario.schema import Scenario
from anser.scenario.user_parts import UserParts

if TYPE_CHECKING:
    from anser.live.server import LiveServer

MISSING = "the live page needs starlette, uvicorn, websockets and tomlkit: pip install 'anser[live]'"
"""Message of the ImportError if the packages of the extra `live` are not installed."""


def open_server(
    scenario: str | os.PathLike[str] | dict[str, Any], folder: Path | None = None, **options: Any
) -> "LiveServer":
    """Start a server of the live page for a scenario file, or for a scenario as nested dictionaries and lists.

    The page opens and saves files in `folder`; None: folder of the file, or current folder. `options` are options of
    `LiveServer`. Raises ScenarioError if the scenario is not valid. Raises ImportError if the extra `live` is missing.
    """
    try:
        from anser.live.server import LiveServer
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn", "websockets", "tomlkit"):
            raise
        raise ImportError(MISSING) from None
    if isinstance(scenario, dict):
        return LiveServer(scenario, folder or Path.cwd(), prepares=True, **options)
    path = Path(scenario)
    document = parse_scenario(read_text(path), str(path))
    target = path.parent if folder is None else folder
    name = path.name if target.resolve() == path.parent.resolve() else None
    return LiveServer(document, target, name, prepares=True, **options)


class LivePage:
    """A live page, shown inline by a notebook."""

    def __init__(self, server: "LiveServer", height_px: int) -> None:
        self._server, self._height_px = server, height_px

    @property
    def url(self) -> str:
        """Address of the page, on this machine only."""
        return self._server.url

    def close(self) -> None:
        """End the server of the page."""
        self._server.close()

    def __repr__(self) -> str:
        return f"live page at {self.url}"

    def _repr_html_(self) -> str:
        address = html.escape(self.url)
        style = f"width:100%;height:{self._height_px}px;border:0"
        return f'<iframe title="anser live" src="{address}" style="{style}"></iframe>'


def live(scenario: Scenario | str | os.PathLike[str], *, height_px: int = 860) -> LivePage:
    """Show the live page of a scenario: the certified plan follows at once if aircraft, goals or limits are moved.

    A notebook on this machine shows the page inline; elsewhere, open `url` in a browser.

    Parameters
    ----------
    scenario
        From `load`, or the path of a scenario file. The page opens and saves files in the file's folder, or in the
        current folder for a scenario from `load`.
    height_px
        Height of the page in the notebook, pixels.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is not a valid scenario.
    ValueError
        If parts are attached to the scenario as objects, which a saved file could not name.
    ImportError
        If the extra `live` is not installed.
    """
    if isinstance(scenario, Scenario) and scenario._attached_parts:
        names = ", ".join(part.name for part in fields(UserParts) if getattr(scenario._attached_parts, part.name))
        raise ValueError(
            f"live: arrived a scenario with parts attached as objects ({names}), which the page could not save; "
            'expected the parts in the table [parts], such as controller = "my_package:MyClass"'
        )
    source = scenario.model_dump(mode="json", exclude_unset=True) if isinstance(scenario, Scenario) else scenario
    return LivePage(open_server(source, in_notebook=True), height_px)
