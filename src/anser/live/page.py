"""The page as one HTML file: live, or recorded with its answers and without a server."""

from collections.abc import Mapping, Sequence
from typing import Any

from anser.report.page_templates import render_page
from anser.report.style import COLORS

_STYLES = ("page.css", "anser.live:live.css")
_REPORT_SCRIPTS = (
    *("vendor/three.min.js", "theme.js", "store.js", "timeline.js", "plots.js"),
    *("scene_parts.js", "scene_goals.js", "scene_eyes.js", "scene_labels.js", "scene.js"),
)
_LIVE_SCRIPTS = (
    *("scenario.js", "connection.js", "drawing.js", "map.js", "profile.js", "scene_view.js"),
    *("inputs.js", "answer_panel.js", "flights.js", "file_dialogs.js", "live.js"),
)


def render_live_page(recording: Sequence[Mapping[str, Any]] | None = None) -> str:
    """Return the HTML of the live page, or of a page with recorded answers that needs no server.

    An entry of `recording` has the keys label, scenario and answer.
    """
    return render_page(
        "live.html",
        package="anser.live",
        body_class="live" if recording is None else "live recorded",
        styles=_STYLES,
        scripts=(*_REPORT_SCRIPTS, *(f"anser.live:{name}" for name in _LIVE_SCRIPTS)),
        data=("live", {"colors": len(COLORS), "recording": None if recording is None else list(recording)}),
        title="Scenario" if recording is None else str(recording[0]["label"]),
    )
