"""Selection and run of checks; each check is timed, and a failing check does not stop the run."""

import difflib
import re
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future

from anser.verification.aerosonde import AEROSONDE_FORCES
from anser.verification.checks import Check, Outcome
from anser.verification.f16_data import F16_AERO_SHOTS, F16_ENGINE_SHOTS, F16_FILES, THESIS_TABLES
from anser.verification.integrator import INTEGRATION_CHECKS
from anser.verification.linear_models import LINEAR_CHECKS
from anser.verification.missions import MISSION_CHECKS
from anser.verification.nesc import NESC_CHECKS
from anser.verification.polynomial_paths import ARC_LENGTHS
from anser.verification.standards import USSA76, WGS84_FIGURE
from anser.verification.textbook import F16_DERIVATIVES, F16_TRIM, F16_TURN

CHECKS: tuple[Check, ...] = (
    USSA76,
    WGS84_FIGURE,
    F16_DERIVATIVES,
    F16_TRIM,
    F16_TURN,
    F16_AERO_SHOTS,
    F16_ENGINE_SHOTS,
    AEROSONDE_FORCES,
    F16_FILES,
    THESIS_TABLES,
    ARC_LENGTHS,
    *LINEAR_CHECKS,
    *INTEGRATION_CHECKS,
    *NESC_CHECKS,
    *MISSION_CHECKS,
)
"""All checks, in the order in which they are printed."""

Progress = Callable[[str, float], None]
"""Callback with the key of the current check and the completed fraction of the checks, 0..1."""


def select_checks(keys: Iterable[str] | None = None, checks: Sequence[Check] | None = None) -> tuple[Check, ...]:
    """Select checks by key, without repetition, in the order of `checks`.

    `keys` None selects every check; `checks` None means `CHECKS`. A NESC check-case may be requested by number: `9`,
    `13.1` or `nesc-9`; `13` selects all parts of case 13. Raises ValueError if a key is unknown; the message names the
    closest known key and lists the known keys.
    """
    checks = CHECKS if checks is None else checks
    if keys is None:
        return tuple(checks)
    known_keys = [check.key for check in checks]
    requested_keys = [known_key for key in keys for known_key in _expand_key(key, known_keys)]
    for key in requested_keys:
        if key not in known_keys:
            close = difflib.get_close_matches(key, known_keys, n=1, cutoff=0.0)
            nearest = f"; the closest is {close[0]}" if close else ""
            raise ValueError(f"arrived {key!r}{nearest}; known are {', '.join(known_keys)}")
    return tuple(check for check in checks if check.key in requested_keys)


def _expand_key(key: str, known_keys: Sequence[str]) -> list[str]:
    """Return the keys of the checks that a requested key means: all parts of a NESC case, or a single key."""
    number = re.fullmatch(r"(?:nesc-)?0*(\d{1,2})(\.\d.*)?", key)
    if number:
        key = f"nesc-{int(number[1]):02d}{number[2] or ''}"
    parts = [known for known in known_keys if key.startswith("nesc-") and known.startswith((f"{key}.", f"{key}-"))]
    return [key] if key in known_keys or not parts else parts


def verify(
    keys: Iterable[str] | None = None, progress: Progress | None = None, checks: Sequence[Check] | None = None
) -> tuple[Outcome, ...]:
    """Run checks and return their outcomes, in the order of the checks.

    `keys` and `checks`: see `select_checks`. `progress` is called before each check and at the end, from two threads if
    there are slow checks. If a check raises an exception, its outcome fails with the exception as `problem`. Raises
    ValueError if a key is unknown.
    """
    selected = select_checks(keys, checks)
    finished: list[Check] = []

    def run_in_order(part: Sequence[Check]) -> dict[str, Outcome]:
        outcomes = {}
        for check in part:
            if progress is not None:
                progress(check.key, len(finished) / len(selected))
            outcomes[check.key] = _run(check)
            finished.append(check)
        return outcomes

    # Most of the time is compilation outside the interpreter's lock: the long checks run in a second thread. It is a
    # daemon, so that an interrupt of the program does not wait for it.
    background: Future[dict[str, Outcome]] = Future()

    def run_in_background() -> None:
        try:
            background.set_result(run_in_order([check for check in selected if check.long]))
        except BaseException as raised:  # noqa: BLE001 - raised again in the waiting thread
            background.set_exception(raised)

    threading.Thread(target=run_in_background, daemon=True).start()
    outcomes = run_in_order([check for check in selected if not check.long]) | background.result()
    if progress is not None:
        progress("done", 1.0)
    return tuple(outcomes[check.key] for check in selected)


def _run(check: Check) -> Outcome:
    start = time.perf_counter()
    try:
        comparisons = tuple(check.measure())
    except Exception as error:  # noqa: BLE001 - a failing check is reported and does not stop the others
        return Outcome(check, (), time.perf_counter() - start, f"{type(error).__name__}: {error}")
    problem = None if comparisons else "it compared nothing"
    return Outcome(check, comparisons, time.perf_counter() - start, problem)
