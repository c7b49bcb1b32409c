"""Notebooks of the tutorials: `docs/notebooks/NAME.ipynb`, made from the pages by the reader that the site uses.

`make copies` writes the notebooks anew; a test compares them. A notebook has no outputs, and begins with a cell that
installs anser if necessary and opens an empty folder with the scenarios.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

from myst_nb.core.read import read_myst_markdown_notebook

TUTORIALS = Path(__file__).parent / "tutorials"
NOTEBOOKS = Path(__file__).parent / "notebooks"
SETUP = """\
# Preparation: anser from a wheel beside this notebook, unless it is installed; an empty folder with the scenarios.
import glob
import importlib.util
import os
import subprocess
import sys
import tempfile

if importlib.util.find_spec("anser") is None:
    wheels = sorted(glob.glob("anser-*.whl"))
    if not wheels:
        raise FileNotFoundError(
            "arrived a Python without anser, and no file anser-*.whl beside the notebook; expected one of them: "
            "`python -m build` in a clone writes the wheel into dist/, and Colab uploads it by its folder symbol"
        )
    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", f"{wheels[-1]}[control]"], check=True)

from anser.config.shipped_files import shipped_files

scenarios = shipped_files()["three-aircraft"].parent
os.environ["PATH"] = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])
os.chdir(tempfile.mkdtemp(prefix="anser-"))
os.symlink(scenarios, "scenarios")"""
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}
_COMMENT = re.compile(r"<!--.*?-->\n?", re.DOTALL)
_SIBLING_LINK = re.compile(r"\]\((?=[\w-]+\.(?:md|png))")
LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)")
"""Target of a relative link, without its anchor."""
_NOTEBOOK_LINK = re.compile(r"\n[^\n]*\(\.\./notebooks/[^\n]*\n")


def pages() -> list[Path]:
    """Return the tutorials with executed cells."""
    return [path for path in sorted(TUTORIALS.glob("*.md")) if "```{code-cell}" in path.read_text(encoding="utf-8")]


def notebook_path(page: Path) -> Path:
    """Return the path of a page's notebook."""
    return NOTEBOOKS / f"{page.stem}.ipynb"


def notebook_text(page: Path) -> str:
    """Return the file of a page's notebook: JSON of nbformat 4.5 without outputs."""
    text = _COMMENT.sub("", _NOTEBOOK_LINK.sub("", page.read_text(encoding="utf-8")))
    cells = [(cell.cell_type, cell.source) for cell in read_myst_markdown_notebook(text).cells]
    title, cells = cells[0], [("code", SETUP), *cells[1:]]
    document = {
        "cells": [_cell(k, kind, source) for k, (kind, source) in enumerate([title, *cells])],
        "metadata": {"kernelspec": KERNEL, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _cell(index: int, kind: str, source: str) -> dict[str, Any]:
    """Return a cell; links between the tutorials lead from the folder of the notebooks into theirs."""
    if kind == "markdown":
        source = _SIBLING_LINK.sub("](../tutorials/", source)
    cell = {"cell_type": kind, "id": f"cell-{index}", "metadata": {}, "source": source.splitlines(keepends=True)}
    return cell if kind == "markdown" else cell | {"execution_count": None, "outputs": []}


if __name__ == "__main__":
    NOTEBOOKS.mkdir(exist_ok=True)
    for page in pages():
        path, text = notebook_path(page), notebook_text(page)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            sys.stdout.write(f"{path.relative_to(NOTEBOOKS.parents[1])}: notebook written\n")
