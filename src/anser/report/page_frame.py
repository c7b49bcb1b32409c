"""Writing of report pages as self-contained files, with their styles, scripts and data."""

import base64
import hashlib
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from anser.files import write_file
from anser.report.page_templates import render
from anser.report.style import page_colors


def render_page(
    template: str,
    *,
    body_class: str,
    styles: Sequence[str],
    scripts: Sequence[str],
    data: tuple[str, Any],
    **values: Any,
) -> str:
    """Return the HTML of a page, from a template that extends `page.html`.

    Parameters
    ----------
    template
        File name of the template.
    body_class
        CSS class of the body.
    styles, scripts
        File names of assets, in order.
    data
        Identifier of the script element with the data, and the data.
    **values
        Values of the template.
    """
    from markupsafe import Markup

    programs = [Markup(read_asset(name)) for name in scripts]
    return render(
        template,
        body_class=body_class,
        style=Markup(page_colors() + "".join(map(read_asset, styles))),
        scripts=programs,
        script_hashes=Markup(" ".join(map(_script_hash, programs))),
        data_name=data[0],
        data_json=Markup(script_json(data[1])),
        **values,
    )


def write_page(text: str, path: Path, *, overwrite: bool) -> None:
    """Write a page to a file; an earlier file remains until the new one is complete.

    Raises
    ------
    FileExistsError
        If `path` exists and `overwrite` is false.
    """
    write_file(path, text, overwrite=overwrite)


def read_asset(name: str) -> str:
    """Return the text of a style or script file of this package."""
    return files("anser.report").joinpath("assets", *name.split("/")).read_text(encoding="utf-8")


def script_json(data: Any) -> str:
    """Return data as JSON that is safe inside a script element: no text in it can end the element or start another."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _script_hash(script: str) -> str:
    """Return the hash of a script for the content security policy: browsers run only scripts with a listed hash."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
