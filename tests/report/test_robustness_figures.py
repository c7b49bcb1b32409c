"""Figures of a made-up robustness study: parts and texts."""

import pytest

from anser.report import draw_robustness
from support.robustness_cases import made_up_study


@pytest.fixture(scope="module")
def figures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drawn")
    return folder, draw_robustness(made_up_study(), folder)


def test_every_part_is_drawn_in_two_formats(figures):
    folder, paths = figures
    names = {f"{name}.{suffix}" for name in ("success", "errors", "spread", "alone") for suffix in ("svg", "png")}
    assert {path.name for path in paths} == names == {path.name for path in folder.iterdir()}


def test_figures_name_the_failures(figures):
    alone = (figures[0] / "alone.svg").read_text()
    assert "+20 %: surfaces (150, 1000)" in alone
    assert "-20 %: no steady flight (200, 6000)" in alone
    success = (figures[0] / "success.svg").read_text()
    for text in ("model-based", "incremental", "200 m/s", "dispersed by 20 %"):
        assert text in success
    assert "tolerance" in (figures[0] / "errors.svg").read_text()


@pytest.mark.long
def test_figures_are_reproducible(figures, tmp_path):
    for path in draw_robustness(made_up_study(), tmp_path):
        assert path.read_bytes() == (figures[0] / path.name).read_bytes(), path.name


def test_only_simulated_parts_are_drawn(tmp_path):
    study = made_up_study()
    paths = draw_robustness(study.isel(flight=study["part"].values == 0), tmp_path)
    assert {path.stem for path in paths} == {"success", "errors"}
