"""Notebooks of the tutorials: current, valid, and one of them executed in a fresh folder."""

import json
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

DOCS = Path(__file__).parents[2] / "docs"
NOTEBOOKS = runpy.run_path(str(DOCS / "notebooks.py"))
PAGES = NOTEBOOKS["pages"]()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_notebooks_are_current_and_linked(page):
    path, text = NOTEBOOKS["notebook_path"](page), NOTEBOOKS["notebook_text"](page)
    assert path.read_text(encoding="utf-8") == text, "make copies"
    nbformat.validate(json.loads(text))
    markdown = page.read_text(encoding="utf-8")
    assert f"(../notebooks/{page.stem}.ipynb)" in markdown
    title, setup, *cells = json.loads(text)["cells"]
    assert title["source"][0].startswith("# ")
    assert "".join(setup["source"]) == NOTEBOOKS["SETUP"]
    # every code cell of the page, and nothing of the front matter, the comments or the link to the notebook itself
    assert sum(cell["cell_type"] == "code" for cell in cells) == markdown.count("```{code-cell}")
    for unwanted in ("kernelspec:", "<!--", ".ipynb", "{code-cell}"):
        assert not any(unwanted in "".join(cell["source"]) for cell in (title, *cells))


def test_every_tutorial_with_cells_has_a_notebook_and_no_other_file_has():
    assert {path.stem for path in (DOCS / "notebooks").glob("*.ipynb")} == {page.stem for page in PAGES}
    assert len(PAGES) >= 11


def test_links_of_the_notebooks_lead_to_files():
    for page in PAGES:
        for cell in json.loads(NOTEBOOKS["notebook_text"](page))["cells"]:
            if cell["cell_type"] == "markdown":
                for target in NOTEBOOKS["LINK"].findall("".join(cell["source"])):
                    assert (DOCS / "notebooks" / target).exists(), f"{page.stem}: {target}"


def test_the_first_cell_refuses_a_python_without_anser_and_wheel(tmp_path):
    script = "import importlib.util\nimportlib.util.find_spec = lambda name: None\n" + NOTEBOOKS["SETUP"]
    ended = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert "expected one of them: `python -m build` in a clone writes the wheel" in ended.stderr


@pytest.mark.long
def test_a_notebook_executes_in_an_empty_folder(tmp_path):
    notebook = shutil.copy(DOCS / "notebooks" / "verify.ipynb", tmp_path)
    command = [str(Path(sys.executable).parent / "jupyter-execute"), "--inplace", notebook]
    environment = os.environ | {"IPYTHONDIR": str(tmp_path / "ipython"), "COLUMNS": "110"}
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, capture_output=True)
    cells = [cell for cell in nbformat.read(notebook, 4).cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in cells)
    outputs = "".join(str(output) for cell in cells for output in cell.outputs)
    assert "ussa76" in outputs
    assert not any(output.output_type == "error" for cell in cells for output in cell.outputs)
