"""BeBOT's example of four airliners, planned by its method and by ours in one run: `python benchmarks/airliners.py`.

The method is written anew in bernstein_method.py; the example's numbers and their source are in airliners.toml. It is
timed twice: stated as the source states it, and the same method better stated. Every plan is checked on a dense grid.
Compare ratios within one run: the seconds depend on the machine and on what else it does.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices this small are slower on several threads

import statistics
import sys
import time
from collections.abc import Callable

import jax
from airliners_example import Example, Extremes, Flown, broken_limits, dense_extremes, load_example
from bernstein_method import BernsteinPlan, BernsteinProblem

REPEATS = 5


def bernstein_problem(example: Example, *, scaled: bool, repeats: int = REPEATS) -> tuple[BernsteinPlan, float]:
    """Solve the example by the method of the source, several times; the plan and the median seconds of the solver.

    `scaled` states it in units of order one with an exact Jacobian; without it all is as in the source.
    """
    problem = BernsteinProblem(example, scaled=scaled)
    plans = [problem.solve() for _ in range(repeats)]
    return plans[-1], statistics.median(plan.seconds for plan in plans)


def time_ours(ours: Callable[[], object], repeats: int = REPEATS) -> tuple[object, float, float]:
    """Call our planner: its plan, the seconds of the first call (compilation) and the median of the later ones."""

    def once() -> tuple[object, float]:
        began = time.perf_counter()
        plan = jax.block_until_ready(ours())
        return plan, time.perf_counter() - began

    plan, first = once()
    return plan, first, statistics.median(once()[1] for _ in range(repeats))


def describe(flown: Flown, found: Extremes) -> None:
    """Print one plan: its cost and its extremes."""
    times = ", ".join(f"{one:.0f}" for one in flown.durations_s)
    print(f"  flight times {times} s, together {flown.durations_s.sum():.0f} s")
    print(
        f"  speed {found.speed_min_m_s:.2f} to {found.speed_max_m_s:.2f} m/s, turn rate up to "
        f"{found.turn_rate_max_rad_s:.5f} rad/s, separation {found.separation_min_m / 1e3:.1f} km"
    )


def main(ours: Callable[[], object] | None = None, read_ours: Callable[[object], Flown] | None = None) -> int:
    """Plan the example by both and print the times, their ratio and the checks; 1 when a plan breaks a limit.

    Parameters
    ----------
    ours
        Plans `our_request(load_example())`; called once to compile, then timed.
    read_ours
        Reads its plan for the dense check, in the plane of the projection.
    """
    example = load_example()
    straight = float(sum(((example.goal_m - example.start_m) ** 2).sum(axis=1) ** 0.5)) / example.speed_max_m_s
    print(f"no plan can be shorter than {straight:.0f} s together: straight lines at {example.speed_max_m_s:g} m/s")
    wrong: list[str] = []
    theirs: dict[str, float] = {}
    # SLSQP ends when the constraints together miss by less than its tolerance: in the source's units v^2 may miss by it
    loose = example.cost_tolerance_s / (2.0 * example.speed_min_m_s)
    for scaled in (False, True):
        name = "Bernstein, scaled, exact Jacobian" if scaled else "Bernstein, as published"
        plan, theirs[name] = bernstein_problem(example, scaled=scaled)
        found = dense_extremes(example, plan.flown())
        print(f"{name}: {1e3 * theirs[name]:.1f} ms, {plan.iterations} iterations")
        describe(plan.flown(), found)
        wrong += [f"{name}: {one}" for one in broken_limits(example, found, loose)]
        if not plan.converged:
            wrong.append(f"{name}: {plan.message}")
    if ours is not None:
        plan, first, seconds = time_ours(ours)
        print(f"ours: {1e3 * seconds:.1f} ms (first call, with compilation: {first:.1f} s)")
        if read_ours is not None:
            found = dense_extremes(example, read_ours(plan))
            describe(read_ours(plan), found)
            rounding = 1e-6  # m/s, of a plan that flies at the limit itself
            wrong += [f"ours: {one}" for one in broken_limits(example, found, rounding)]
        for name, their_seconds in theirs.items():
            print(f"{name} takes {their_seconds / seconds:.1f} times as long as ours")
    for one in wrong:
        print(f"limit broken: {one}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
