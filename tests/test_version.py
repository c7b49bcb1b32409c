"""Version and commit of a clone against git and against the rule of hatch-vcs, and of an installed package."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from anser import version
from anser.version import BUILD_INFO, UNKNOWN, read_clone, read_commit

ROOT = Path(__file__).parents[1]


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """Clone with one commit, and a function that runs git in it."""
    for name in ("GIT_AUTHOR_NAME", "GIT_AUTHOR_EMAIL", "GIT_COMMITTER_NAME", "GIT_COMMITTER_EMAIL"):
        monkeypatch.setenv(name, "tester")

    def git(*arguments):
        command = ["git", "-C", str(tmp_path / "clone"), *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    (tmp_path / "clone").mkdir()
    git("init", "--quiet")
    (tmp_path / "clone" / "file").write_text("first")
    git("add", "file")
    git("commit", "--quiet", "--message", "first")
    return tmp_path / "clone", git


def _commit(git, count=1):
    for _ in range(count):
        git("commit", "--quiet", "--allow-empty", "--message", "next")


def test_a_clone_without_tags_counts_its_commits(clone):
    root, git = clone
    _commit(git, 2)
    head = git("rev-parse", "HEAD")
    assert read_clone(root) == (f"0.1.dev3+g{head[:9]}", head)


def test_a_tag_is_the_version_and_later_commits_lead_to_the_next(clone):
    root, git = clone
    git("tag", "v1.2.3")
    head = git("rev-parse", "HEAD")
    assert read_clone(root) == ("1.2.3", head)
    _commit(git, 2)
    later = git("rev-parse", "HEAD")
    assert read_clone(root) == (f"1.2.4.dev2+g{later[:9]}", later)
    git("tag", "v2.0.0rc1")
    assert read_clone(root).version == "2.0.0rc1"
    _commit(git)
    assert read_clone(root).version.startswith("2.0.0rc2.dev1+g")
    git("tag", "paper-2026")  # other tags are no versions
    assert read_clone(root).version.startswith("2.0.0rc2.dev1+g")


def test_uncommitted_changes_are_told(clone):
    root, git = clone
    git("tag", "v1.2.3")
    (root / "file").write_text("changed")
    head = git("rev-parse", "HEAD")
    assert read_clone(root) == (f"1.2.4.dev0+g{head[:9]}.dirty", f"{head}-dirty")


def test_the_environment_of_a_git_hook_does_not_name_another_repository(clone, monkeypatch):
    root, git = clone
    head = git("rev-parse", "HEAD")
    monkeypatch.setenv("GIT_DIR", str(ROOT / ".git"))
    assert read_clone(root).commit == head


def test_a_shallow_clone_has_its_commit(clone, tmp_path):
    root, git = clone
    _commit(git, 3)
    shallow = tmp_path / "shallow"
    subprocess.run(["git", "clone", "--quiet", "--depth", "1", f"file://{root}", str(shallow)], check=True)
    head = git("rev-parse", "HEAD")
    assert read_clone(shallow) == (f"0.1.dev1+g{head[:9]}", head)


def test_other_folders_and_machines_without_git_have_no_clone(clone, tmp_path, monkeypatch):
    assert read_clone(tmp_path) is None
    monkeypatch.setenv("PATH", str(tmp_path))
    assert read_clone(clone[0]) is None


def test_an_installed_package_keeps_the_commit_of_its_build(tmp_path):
    assert read_commit(tmp_path) == UNKNOWN
    (tmp_path / BUILD_INFO).write_text(json.dumps({"commit": "ab" * 20}))
    assert read_commit(tmp_path) == "ab" * 20


def test_the_import_starts_no_git_and_the_version_is_that_of_the_clone(tmp_path):
    program = f"""
import subprocess, sys
calls, run = [], subprocess.run
subprocess.run = lambda *arguments, **options: calls.append(arguments) or run(*arguments, **options)
import anser
print(len(calls))
print(anser.__version__)
sys.exit(anser.__version__ != {version.source_version().version!r})
"""
    completed = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert completed.stdout.startswith("0\n")
