"""BeBOT's example of four airliners, planned by its method and by anser in one run: `python benchmarks/airliners.py`.

The method is reimplemented in bernstein_method.py; the example's numbers and their source are in airliners.toml. It is
timed in two versions: as published, and with better scaling. Every plan is checked on a dense grid. Compare ratios
within one run: absolute times depend on the machine and its load.
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
    """Solve the example by the published method, several times; return the plan and the solver's median time, s.

    `scaled` uses units of order one and an exact Jacobian; otherwise everything is as published.
    """
    problem = BernsteinProblem(example, scaled=scaled)
    plans = [problem.solve() for _ in range(repeats)]
    return plans[-1], statistics.median(plan.seconds for plan in plans)


def time_ours(plan_example: Callable[[], object], repeats: int = REPEATS) -> tuple[object, float, float]:
    """Call anser's planner: its plan, the time of the first call (compilation) and the median of later calls, s."""

    def timed_call() -> tuple[object, float]:
        began = time.perf_counter()
        plan = jax.block_until_ready(plan_example())
        return plan, time.perf_counter() - began

    plan, compile_seconds = timed_call()
    return plan, compile_seconds, statistics.median(timed_call()[1] for _ in range(repeats))


def describe(flown: Flown, extremes: Extremes) -> None:
    """Print the cost and the extremes of one plan."""
    times = ", ".join(f"{duration:.0f}" for duration in flown.durations_s)
    print(f"  flight times {times} s, together {flown.durations_s.sum():.0f} s")
    print(
        f"  speed {extremes.speed_min_m_s:.2f} to {extremes.speed_max_m_s:.2f} m/s, turn rate up to "
        f"{extremes.turn_rate_max_rad_s:.5f} rad/s, separation {extremes.separation_min_m / 1e3:.1f} km"
    )


def main(plan_example: Callable[[], object] | None = None, read_plan: Callable[[object], Flown] | None = None) -> int:
    """Plan the example by both methods and print the times, their ratio and the checks; 1 if a plan violates a limit.

    Parameters
    ----------
    plan_example
        Plans `our_request(load_example())`; called once to compile, then timed.
    read_plan
        Converts the plan for the dense check, in the plane of the projection.
    """
    example = load_example()
    straight = float(sum(((example.goal_m - example.start_m) ** 2).sum(axis=1) ** 0.5)) / example.speed_max_m_s
    print(f"no plan can be shorter than {straight:.0f} s together: straight lines at {example.speed_max_m_s:g} m/s")
    violations: list[str] = []
    published_seconds: dict[str, float] = {}
    # SLSQP ends when the sum of the constraint violations is within its tolerance, in the source's units that of v^2
    speed_tolerance = example.cost_tolerance_s / (2.0 * example.speed_min_m_s)
    for scaled in (False, True):
        name = "Bernstein, scaled, exact Jacobian" if scaled else "Bernstein, as published"
        plan, published_seconds[name] = bernstein_problem(example, scaled=scaled)
        extremes = dense_extremes(example, plan.flown())
        print(f"{name}: {1e3 * published_seconds[name]:.1f} ms, {plan.iterations} iterations")
        describe(plan.flown(), extremes)
        violations += [f"{name}: {violation}" for violation in broken_limits(example, extremes, speed_tolerance)]
        if not plan.converged:
            violations.append(f"{name}: {plan.message}")
    if plan_example is not None:
        plan, compile_seconds, seconds = time_ours(plan_example)
        print(f"ours: {1e3 * seconds:.1f} ms (first call, with compilation: {compile_seconds:.1f} s)")
        if read_plan is not None:
            extremes = dense_extremes(example, read_plan(plan))
            describe(read_plan(plan), extremes)
            rounding = 1e-6  # m/s, for a plan at the limit itself
            violations += [f"ours: {violation}" for violation in broken_limits(example, extremes, rounding)]
        for name, their_seconds in published_seconds.items():
            print(f"{name} takes {their_seconds / seconds:.1f} times as long as ours")
    for violation in violations:
        print(f"limit broken: {violation}", file=sys.stderr)
    return 1 if violations else 0


if __name__ == "__main__":
    sys.exit(main())
