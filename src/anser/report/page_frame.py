"""Frame of a report page.

One self-contained file with its styles and scripts, and the controls and legends common to every flight.
"""

import base64
import hashlib
from collections.abc import Collection, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from anser.files import write_file
from anser.report.flight_data import goal_form_legend, script_json
from anser.report.style import page_colors


def assemble_page(
    title: str, *, body_class: str, styles: Sequence[str], scripts: Sequence[str], contents: str, data: tuple[str, Any]
) -> str:
    """Assemble a page.

    Parameters
    ----------
    title
        Title of the window; HTML.
    body_class
        CSS class of the body.
    styles, scripts
        File names of assets, in order.
    contents
        HTML of the body.
    data
        Identifier of the script element with the data, and the data.
    """
    programs = [read_asset(name) for name in scripts]
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; \
script-src {" ".join(map(_script_hash, programs))}; img-src data: blob:; connect-src 'none'">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{page_colors()}{"".join(map(read_asset, styles))}</style>
</head>
<body class="{body_class}">
{contents}
<script type="application/json" id="{data[0]}">{script_json(data[1])}</script>
{"".join(f"<script>{program}</script>" for program in programs)}
</body>
</html>
"""


def write_page(text: str, path: Path, *, overwrite: bool) -> None:
    """Write a page atomically: an earlier page remains until the new one is complete.

    Raises
    ------
    FileExistsError
        If `path` exists and `overwrite` is false.
    """
    write_file(path, text, overwrite=overwrite)


def read_asset(name: str) -> str:
    """Text of a style or script of this package."""
    return files("anser.report").joinpath("assets", *name.split("/")).read_text(encoding="utf-8")


def _script_hash(script: str) -> str:
    """Hash of a script for the content security policy; the browser runs no script without a listed hash."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def _legend_entries(marks: Sequence[tuple[str, str]]) -> str:
    return "".join(f'<span><i style="{style}"></i>{text}</span>' for style, text in marks)


def toolbar() -> str:
    """Controls of the scene: view, vertical scale, display of the plan."""
    views = (("overview", "Overview"), ("above", "From above"), ("follow", "Follow"), ("behind", "From behind"))
    buttons = "".join(
        f'<button type="button" data-view="{key}" aria-pressed="{str(key == "overview").lower()}">{label}</button>'
        for key, label in views
    )
    lifts = "".join(f'<option value="{k}">×{k}</option>' for k in (1, 2, 3, 5))
    return (
        f'<div class="toolbar"><span class="group">{buttons}</span>'
        f'<label class="group">Heights <select id="lift">{lifts}</select></label>'
        '<label class="group"><input type="checkbox" id="plans" checked> plan and its renewals</label></div>'
    )


def scene_key(forms: Collection[str], keep_outs: bool) -> str:
    """Legend of the scene; forms of goals and keep-outs are listed if present."""
    entries = [
        ("width:18px;border-top:3px solid var(--c0)", "flown so far"),
        ("width:18px;border-top:1px dashed var(--ink)", "planned"),
        ("width:18px;border-top:1px solid var(--quiet)", "over ground"),
        (
            "width:9px;height:9px;background:var(--c0);transform:rotate(45deg)",
            "rendezvous point of the aircraft's colour",
        ),
        ("width:9px;height:9px;background:var(--c1);border:2px solid var(--ink)", "planned anew"),
    ]
    if keep_outs:
        entries.append(("width:16px;height:7px;border:1px solid var(--limit);border-radius:50%", "where none may be"))
    return (
        '<p class="key"><span class="of-screen">drag: turn (from above: shift); wheel: zoom; right drag: shift; '
        f"click an aircraft: focus</span>{_legend_entries(entries)}{goal_form_legend(forms)}</p>"
    )


EVENTS_KEY = f"""<p class="key">{
    _legend_entries(
        [
            ("width:18px;height:10px;background:var(--approach)", "approach"),
            ("width:18px;height:10px;background:var(--frozen)", "plan frozen"),
            ("width:18px;height:10px;background:var(--hold)", "hold"),
            ("width:1px;height:12px;background:var(--quiet)", "plan fitted to where the goal is now"),
            ("width:1px;height:12px;background:var(--c0)", "corrected"),
            (
                "width:18px;height:3px;border:1px solid var(--quiet)",
                "so many of these that they cannot be told apart here",
            ),
            ("width:3px;height:14px;background:var(--c1)", "planned anew"),
            ("width:3px;height:14px;background:var(--ink)", "last good plan kept"),
            ("width:3px;height:14px;background:var(--c3)", "kept until the goal is known better"),
            ("width:3px;height:14px;background:var(--c5)", "bent as far as the limits allow"),
            ("width:18px;height:5px;background:var(--near)", "a command at the limit that its row names"),
            ("width:18px;height:4px;background:var(--limit)", "outside the tables"),
            ("width:9px;height:9px;background:var(--c0);transform:rotate(45deg)", "arrival"),
        ]
    )
}</p>"""
TRANSPORT = """<div class="transport" role="region" aria-label="Time">
<button type="button" id="play" title="Play"><span aria-hidden="true">▶</span></button>
<div class="track"><input type="range" id="time" min="0" max="1" value="0" aria-label="Time, s">
<div id="marks"></div></div>
<output id="told"></output>
<label><span>Speed</span> <select id="rate"><option value="1">×1</option><option value="2">×2</option>
<option value="5" selected>×5</option><option value="10">×10</option><option value="30">×30</option></select></label>
<label class="of-focus">Focus <select id="focus"></select></label>
</div>"""
