"""The command line of the trials: ``python -m trials``, in the root of the repository. Exit codes as for anser."""

import contextlib
import gc
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.text import Text

from anser.cli.app import help_epilog, register_command
from anser.cli.console import (
    InputError,
    columns,
    must_be_in_range,
    print_document,
    print_line,
    print_problem,
    print_table,
    progress_bar,
)
from anser.cli.process import INTERRUPTED

if TYPE_CHECKING:
    from trials.runner import Trial
    from trials.tally import Tally

_SEEDS_MOST = 1_000_000


@help_epilog(
    "python -m trials --seeds 0:100 --out trials.jsonl",
    "python -m trials --seeds 0:100 --out trials.jsonl --resume --jobs 4",
    unmet="a plan fails, or too many refusals are contradicted",
)
def plan_trials(
    out: Annotated[Path, typer.Option(help="New file of results, one JSON line per seed.", show_default=False)],
    seeds: Annotated[str, typer.Option(help="FIRST:LAST of the seeds, the last left out.")] = "0:2000",
    search_iterations: Annotated[
        int, typer.Option(help="Iterations of the second search's solver where the planner refuses, at most.")
    ] = 3000,
    jobs: Annotated[int, typer.Option(help="Processes at work at once.")] = 1,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the file of an interrupted run: seeds it has are left out.")
    ] = False,
) -> None:
    """Plan random scenarios; check each plan densely, and each refusal by proofs and a second search.

    The second search solves the flights by direct collocation with IPOPT, from random flights: a method independent of
    the planner's, with separate code. It finds local solutions: a refusal without a counterexample is not proved right.
    """
    seed_range = _seeds(seeds)
    must_be_in_range("--search-iterations", search_iterations, 1, 10_000_000)
    must_be_in_range("--jobs", jobs, 1, 1024)
    from trials.runner import run_trials
    from trials.tally import tally
    from trials.trial_file import append_trial

    trials = _begin(out, search_iterations, resume)
    completed = {trial.seed for trial in trials}
    remaining_seeds = [seed for seed in seed_range if seed not in completed]
    seed_count = len(seed_range)
    stopped = False
    with (
        progress_bar() as report_progress,
        contextlib.closing(run_trials(remaining_seeds, search_iterations, jobs)) as results,
    ):
        report_progress("planning (the first time, this compiles)", 1.0 - len(remaining_seeds) / seed_count)
        try:
            for count, trial in enumerate(results, start=1):
                append_trial(out, trial)
                trials.append(trial)
                report_progress(
                    f"seed {trial.seed}: {trial.verdict}", 1.0 - (len(remaining_seeds) - count) / seed_count
                )
        except KeyboardInterrupt:
            stopped = True
    counts = tally([trial for trial in trials if seed_range.start <= trial.seed < seed_range.stop])
    print_document(
        lambda: {
            "format_version": 1,
            "seeds": [seed_range.start, seed_range.stop],
            "done": counts.count(),
            "by_rule": {rule: dict(verdicts) for rule, verdicts in counts.by_rule.items()},
            "disagreements": list(counts.disagreements),
            "passes": counts.passes,
        }
    )
    _print_verdicts(counts)
    for disagreement in counts.disagreements:
        print_problem(disagreement)
    print_line(f"{out}: {counts.count()} of {seed_count} seeds")
    if stopped:
        print_problem("stopped; --resume goes on from here")
        raise typer.Exit(INTERRUPTED)
    if not counts.passes:
        raise typer.Exit(1)


def main() -> None:
    """Run the command line and exit with its code."""
    gc.set_threshold(200_000)  # as in anser.cli: tracing makes many small objects that live
    app = typer.Typer(
        add_completion=False, context_settings={"help_option_names": ["--help", "-h"]}, pretty_exceptions_enable=False
    )
    register_command(app, plan_trials)
    try:
        app(prog_name="python -m trials")
    except InputError as error:
        print_problem(str(error))
        sys.exit(2)
    except Exception:  # noqa: BLE001 - the outermost frame: an internal fault must end with its own exit code
        traceback.print_exc()
        print_problem("internal fault of the trials: please report the lines above together with the seeds")
        sys.exit(3)


def _seeds(text: str) -> range:
    try:
        start, stop = (int(part) for part in text.split(":"))
    except ValueError:
        raise InputError(f"--seeds: arrived {text!r}; expected FIRST:LAST, such as 0:2000") from None
    if not (0 <= start < stop and stop - start <= _SEEDS_MOST):
        raise InputError(
            f"--seeds: arrived {text!r}; expected 0 or more, then a greater number, {_SEEDS_MOST} seeds at most"
        )
    return range(start, stop)


def _begin(out: Path, iterations: int, resume: bool) -> "list[Trial]":
    """Trials of a run to resume; otherwise an empty list and a new file."""
    from trials.trial_file import TrialFileError, begin_trials, read_trials

    try:
        if resume:
            return read_trials(out, iterations)
        begin_trials(out, iterations)
    except TrialFileError as error:
        raise InputError(f"--out: {error}") from None
    except FileExistsError:
        raise InputError(
            f"--out: arrived {out}, which exists; expected a new file, or --resume (nothing is overwritten)"
        ) from None
    except FileNotFoundError:
        expected = "a file to resume" if resume else "a file in a folder that exists"
        raise InputError(f"--out: arrived {out}; expected {expected}") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise InputError(f"--out: arrived {out}; expected a file of trials ({reason})") from None
    return []


def _print_verdicts(counts: "Tally") -> None:
    """Print the number of verdicts by rule and in total."""
    rows, styles = [], []
    for rule, part in [*((rule, counts.of_rule(rule)) for rule in counts.by_rule), ("all", counts)]:
        bad = [part.count(verdict) for verdict in ("fails", "found", "broken")]
        fails, contradicted, broken = (Text(str(number), "red") if number else 0 for number in bad)
        proved, not_found = part.count("proved"), part.count("not found")
        rows.append([rule, part.count(), part.planned, fails, part.refused, proved, not_found, contradicted, broken])
        styles.append("bold" if rule == "all" else None)
    names = ("seeds", "plans", "of them\nfail", "refusals", "proved", "none\nfound", "plan\nfound", "raised")
    headings = [*columns("rule", no_wrap=True), *columns(*names, justify="right", no_wrap=True)]
    print_table("answers of the planner and verdicts of the independent checker", headings, rows, styles)


if __name__ == "__main__":
    main()
