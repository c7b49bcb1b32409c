"""Scores of the environments for learning: expert, zero and random actions over many episodes.

`python -m trials.environment_scores AltitudeChange surfaces velocity --episodes 1000` prints rows of the table in
docs/how-to/learning.md.
"""

import argparse

import typer

from anser.environments import make, score

POLICIES = ("expert", "zero", "random")


def row(task: str, level: str, episodes: int) -> str:
    """Return the row of a task at a level: share of successes and mean return of each policy."""
    environment = make(task, level)
    scores = [score(environment, policy, episodes) for policy in POLICIES]
    cells = [f"{100.0 * result.success:.1f} % | {result.mean_return:.3f}" for result in scores]
    return f"| `{task}` | {level} | {' | '.join(cells)} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("levels", nargs="+")
    parser.add_argument("--episodes", type=int, default=1000)
    arguments = parser.parse_args()
    for level in arguments.levels:
        typer.echo(row(arguments.task, level, arguments.episodes))
