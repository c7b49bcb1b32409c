"""What every page has around its contents: one file, its styles and scripts inside, nothing else allowed to run."""

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from anser.output_files import write_file
from anser.report.flight_data import as_script
from anser.report.style import page_colors


def page(
    title: str, *, look: str, styles: Sequence[str], scripts: Sequence[str], contents: str, data: tuple[str, Any]
) -> str:
    """Put a page together.

    Parameters
    ----------
    title
        Of the window; HTML.
    look
        Class of the body.
    styles, scripts
        Names of assets, in their order.
    contents
        HTML of the body.
    data
        Identifier of what the scripts read, and what they read.
    """
    programs = [asset(name) for name in scripts]
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; \
script-src {" ".join(map(_hash_of, programs))}; img-src data: blob:; connect-src 'none'">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{page_colors()}{"".join(map(asset, styles))}</style>
</head>
<body class="{look}">
{contents}
<script type="application/json" id="{data[0]}">{as_script(data[1])}</script>
{"".join(f"<script>{program}</script>" for program in programs)}
</body>
</html>
"""


def write_page(text: str, path: Path, *, overwrite: bool) -> None:
    """Write a page whole or not at all: one that stood there stays until the new one is complete.

    Raises
    ------
    FileExistsError
        `path` exists and may not be replaced.
    """
    write_file(path, text, overwrite=overwrite)


def asset(name: str) -> str:
    """Text of a style or script of this package."""
    return files("anser.report").joinpath("assets", *name.split("/")).read_text(encoding="utf-8")


def _hash_of(script: str) -> str:
    """Name a script to the browser, which runs no other: not even one that some name would smuggle in."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
