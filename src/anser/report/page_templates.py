"""HTML of report pages from Jinja2 templates; every inserted value is escaped unless it is itself HTML (`Markup`)."""

import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.report.style import page_color_of
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
