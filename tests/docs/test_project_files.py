"""README, pages of the project, links between all pages, terms that a search must find, and the recipe of the release."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FACE = [ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "AGENTS", "SECURITY", "ROADMAP", "CHANGELOG")]
PAGES = [*FACE, *sorted((ROOT / "docs").rglob("*.md"))]
CODE = re.compile(r"^```.*?^```|`[^`\n]*`|\$\$.*?\$\$|\$[^$\n]*\$", re.MULTILINE | re.DOTALL)
"""Code and formulas, in which brackets are no links."""
LINK = re.compile(r"\]\(([^)\s]+)\)")
LABEL = re.compile(r"^\(([\w-]+)\)=$", re.MULTILINE)
HEADING = re.compile(r"^#+ +(.*)$", re.MULTILINE)

TERMS = (
    "monte carlo",
    "doublet",
    "cite",
    "gpu",
    "turbulence",
    "lqr",
    "reinforcement learning",
    "3.14",
    "csv",
    "resume",
)
"""Words that newcomers search for."""


def anchors(page):
    text = page.read_text(encoding="utf-8")
    headings = [heading.lower().replace("`", "") for heading in HEADING.findall(text)]
    return {*LABEL.findall(text), *(re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in headings)}


def links(page):
    return LINK.findall(CODE.sub("", page.read_text(encoding="utf-8")))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_between_pages_lead_somewhere(page):
    for link in links(page):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), f"{page.name}: {link}: no such file"
        if anchor:
            assert anchor in anchors(target), f"{page.name}: {link}: no such heading in {target.name}"


def test_the_links_are_found():
    assert len(links(ROOT / "README.md")) >= 15
    assert "searches" not in anchors(ROOT / "docs" / "index.md")
    assert "in-an-editor" in anchors(ROOT / "docs" / "reference" / "scenario.md")


def test_the_readme_fits_on_a_screen():
    assert (ROOT / "README.md").stat().st_size <= 6000


@pytest.mark.parametrize("term", TERMS)
def test_a_search_finds_what_newcomers_look_for(term):
    texts = [page.read_text(encoding="utf-8").lower() for page in (ROOT / "docs").rglob("*.md")]
    assert any(term in text for text in texts)


def test_every_page_is_in_the_contents():
    contents = "\n".join(
        re.findall(r"```\{toctree\}.*?```", (ROOT / "docs" / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    )
    listed = set(contents.split())
    for page in (ROOT / "docs").glob("*.md"):
        assert page.stem in {*listed, "index"}, page.name


def test_the_recipe_requires_what_the_package_requires():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / "release" / "conda-forge" / "recipe.yaml").read_text(encoding="utf-8")
    run = recipe.partition("  run:\n")[2].partition("\n\n")[0]
    required = {
        line.strip("- ").replace("lazy_loader", "lazy-loader").replace("matplotlib-base", "matplotlib")
        for line in run.splitlines()
    }
    expected = {re.sub(r"^([\w-]+)", r"\1 ", dependency).lower() for dependency in project["dependencies"]}
    expected.add(f"python {project['requires-python'].replace('>=3.11', '>=${{ python_min }}')}")
    assert required == expected
