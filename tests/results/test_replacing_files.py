"""Files that replace others: all or none, and nothing else."""

import pytest

from anser.results.replacing_files import replaced_within


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "deep").mkdir()
    for name in ("flight.nc", "notes.txt", "deep/old.svg"):
        (tmp_path / name).write_text("old")
    return tmp_path


def content(folder):
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_files_of_the_same_names_are_replaced_and_all_others_stay(folder):
    with replaced_within(folder) as into:
        (into / "flight.nc").write_text("new")
        (into / "deep").mkdir()
        (into / "deep" / "new.svg").write_text("new")
        assert content(folder)["flight.nc"] == "old"
    expected = {"flight.nc": "new", "notes.txt": "old", "deep/old.svg": "old", "deep/new.svg": "new"}
    assert content(folder) == expected


def test_what_fails_on_the_way_changes_nothing(folder):
    before = content(folder)

    def stopped():
        with replaced_within(folder) as into:
            (into / "flight.nc").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert content(folder) == before


def test_a_folder_in_the_place_of_a_file_is_refused_before_anything_is_replaced(folder):
    before = content(folder)

    def in_the_way():
        with replaced_within(folder) as into:
            (into / "flight.nc").write_text("new")
            (into / "deep").write_text("new")

    with pytest.raises(FileExistsError, match="deep is a folder"):
        in_the_way()
    assert content(folder) == before
