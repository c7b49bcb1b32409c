"""Configuration of the documentation site: `make docs` builds it into build/docs, offline, executing every example."""

import importlib.resources
import logging
import os
import sys
from pathlib import Path
from typing import Any

logging.basicConfig(level=logging.WARNING)  # or the theme's palette, when it is imported, has everything log at INFO

import jax  # noqa: E402

jax.Array.__name__ = jax.Array.__qualname__ = "Array"  # as signatures are to show it: its own name is jaxlib._jax.Array
jax.Array.__module__ = "jax"

import anser  # noqa: E402 - its annotations take the name on
from anser.compiling.program import supported_options  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent))
from live_gallery import write_gallery  # noqa: E402

_ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(Path(__file__).parent))

import notebooks  # noqa: E402

project = "anser"
author = "the authors of anser"
release = version = anser.__version__

extensions = [
    "myst_nb",
    "sphinx_gallery.gen_gallery",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx.ext.mathjax",
]
exclude_patterns = ["_templates", "gallery", "auto_gallery/*.ipynb", "auto_gallery/*.py"]
templates_path = ["_templates"]

html_theme = "furo"
html_title = "anser"
# Formulas need no network: MathJax comes from a package and is copied into the site.
html_static_path = ["_static", str(importlib.resources.files("sphinx-mathjax-offline") / "static")]
mathjax_path = "mathjax/tex-chtml.js"
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

# Examples: each page in a fresh kernel and a folder of its own; an example that raises ends the build.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 900
nb_merge_streams = True
nb_render_markdown_format = "gfm"
nb_mime_priority_overrides = [("html", "image/svg+xml", 5)]

# Gallery: each script is a page with its picture, and a download as script and notebook.
_scenarios = Path(__file__).with_name("gallery") / "scenarios"  # scripts run in their folder
if not _scenarios.exists():
    _scenarios.symlink_to(_ROOT / "scenarios")
sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_gallery",
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,
    "abort_on_example_error": True,
    "first_notebook_cell": notebooks.SETUP,
}

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autosummary_generate = True
autosummary_ignore_module_all = False
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
default_role = "code"  # docstrings set names between single backquotes

_STARTUP = f'''"""What each example finds: the scenarios and docs beside it, a shell, plain figures."""
import os
import subprocess
import textwrap

from IPython.core.magic import register_cell_magic

for folder in ("scenarios", "studies", "docs"):
    if not os.path.exists(folder):
        os.symlink(os.path.join({str(_ROOT)!r}, folder), folder)
for name in ("FORCE_COLOR", "CLICOLOR", "CLICOLOR_FORCE"):
    os.environ.pop(name, None)  # commands write as into a pipe


@register_cell_magic
def sh(line, cell):
    """Run a shell's commands; what they print comes in its order, and a failure is one of the page."""
    done = subprocess.run(["sh", "-ec", cell], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    print(*map(folded, done.stdout.splitlines()), sep="\\n")
    done.check_returncode()


def folded(line):
    """Fold a long sentence; the rows of a table stay as they are."""
    table = len(line) <= 96 or "   " in line.strip()
    return line if table else textwrap.fill(line, 96, subsequent_indent="    ", break_long_words=False)


get_ipython().run_line_magic("matplotlib", "inline")
get_ipython().run_line_magic("config", "InlineBackend.figure_formats = ['svg']")
'''


def _prepare_kernels() -> None:
    """Let the kernels of the examples find the command `anser`, and the scenarios where the pages say they are."""
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    if supported_options({"xla_cpu_use_fusion_emitters": False}):  # compiles in half the time, where the version has it
        os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")
    os.environ["COLUMNS"] = "110"
    profile = _ROOT / "build" / "ipython"
    startup = profile / "profile_default" / "startup"
    startup.mkdir(parents=True, exist_ok=True)
    (startup / "00-examples.py").write_text(_STARTUP, encoding="utf-8")
    (startup.parent / "ipython_kernel_config.py").write_text("c.IPKernelApp.log_level = 40\n", encoding="utf-8")
    os.environ["IPYTHONDIR"] = str(profile)


_prepare_kernels()


def _escape_bars(_app: object, _what: str, _name: str, _of: object, _options: object, lines: list[str]) -> None:
    """Let |x| in a docstring be an absolute value, not a substitution of reStructuredText."""
    for k, line in enumerate(lines):
        parts = line.split("`")
        lines[k] = "`".join(part if j % 2 else part.replace("|", "\\|") for j, part in enumerate(parts))


_ACCESSIBLE = (
    ('role="heading">', 'role="heading" aria-level="2">'),
    ("<pre>", '<pre tabindex="0">'),
    ('<table class="docutils', '<table tabindex="0" class="docutils'),  # scrolls by itself: site.css
    ('<summary aria-label="Toggle hidden content">', "<summary>"),
)
"""What readers with a keyboard or a screen reader need: levels of headings, and areas that scroll by keys."""


def _make_accessible(app: Any, exception: Exception | None) -> None:
    """Complete the finished pages, whose theme leaves these attributes out."""
    if exception is not None or app.builder.name != "html":
        return
    for page in Path(app.outdir).rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        for before, after in _ACCESSIBLE:
            text = text.replace(before, after)
        page.write_text(text, encoding="utf-8")


def _write_live_gallery(app: Any, exception: Exception | None) -> None:
    """Plan the situations of the live page and write their recorded pages beside the finished pages."""
    if exception is None and app.builder.name == "html":
        write_gallery(Path(app.outdir) / "live-gallery")


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.registry.source_suffix.pop(".ipynb")  # the notebooks, made from the tutorials, are files to download
    app.connect("autodoc-process-docstring", _escape_bars)
    app.connect("build-finished", _make_accessible)
    app.connect("build-finished", _write_live_gallery)  # after it: the pages forbid other scripts than their own
