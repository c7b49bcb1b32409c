"""Properties of every command: --json, --quiet, examples, exit codes; and typos, completion, colours, progress."""

import functools
import io
import itertools
import json
import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rich.console
import rich.progress
import typer
from typer.main import get_command
from typer.testing import CliRunner

from anser.cli import console
from anser.cli.app import help_epilog, register_command
from anser.cli.arguments import complete_run, complete_scenario, complete_variant
from anser.cli.commands import app
from anser.cli.console import activity, print_document, print_line, print_note, print_problem, progress_bar
from anser.compiling import measuring
from anser.compiling.measuring import Compilation
from support.made_flight import make_flight

ROOT = Path(__file__).parents[1]
SCENARIOS = ROOT / "scenarios"
THREE = SCENARIOS / "three-aircraft.toml"
GROUPS = get_command(app).commands


def _leaves(commands, prefix=""):
    """Commands by their full names; a group's default command also by the group's name."""
    for name, command in commands.items():
        inner = getattr(command, "commands", None)
        yield from _leaves(inner, f"{prefix}{name} ") if inner else [(f"{prefix}{name}", command)]


COMMANDS = dict(_leaves(GROUPS))
COLOUR = re.compile(r"\x1b\[[\d;]*(?:3[0-7]|38|9[0-7])[\d;]*m")


@functools.cache
def _help(name):
    return CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "150", "TERM": "dumb"}).stdout


def _examples(name):
    """Examples in the help of a command."""
    lines = [line.strip() for line in _help(name).splitlines()]
    following = lines[lines.index("Examples:") + 1 :]
    return following[: following.index("")]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_the_options_examples_and_exit_codes(name):
    shown = _help(name)
    for option in ("--json", "--quiet", "--help"):
        assert option in shown
    for code in ("0  done", "2  bad input", "3  internal fault", "130  stopped by Ctrl-C"):
        assert code in shown


@pytest.mark.parametrize("name", COMMANDS)
def test_every_example_is_a_command_line_that_parses(name):
    examples = _examples(name)
    assert examples
    for example in examples:
        program, command, *arguments = shlex.split(example.partition(" > ")[0])
        assert (program, command) == ("anser", name.split()[0])
        context, meant = (
            GROUPS[command].make_context(command, arguments),
            command,
        )  # raises UsageError at what it has not
        if command != name:
            meant, inner, inner_arguments = GROUPS[command].resolve_command(
                context, [*context._protected_args, *context.args]
            )
            inner.make_context(meant, inner_arguments)
            meant = f"{command} {meant}"
        assert meant == name
        for word in arguments:
            if word.startswith("scenarios/"):
                assert (ROOT / word).is_file()


@pytest.mark.parametrize("name", COMMANDS)
def test_the_command_page_shows_every_command(name):
    page = (ROOT / "docs" / "command-line.md").read_text()
    (table_row,) = [line for line in page.splitlines() if line.startswith(f"| `{_examples(name)[0]}` |")]
    unmet = re.search(r"^ *1  (.*?) *$", _help(name), re.MULTILINE)
    assert table_row.split("|")[3].strip() == (unmet[1] if unmet else "")


def test_check_prints_json_for_good_and_bad_files(anser, tmp_path):
    code, printed, err = anser("check", THREE, "--json")
    assert (code, err) == (0, "")
    document = json.loads(printed)
    assert document["good"] is True
    assert (document["aircraft"], document["goals"], document["cautions"]) == (3, 3, [])

    path = tmp_path / "bad[red].toml"
    path.write_text(THREE.read_text().replace("speed_m_s = 150.0\n", "sped_m_s = 150.0\n", 1))
    code, printed, err = anser("check", path, "--json")
    assert code == 2
    (problem,) = json.loads(printed)["problems"]
    assert problem["path"] == "fleet.sped_m_s"
    assert 'perhaps "speed_m_s"' in problem["expected"]
    assert path.read_text().splitlines()[problem["line"] - 1].startswith("sped_m_s")
    assert f"{problem['path']}: arrived {problem['arrived']}; expected {problem['expected']}" in err
    assert str(path) in err


def test_quiet_prints_errors_only(anser, tmp_path):
    odd = tmp_path / "odd.toml"
    gains = "[aircraft.gains.velocity]\nproportional = [1.0, 1.6, 1.0]\n\n[[goal]]"
    odd.write_text(THREE.read_text().replace("[[goal]]", gains, 1))
    code, _, err = anser("check", odd)
    assert (code, err.startswith("caution: aircraft[")) == (0, True)
    assert anser("check", odd, "--quiet") == (0, "", "")
    code, printed, err = anser("check", THREE)
    assert code == 0
    assert "good" in printed
    assert err == ""
    assert anser("check", THREE, "--quiet") == (0, "", "")
    assert anser("new", tmp_path / "mine.toml", "--quiet") == (0, "", "")
    code, printed, err = anser("new", tmp_path / "mine.toml", "--quiet")
    assert (code, printed) == (2, "")
    assert "mine.toml" in err
    code, printed, err = anser("new", tmp_path / "yours.toml", "--quiet", "--json")
    assert (code, json.loads(printed)["file"], err) == (0, str(tmp_path / "yours.toml"), "")


def test_lists_and_reports_print_json(anser, tmp_path):
    from anser.results import write_netcdf, write_summary

    code, printed, err = anser("verify", "--list", "--json")
    assert (code, err) == (0, "")
    assert "nesc-11" in [check["key"] for check in json.loads(printed)["checks"]]
    dataset, summary = make_flight()
    write_netcdf(dataset, tmp_path / "flight.nc")
    write_summary(summary, tmp_path / "summary.json")
    code, printed, err = anser("report", tmp_path, "--json")
    assert (code, err) == (0, "")
    assert Path(json.loads(printed)["file"]).is_file()
    code, printed, err = anser("export", tmp_path, "--format", "csv,kml", "--period-s", "10", "--json")
    assert (code, err) == (0, "")
    assert json.loads(printed)["files"] == {name: str(tmp_path / f"flight.{name}") for name in ("csv", "kml")}


@pytest.fixture
def invoke():
    """An application with a command for each kind of behaviour."""

    @help_epilog("anser good", unmet="never")
    def good() -> None:
        """Print the document."""
        print_note("a message [1]")
        print_document(lambda: {"figure": 1})
        print_line("figure [m]: 1")
        print_problem("falls short [2]")
        raise typer.Exit(1)

    @help_epilog("anser mute")
    def mute() -> None:
        """Print no document."""
        print_line("figure: 1")

    @help_epilog("anser endless")
    def endless() -> None:
        """Raise an interrupt."""
        raise KeyboardInterrupt

    offered = typer.Typer()
    for command in (good, mute, endless):
        register_command(offered, command)
    return lambda *words: CliRunner().invoke(offered, words)


def test_the_document_is_the_only_standard_output(invoke):
    result = invoke("good")
    assert (result.exit_code, result.stdout, result.stderr) == (
        1,
        "figure [m]: 1\n",
        "a message [1]\nfalls short [2]\n",
    )
    result = invoke("good", "--json")
    assert (result.exit_code, json.loads(result.stdout)) == (1, {"figure": 1})
    assert result.stderr == "a message [1]\nfalls short [2]\n"
    result = invoke("good", "--quiet")
    assert (result.exit_code, result.stdout, result.stderr) == (1, "", "falls short [2]\n")
    result = invoke("good", "--quiet", "--json")
    assert (result.exit_code, json.loads(result.stdout), result.stderr) == (1, {"figure": 1}, "falls short [2]\n")
    assert invoke("good").stdout == "figure [m]: 1\n"  # no option lasts longer than its command


def test_a_command_without_its_document_is_a_fault(invoke):
    assert invoke("mute").exit_code == 0
    assert isinstance(invoke("mute", "--json").exception, RuntimeError)


def test_an_interrupt_ends_with_130(invoke):
    result = invoke("endless")
    assert (result.exit_code, result.stdout, result.stderr) == (130, "", "stopped\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("rnu", THREE), "Did you mean 'run'"),
        (("chek", THREE), "Did you mean 'check'"),
        (("run", THREE, "--quit"), "--quiet"),
        (("trim", "--speed-ms", "150"), "--speed-m-s"),
        (("verify", "--case", "f16-trims"), "the closest is f16-trim"),
        (("check",), "Missing argument"),
    ],
)
def test_typos_get_a_suggestion(anser, arguments, said):
    code, printed, err = anser(*arguments)
    assert (code, printed) == (2, "")
    assert said in " ".join(err.replace("│", " ").split())


def _completed(typed_line, folder, **environment):
    """Completions of bash."""
    typed = {
        "_ANSER_COMPLETE": "complete_bash",
        "COMP_WORDS": typed_line,
        "COMP_CWORD": str(len(typed_line.split(" ")) - 1),
    }
    completed = subprocess.run(
        [Path(sys.executable).with_name("anser")],
        env=os.environ | typed | environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return completed.stdout.split()


def test_the_shell_completes_scenarios_and_options():
    assert _completed("anser run scenarios/three-a", ROOT) == ["scenarios/three-aircraft.toml"]
    assert {"--json", "--quiet"} <= set(_completed("anser run --", ROOT))


def test_shell_completion_is_installed_on_request():
    program = Path(sys.executable).with_name("anser")
    environment = os.environ | {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    completed = subprocess.run(
        [program, "--show-completion", "bash"], env=environment, capture_output=True, text=True, check=True
    )
    assert "_ANSER_COMPLETE=complete_bash" in completed.stdout
    assert subprocess.run(["bash", "-n"], input=completed.stdout, text=True, check=True).returncode == 0


def test_scenarios_and_runs_are_completed_in_subfolders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("pyproject.toml").write_text("[project]\n")
    Path("mine.toml").write_text("[[aircraft]]\n")
    for folder in (Path("runs/a"), Path("runs/b"), Path(".hidden")):
        folder.mkdir(parents=True)
        (folder / "copy.toml").write_text("[[aircraft]]\n")
        (folder / "flight.nc").touch()
    for folder in (Path("runs/a"), Path(".hidden")):
        (folder / "summary.json").touch()
    assert complete_scenario("") == ["mine.toml", "runs/a/copy.toml", "runs/b/copy.toml"]
    assert complete_scenario("./m") == ["./mine.toml"]
    assert complete_scenario(f"{tmp_path}/runs/b") == [f"{tmp_path}/runs/b/copy.toml"]
    assert complete_scenario("nowhere/") == []
    assert complete_run("") == ["runs/a"]
    assert complete_run("runs/") == ["runs/a"]
    assert complete_run(".h") == [".hidden"]


def test_a_group_runs_its_first_command_by_default(anser):
    shown = CliRunner().invoke(app, ["campaign", "--help"], env={"COLUMNS": "150", "TERM": "dumb"}).stdout
    for name in ("fly", "report", "compare"):
        assert re.search(rf"^│ {name} ", shown, re.MULTILINE)
    for arguments, said in (
        (("campaign", "study.toml"), "Missing option '--out'"),
        (("campaign", "--resume", "study.toml"), "Missing option '--out'"),
        (("campaign", "fly", "study.toml"), "Missing option '--out'"),
        (("campaign", "reprot", "folder"), "Did you mean 'report'"),
        (("campaign", "nowhere.toml", "--out", "x"), "nowhere.toml"),
    ):
        code, printed, err = anser(*arguments)
        assert (code, printed) == (2, "")
        assert said in err
    assert {"report", "compare"} <= set(_completed("anser campaign ", ROOT))
    assert "--processes" in _completed("anser campaign x.toml --", ROOT)


def test_variants_are_those_of_the_aircraft():
    context = typer.Context(get_command(app))
    context.params = {"aircraft": "f16"}
    assert complete_variant(context, "te") == ["textbook"]
    context.params = {"aircraft": "balloon"}
    assert "s119" in complete_variant(context, "")


@pytest.mark.parametrize("no_color", ["", "1"])
def test_colours_respect_no_color(no_color):
    script = (
        "from anser.cli.commands import app; from anser.cli.console import err, screen\n"
        "screen.print('r 12', style='red'); err.print('e', style='red')\n"
        "try: app(['run', '--help'])\nexcept SystemExit: pass"
    )
    environment = os.environ | {"FORCE_COLOR": "1", "TERM": "xterm-256color", "NO_COLOR": no_color}
    completed = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert bool(COLOUR.search(completed.stdout)) is not bool(no_color)
    assert bool(COLOUR.search(completed.stderr)) is not bool(no_color)
    assert "\x1b[1m" in completed.stdout  # bold is no colour


def test_progress_shows_the_remaining_time():
    clock = [0.0]
    screen = rich.console.Console(file=io.StringIO())
    period = console._SPEED_PERIOD_S
    with rich.progress.Progress(
        console=screen, auto_refresh=False, get_time=lambda: clock[0], speed_estimate_period=period
    ) as bar:
        bar.add_task("flying", total=1.0)
        (task,) = bar.tasks
        times = console._Times()
        assert times.render(task).plain == "0:00"
        clock[0] = 100.0  # compiling: the first step stands for no speed
        bar.update(task.id, completed=0.25)
        assert times.render(task).plain == "1:40"
        for completed in (0.5, 0.75):
            clock[0] += 40.0
            bar.update(task.id, completed=completed)
        assert times.render(task).plain == "3:00, 0:40 left"
        clock[0] = 7300.0
        bar.update(task.id, completed=1.0)
        assert times.render(task).plain == "2:01:40"


def test_no_bar_without_a_screen_or_by_quiet(monkeypatch, capsys):
    with progress_bar() as tell:
        tell("flying", 0.5)
    assert capsys.readouterr() == ("", "")
    watched = rich.console.Console(stderr=True, force_terminal=True, _environ={"TERM": "xterm", "COLUMNS": "80"})
    monkeypatch.setattr(console, "note", watched)
    with progress_bar() as tell:
        tell("flying", 0.5)
        time.sleep(0.5)  # it is drawn ten times a second
    assert "flying" in capsys.readouterr().err
    monkeypatch.setattr(watched, "quiet", True)
    with progress_bar() as tell:
        tell("flying", 0.5)
    assert capsys.readouterr() == ("", "")


def test_a_log_gets_a_line_each_ten_seconds(monkeypatch, capsys):
    monkeypatch.setattr(console, "_LOG_PERIOD_S", 0.1)
    monkeypatch.setattr(console, "_REFRESH_PERIOD_S", 0.05)

    def first_line():
        for _ in range(100):
            time.sleep(0.1)
            out, message = capsys.readouterr()
            assert out == ""
            if message:
                return message.splitlines()[0]
        raise AssertionError("no line in ten seconds")

    with progress_bar() as tell:
        tell("flying", 0.25)
        assert re.fullmatch(r"flying, 25 %, 0:\d\d gone", first_line())
    with activity("solving"):
        assert re.fullmatch(r"solving, 0:\d\d gone", first_line())
    capsys.readouterr()
    monkeypatch.setattr(console.note, "quiet", True)
    with activity("solving"):
        time.sleep(0.25)
    assert capsys.readouterr() == ("", "")


def test_the_bar_shows_a_known_fraction_and_moves_otherwise(monkeypatch):
    updates = []
    update = console.Progress.update

    def watch(self, task, **changes):
        update(self, task, **changes)
        updates.append((self.tasks[0].description, self.tasks[0].percentage if self.tasks[0].total else None))

    monkeypatch.setattr(console.Progress, "update", watch)
    monkeypatch.setattr(console, "_REFRESH_PERIOD_S", 0.05)
    record = Compilation("flight", {})
    monkeypatch.setattr(measuring, "compilations", [record])
    with progress_bar() as tell:
        tell("planning", None)
        tell("flying", 0.25)
        with measuring.waiting(), measuring.measured(record, "tracing"):
            time.sleep(0.5)
        tell("flying", 0.5)
        tell("writing", None)
    assert [change for change, _ in itertools.groupby(updates)] == [
        ("starting", None),
        ("planning", None),
        ("flying", 25.0),
        ("compiling program 1 (flight)", None),
        ("flying", 50.0),
        ("writing", None),
    ]
