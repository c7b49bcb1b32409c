"""Commands in README, tutorials and how-to pages: quick ones run here, the others in the tests listed in COVERED."""

import os
import re
import sys
from pathlib import Path

import click
import pytest
import typer.main

from anser.cli import main
from anser.cli.commands import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("index.md")), *sorted((ROOT / "docs").glob("[th][uo]*/*.md"))]

BLOCK = re.compile(r"^```(?:sh|console|bash|\{code-cell\}[^\n]*\n%%sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PYTHON = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(anser [^`\n]+)`")
PLACEHOLDER = re.compile(r"\b[A-Z]{3,}")

REFUSED = ' || echo "exit code $?"'
"""Suffix of a command that must fail on a page."""

COVERED = {
    "make demo": ("tests/test_cli.py", 'anser("run", SCENARIOS / "three-aircraft.toml"'),
    "anser demo": ("tests/test_cli.py", 'anser("demo")'),
    "make test": ("Makefile", '-m "not long"'),  # this test is part of it
    "anser run scenarios/single-aircraft.toml --out first-flight": (
        "tests/missions/test_shipped_scenarios.py",
        '"single-aircraft"',
    ),
    f"anser run scenarios/single-aircraft.toml --out first-flight{REFUSED}": (
        "tests/test_cli.py",
        'assert "exists" in err',
    ),
    "anser run scenarios/storm-sampling.toml --out storm": (
        "tests/missions/test_shipped_scenarios.py",
        '"storm-sampling"',
    ),
    "python -m json.tool storm/summary.json": ("tests/test_cli.py", "json.loads((out /"),
    # tested with another scenario of three aircraft
    "anser run three-buoys.toml --out three-buoys": ("tests/test_cli.py", 'anser("run"'),
    "anser plan task.toml --out planned": ("tests/missions/test_certified.py", "return run(load("),
    "anser plan early.toml": (
        "tests/missions/test_certified.py",
        "test_an_early_arrival_time_is_refused_with_the_feasible_times",
    ),
    "anser run scenarios/twenty-aircraft.toml": (
        "tests/missions/test_certified.py",
        "return run(load(",
    ),  # two aircraft
    "anser plan scenarios/single-aircraft.toml": ("tests/test_cli_plan.py", 'anser("plan", THREE'),
    "anser report RUN_A RUN_B --out beside.html": ("tests/test_cli_report.py", 'anser("report", *runs, "--out", out)'),
    # at another airspeed below the least one
    f"anser trim --speed-m-s 40 --altitude-m 1000{REFUSED}": (
        "tests/test_cli.py",
        'anser("trim", "--speed-m-s", "30", "--altitude-m", "1000"',
    ),
    "anser linearize --speed-m-s 150 --altitude-m 1000 --loop velocity": (
        "tests/analysis/test_linearize_sampled.py",
        '"velocity"',
    ),
    "anser step --loop velocity --channel chi --size 20 --at 150,1000 --out course.png": (
        "tests/test_cli_step.py",
        "test_step_prints_its_metrics_and_draws",
    ),
    "anser gallery --out gallery": ("tests/test_cli_step.py", 'anser("gallery", "--out", out)'),
    # tested with the F-16, its steps and climb-and-turn in tests/analysis/test_step_cases.py
    "anser gallery --aircraft my-aircraft.toml --out my-gallery": (
        "tests/test_cli_step.py",
        'anser("gallery", "--out", out)',
    ),
    "anser robustness --out robustness": (
        "tests/analysis/test_robustness_study.py",
        "def test_the_command_writes_the_study(",
    ),
    "anser envelope --out envelope": (
        "tests/analysis/test_envelope_survey.py",
        "def test_the_command_writes_the_files",
    ),
    "anser sweep scenarios/three-aircraft.toml --set wind.speed_m_s=0:20:5 --out sweep": (
        "tests/test_cli_sweep.py",
        '"wind.speed_m_s=0:8:8"',
    ),
    "anser campaign studies/how-surely.toml --out runs/how-surely": (
        "tests/test_cli_campaign.py",
        'anser("campaign", study, "--out", out, "--processes", 1)',
    ),
    "anser campaign studies/how-surely.toml --out runs/how-surely --resume": (
        "tests/test_cli_campaign.py",
        '"--resume"',
    ),
    "anser campaign report runs/how-surely": (
        "tests/test_cli_campaign.py",
        'anser("campaign", "report", out, "--worst", 0)',
    ),
    "anser campaign compare runs/how-surely runs/windier --out compared": (
        "tests/test_cli_campaign.py",
        'anser("campaign", "compare", out, second, "--out", tmp_path / "compared")',
    ),
    "anser rare studies/how-rarely.toml --out runs/how-rarely": (
        "tests/test_cli_rare.py",
        'anser("rare", study, "--out", out, "--processes", 1)',
    ),
    "anser rare studies/how-rarely.toml --out runs/how-rarely --resume": (
        "tests/test_cli_rare.py",
        '"--processes", 1, "--resume")',
    ),
    "anser run --campaign runs/how-surely --flight 17": ("tests/test_cli_campaign.py", '"--flight", 1'),
    "anser aircraft show f16 --performance --altitude-m 3000": (
        "tests/single_aircraft/test_performance_sheet.py",
        'anser("aircraft", "show", "f16", "--performance", "--altitude-m", 3000, "--json")',
    ),
    "anser cache measure --scenario mine.toml": (
        "tests/test_cli_cache.py",
        'anser("cache", "measure", "--scenario", scenario, "--json")',
    ),
    "anser identify flight-12.csv --map columns.toml --aircraft my-uav.toml --validate flight-13.csv "
    "--out runs/flight-12": (
        "tests/test_cli_identify.py",
        'anser(*arguments, "--aircraft", "f16", "--json"',
    ),
    "python examples/train_velocity_command.py --seed 0 --out runs/velocity-command": (
        "tests/examples/test_train_velocity_command.py",
        'SCRIPT, "--seed"',
    ),
    "anser verify": ("tests/verification/test_nesc.py", "NESC_CHECKS"),  # with its neighbours, each check by itself
}
"""Commands too slow for this test, or installations: a file with the same or a smaller case, and a text in it."""


LONG_PAGES = {
    "README.md",
    "docs/how-to/own-airframe.md",
    "docs/tutorials/identify.md",  # in smaller form in tests/test_cli_identify.py
    "docs/tutorials/verify.md",  # in smaller form in tests/verification/test_command.py
}
"""Pages whose commands take longer than the rest together; most are run in smaller form by the command-line tests."""


def commands_of(page: Path) -> list[str]:
    """Commands in the shell blocks of a page, and complete commands in its text."""
    text = page.read_text(encoding="utf-8")
    commands = []
    for block in BLOCK.findall(text):
        for line in block.splitlines():
            line = line.removeprefix("$ ").split(" #")[0].strip()
            if line and not line.startswith("#"):
                commands += [line] if " || " in line else [part.strip() for part in line.split(" && ")]
    whole = [command for command in INLINE.findall(text) if not PLACEHOLDER.search(command) and "--" in command]
    return list(dict.fromkeys(commands + whole))


def run_quietly(command: str, monkeypatch: pytest.MonkeyPatch) -> int:
    arguments = command.removesuffix(REFUSED).split()
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


DOCUMENTED = {page.relative_to(ROOT).as_posix(): commands_of(page) for page in PAGES}


def test_the_pages_show_commands():
    # The patterns still find them: README and all seven tutorials but the tour, which is Python.
    assert len(DOCUMENTED["README.md"]) >= 5
    shown = [name for name, commands in DOCUMENTED.items() if "tutorials/" in name and commands]
    assert len(shown) >= 6


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(name, marks=pytest.mark.long if name in LONG_PAGES else ())
        for name, commands in DOCUMENTED.items()
        if set(commands) - set(COVERED)
    ],
)
def test_the_commands_of_a_page_succeed(page, monkeypatch, tmp_path, capsys):
    """In the order of the page, in an empty folder next to the scenarios, after the files written by the page."""
    monkeypatch.chdir(tmp_path)
    # `anser --install-completion` writes into the home folder, for the shell that it runs in.
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr("shellingham.detect_shell", lambda *_: ("bash", "/bin/bash"))
    os.symlink(ROOT / "scenarios", tmp_path / "scenarios")
    names: dict[str, object] = {}
    for cell in PYTHON.findall((ROOT / page).read_text(encoding="utf-8")):
        if "write_text(" in cell:
            exec(compile(cell, page, "exec"), names)
    for command in DOCUMENTED[page]:
        if command in COVERED:
            continue
        assert command.startswith("anser "), f"{page}: {command}: neither a command of anser nor listed in COVERED"
        code = run_quietly(command, monkeypatch)
        printed = capsys.readouterr()
        if command.endswith(REFUSED):
            assert code in (1, 2), (page, command, printed)
            assert printed.err, (page, command)
        else:
            assert code == 0, (page, command, printed)
            assert printed.out, (page, command)


@pytest.mark.parametrize(("command", "covering_test"), COVERED.items())
def test_covered_commands_are_shown_and_run_elsewhere(command, covering_test):
    file, text = covering_test
    assert any(command in commands for commands in DOCUMENTED.values()), f"{command}: no page shows it any more"
    assert text in (ROOT / file).read_text(encoding="utf-8"), f"{command}: {file} does not run it any more"


def test_every_command_named_in_the_text_exists_with_its_options():
    group = typer.main.get_command(app)
    assert isinstance(group, click.Group) or hasattr(group, "commands")
    for page in [*PAGES, *(ROOT / "docs").glob("*.md")]:
        for text in INLINE.findall(page.read_text(encoding="utf-8")):
            name, *arguments = re.sub(r"[\[\](),;]", " ", text.removeprefix("anser ")).split()
            commands = group.commands
            if hasattr(commands.get(name), "commands"):  # a group: of it the command named next, or the first
                commands = commands[name].commands
                name = arguments[0] if arguments and arguments[0] in commands else next(iter(commands))
            if name.startswith("-") or name.isupper():  # an option of all, or a word that stands for any command
                continue
            assert name in commands, f"{page.name}: `{text}`: no such command"
            options = {option for parameter in commands[name].params for option in parameter.opts}
            unknown = {word for word in arguments if word.startswith("--")} - options - {"--help"}
            assert not unknown, f"{page.name}: `{text}`: no such option {unknown}"


def test_every_room_has_its_page_of_the_api():
    listed = set(re.findall(r"^   (anser[\w.]*)$", (ROOT / "docs/reference/api.md").read_text(), flags=re.MULTILINE))
    rooms = {f"anser.{folder.name}" for folder in (ROOT / "src/anser").iterdir() if (folder / "__init__.py").exists()}
    assert rooms - {"anser.cli"} <= listed
