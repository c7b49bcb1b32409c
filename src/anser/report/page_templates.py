"""HTML of report pages from Jinja2 templates; inserted values are escaped unless they are HTML (`Markup`)."""

import base64
import functools
import hashlib
import json
from collections.abc import Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.report.style import page_color_of, page_colors
from anser.results.arrival import format_duration

if TYPE_CHECKING:
    import jinja2
    from markupsafe import Markup


MISSING = "–"
"""Text shown in place of a missing number."""


def format_number(value: float | None, digits: int) -> str:
    """Format a number with a fixed number of decimals and thousands separators; a dash for None."""
    if value is None or not np.isfinite(value):
        return MISSING
    return f"{value:,.{digits}f}".replace("-", "−")


def render(template: str, **values: Any) -> "Markup":
    """Return the HTML of a template of this package, marked so that other templates do not escape it again."""
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(values))


@functools.cache
def _environment() -> "jinja2.Environment":
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("anser.report"),
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
    **values: Any,
) -> str:
    """Return the HTML of a page from a template that extends `page.html`.

    `styles` and `scripts` are file names of assets, in order; `data` is the identifier and content of the script
    element with the data.
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
