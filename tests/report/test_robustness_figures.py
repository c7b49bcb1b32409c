"""Figures of a made-up study: which are drawn, and what stands in them."""

import pytest

from anser.report import draw_robustness
from support.robustness_cases import made_up_study


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drawn")
    return folder, draw_robustness(made_up_study(), folder)


def test_every_part_is_drawn_twice(drawn):
    folder, paths = drawn
    names = {f"{name}.{suffix}" for name in ("success", "errors", "spread", "alone") for suffix in ("svg", "png")}
    assert {path.name for path in paths} == names == {path.name for path in folder.iterdir()}


def test_the_pictures_say_what_breaks(drawn):
    """Text stays text in SVG."""
    alone = (drawn[0] / "alone.svg").read_text()
    assert "+20 %: surfaces (150, 1000)" in alone
    assert "-20 %: no steady flight (200, 6000)" in alone
    success = (drawn[0] / "success.svg").read_text()
    for words in ("model-based", "incremental", "200 m/s", "dispersed by 20 %"):
        assert words in success
    assert "tolerance" in (drawn[0] / "errors.svg").read_text()


def test_the_same_study_makes_the_same_files(drawn, tmp_path):
    for path in draw_robustness(made_up_study(), tmp_path):
        assert path.read_bytes() == (drawn[0] / path.name).read_bytes(), path.name


def test_parts_that_were_not_flown_are_not_drawn(tmp_path):
    study = made_up_study()
    paths = draw_robustness(study.isel(flight=study["part"].values == 0), tmp_path)
    assert {path.stem for path in paths} == {"success", "errors"}
