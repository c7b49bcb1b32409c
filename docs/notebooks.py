"""Notebooks of the executed pages, for JupyterLab and Colab: `docs/notebooks`, made anew by `make docs`."""

from pathlib import Path
from typing import Any

import jupytext
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell

FOLDER = "notebooks"
FIRST_CELL = """\
# Where anser is missing, as in Colab, it is installed; its scenarios and studies are copied beside the notebook.
import importlib.util

if importlib.util.find_spec("anser") is None:
    %pip install --quiet anser
from anser.config.shipped_files import copy_shipped_folders

copy_shipped_folders(".")
%matplotlib inline"""
_TITLE = "\n# "


def pages(docs: Path) -> list[Path]:
    """Return the pages with code cells."""
    folders = (docs / "tutorials", docs / "how-to")
    found = sorted(page for folder in folders for page in folder.glob("*.md"))
    return [page for page in found if page.read_text(encoding="utf-8").startswith("---\nfile_format: mystnb")]


def notebook(page: Path) -> NotebookNode:
    """Return the notebook of a page: its text and code cells, after a cell that installs anser."""
    content = jupytext.read(page, fmt="md:myst")
    content.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
    content.cells.insert(0, new_code_cell(FIRST_CELL))
    return content


def write(docs: Path) -> None:
    """Write the notebooks of all pages."""
    folder = docs / FOLDER
    folder.mkdir(exist_ok=True)
    for page in pages(docs):
        jupytext.write(notebook(page), folder / f"{page.stem}.ipynb", fmt="ipynb")


def add_link(app: Any, name: str, source: list[str]) -> None:
    """Add a download of the notebook under the title of a page that has one."""
    page = Path(app.srcdir) / f"{name}.md"
    if page in pages(Path(app.srcdir)):
        head, title, rest = source[0].partition(_TITLE)
        line, _, text = rest.partition("\n")
        link = f"{{download}}`Notebook of this page <../{FOLDER}/{page.stem}.ipynb>`"
        source[0] = f"{head}{title}{line}\n\n{link}\n{text}"
