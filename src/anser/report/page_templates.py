"""HTML of report pages from Jinja2 templates; inserted values are escaped, unless of the type `Markup` (HTML)."""

import base64
import functools
import hashlib
import json
from collections.abc import Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.report.style import figure_content, page_color_of, page_colors
from anser.results.arrival import format_duration

if TYPE_CHECKING:
    import jinja2
    from markupsafe import Markup
    from matplotlib.figure import Figure


MISSING = "–"
"""Text shown in place of a missing number."""


def format_number(value: float | None, digits: int) -> str:
    """Format a number with `digits` decimals and thousands separators; a dash for None, NaN and infinity."""
    if value is None or not np.isfinite(value):
        return MISSING
    return f"{value:,.{digits}f}".replace("-", "−")


def render(template: str, *, package: str = "anser.report", **values: Any) -> "Markup":
    """Return the HTML of a template of `package` with `values` inserted, as `Markup`.

    A template of another package may extend and include templates of `anser.report`.
    """
    from markupsafe import Markup

    return Markup(_environment(package).get_template(template).render(values))


def svg_markup(figure: "Figure") -> "Markup":
    """Return a figure as an SVG element for an HTML page."""
    from markupsafe import Markup

    text = figure_content(figure, ".svg").decode()
    return Markup(text[text.index("<svg") :])


@functools.cache
def _environment(package: str) -> "jinja2.Environment":
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(name) for name in dict.fromkeys((package, "anser.report"))]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=False,
    )
    environment.filters["number"] = format_number
    environment.filters["duration"] = lambda seconds: Markup(format_duration(seconds).replace(" ", "&nbsp;"))
    environment.filters["color"] = page_color_of
    environment.filters["thousands"] = "{:,}".format
    environment.filters["px"] = "{:.1f}".format
    return environment


def render_page(
    template: str,
    *,
    body_class: str,
    styles: Sequence[str],
    scripts: Sequence[str],
    data: tuple[str, Any],
    package: str = "anser.report",
    **values: Any,
) -> str:
    """Return the HTML of a page from a template that extends `page.html`, with `values` inserted.

    `body_class` is a CSS class; `styles` and `scripts` are names of assets, in order (see `read_asset`); `data` is
    (identifier, plain data) of a script element with data; `package` contains the template.
    """
    from markupsafe import Markup

    programs = [Markup(read_asset(name)) for name in scripts]
    return render(
        template,
        package=package,
        body_class=body_class,
        style=Markup(page_colors() + "".join(map(read_asset, styles))),
        scripts=programs,
        script_hashes=Markup(" ".join(map(_script_hash, programs))),
        data_name=data[0],
        data_json=Markup(script_json(data[1])),
        **values,
    )


def read_asset(name: str) -> str:
    """Return the text of a style or script file of `anser.report`; "package:file" names a file of another package."""
    package, _, path = name.rpartition(":")
    return files(package or "anser.report").joinpath("assets", *path.split("/")).read_text(encoding="utf-8")


def script_json(data: Any) -> str:
    """Return data as JSON in which &, < and > are escaped, so that no text can end the script element."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _script_hash(script: str) -> str:
    """Return the SHA-256 that permits a script in the page's content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
