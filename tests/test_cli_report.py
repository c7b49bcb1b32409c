"""The command report: files and refusals."""

import shutil

import pytest

from anser.results import write_netcdf, write_summary
from support.made_flight import make_flight


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flown")
    dataset, summary = make_flight()
    write_netcdf(dataset, folder / "flight.nc")
    write_summary(summary, folder / "summary.json")
    return folder


@pytest.fixture
def runs(flown, tmp_path):
    """Two run folders."""
    return [shutil.copytree(flown, tmp_path / name) for name in ("a", "b")]


def test_a_report_is_replaced_only_by_force(anser, runs):
    code, printed, _ = anser("report", runs[0])
    target = runs[0] / "report.html"
    assert code == 0
    assert str(target) in printed
    assert "</html>" in target.read_text(encoding="utf-8")
    target.write_text("mine")
    code, _, err = anser("report", runs[0])
    assert code == 2
    assert f"{target} exists; give --force to write it anew, or --out FILE" in err
    assert target.read_text() == "mine"
    assert anser("report", runs[0], "--force")[0] == 0
    assert "</html>" in target.read_text(encoding="utf-8")


def test_two_runs_are_compared_in_one_file(anser, runs, tmp_path):
    out = tmp_path / "beside.html"
    assert anser("report", *runs, "--out", out)[0] == 0
    page = out.read_text(encoding="utf-8")
    assert page.count('class="scene-place"') == 2
    assert str(runs[1]) in page
    assert not (runs[0] / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("{a}", "{b}"), "--out: arrived nothing; expected a file for the report of two runs"),
        (("{a}/none",), "RUN: arrived {a}/none, which is no folder; expected"),
        (
            ("{a}", "{tmp}", "--out", "{tmp}/x.html"),
            "OTHER: arrived {tmp}, which holds no flight.nc and no summary.json",
        ),
        (("{a}", "--out", "{b}"), "--out: arrived {b}, which is a folder; expected a file"),
        (("{a}", "--out", "{a}/no/x.html"), "--out: arrived {a}/no/x.html; expected a file in a folder that exists"),
        (("{a}", "--out", "{a}/flight.nc", "--force"), "which holds a run; expected another file"),
    ],
)
def test_wrong_input_is_reported_and_nothing_written(anser, runs, tmp_path, arguments, said):
    folders = {"a": str(runs[0]), "b": str(runs[1]), "tmp": str(tmp_path)}
    original = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    code, _, err = anser("report", *(word.format(**folders) for word in arguments))
    assert code == 2
    assert said.format(**folders) in err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == original


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("flight.nc", "junk", "flight.nc: arrived a file that cannot be read"),
        ("summary.json", "[1", "summary.json: arrived a file that cannot be read"),
        ("summary.json", "{}", "format_version None; expected 1, which this version of anser reads"),
        ("summary.json", '{"format_version": 1}', "summary.json: arrived no scenario; expected a summary of a flight"),
    ],
)
def test_broken_files_are_reported(anser, runs, name, content, said):
    (runs[0] / name).write_text(content)
    code, _, err = anser("report", runs[0])
    assert code == 2
    assert said in err
    assert not (runs[0] / "report.html").exists()
