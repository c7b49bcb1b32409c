"""Published figures of the package, and their precision."""

import json
import zipfile
from importlib import resources

import pytest

from anser.verification import checks
from anser.verification.checks import half_of_last_digit, half_of_significant, load_published


@pytest.mark.parametrize(
    ("printed", "half"),
    [
        ("288.150", 5e-4),
        ("101325", 0.5),
        ("2.6499e4", 0.5),
        ("1.8458e-5", 5e-10),
        ("1.2250e0", 5e-5),
        ("-5.", 0.5),
        ("0.1", 0.05),
    ],
)
def test_half_of_the_last_digit_follows_from_the_printed_figure(printed, half):
    assert half_of_last_digit(printed) == pytest.approx(half, rel=1e-12)


@pytest.mark.parametrize(
    ("figure", "digits", "half"), [(45.6, 3, 0.05), (-0.9, 3, 5e-4), (0.00048, 2, 5e-6), (1.0, 4, 5e-4), (9.99, 1, 0.5)]
)
def test_half_of_the_significant_digit_follows_from_the_figure(figure, digits, half):
    assert half_of_significant(figure, digits) == pytest.approx(half, rel=1e-12)


def _files() -> list[str]:
    folder = resources.files("anser.verification").joinpath("data")
    return sorted(entry.name.removesuffix(".json") for entry in folder.iterdir() if entry.name.endswith(".json"))


def test_every_file_names_its_source():
    names = _files()
    required = {"arc_lengths", "daveml_aero_checks", "daveml_engine_checks", "nesc_checkpoints", "textbook_checks"}
    assert required | {"ussa76", "wgs84"} <= set(names)
    for name in names:
        assert len(load_published(name)["about"]) > 50, name


def test_figures_are_read_from_an_archive(monkeypatch, tmp_path):
    """Figures are also read from an archive without a folder."""
    with zipfile.ZipFile(tmp_path / "package.zip", "w") as archive:
        archive.writestr("data/made_up.json", json.dumps({"about": "zipped"}))
    packages = []

    def files(package):
        packages.append(package)
        return zipfile.Path(tmp_path / "package.zip")

    monkeypatch.setattr(checks.resources, "files", files)
    assert load_published("made_up") == {"about": "zipped"}
    assert packages == ["anser.verification"]


def test_a_missing_file_is_an_error():
    with pytest.raises(FileNotFoundError):
        load_published("no_such_figures")
