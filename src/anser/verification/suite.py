"""Running checks: each is timed, and one that breaks does not stop the others."""

import difflib
import re
import threading
import time
from collections.abc import Callable, Iterable, Sequence

from anser.verification.aerosonde import AEROSONDE_FORCES
from anser.verification.checks import Check, Outcome
from anser.verification.f16_files import F16_FILES
from anser.verification.f16_tables import F16_AERO_SHOTS, F16_ENGINE_SHOTS, THESIS_TABLES
from anser.verification.integrator import INTEGRATION_CHECKS
from anser.verification.linear_models import LINEAR_CHECKS
from anser.verification.missions import MISSION_CHECKS
from anser.verification.nesc import NESC_CHECKS
from anser.verification.polynomial_paths import ARC_LENGTHS
from anser.verification.standards import USSA76, WGS84_FIGURE
from anser.verification.textbook_checks import F16_DERIVATIVES, F16_TRIM, F16_TURN

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
"""Called with what is being done and the part that is done, 0 to 1."""


def select_checks(keys: Iterable[str] | None = None, checks: Sequence[Check] | None = None) -> tuple[Check, ...]:
    """Checks by their keys, each once and in the order of `checks` (`CHECKS` where None); all of them without keys.

    A check-case of the NESC may go by its number, `9`, `13.1` or `nesc-9`; `13` is all parts of case 13.

    Raises
    ------
    ValueError
        If a key is unknown; the message names the closest known one and lists all.
    """
    checks = CHECKS if checks is None else checks
    if keys is None:
        return tuple(checks)
    known = [check.key for check in checks]
    wanted = [part for key in keys for part in _parts(_whole(key), known)]
    for key in wanted:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1, cutoff=0.0)
            nearest = f"; the closest is {close[0]}" if close else ""
            raise ValueError(f"arrived {key!r}{nearest}; known are {', '.join(known)}")
    return tuple(check for check in checks if check.key in wanted)


def _parts(key: str, known: Sequence[str]) -> list[str]:
    """The key itself, or those of the parts of a check-case that is flown in several."""
    parts = [one for one in known if key.startswith("nesc-") and one.startswith((f"{key}.", f"{key}-"))]
    return [key] if key in known or not parts else parts


def _whole(key: str) -> str:
    number = re.fullmatch(r"(?:nesc-)?0*(\d{1,2})(\.\d.*)?", key)
    return f"nesc-{int(number[1]):02d}{number[2] or ''}" if number else key


def verify(
    keys: Iterable[str] | None = None, progress: Progress | None = None, checks: Sequence[Check] | None = None
) -> tuple[Outcome, ...]:
    """Run checks.

    Parameters
    ----------
    keys
        Which; all of them where None.
    progress
        Called before each check, and at the end; from two threads where there are long checks.
    checks
        The checks there are; `CHECKS` where None.

    Returns
    -------
    One outcome per check, in their order. A check that raises is an outcome that does not pass and says what was
    raised.

    Raises
    ------
    ValueError
        If a key is unknown.
    """
    chosen = select_checks(keys, checks)
    finished: list[Check] = []

    def run_in_order(part: Sequence[Check]) -> dict[str, Outcome]:
        found = {}
        for check in part:
            if progress is not None:
                progress(check.key, len(finished) / len(chosen))
            found[check.key] = _run(check)
            finished.append(check)
        return found

    # Compiling is most of the work and leaves the interpreter free: the long checks are run beside the others.
    background = _BackgroundRun(lambda: run_in_order([check for check in chosen if check.long]))
    outcomes = run_in_order([check for check in chosen if not check.long]) | background.result()
    if progress is not None:
        progress("done", 1.0)
    return tuple(outcomes[check.key] for check in chosen)


class _BackgroundRun(threading.Thread):
    """A thread with a result; an interrupt of the program does not wait for it."""

    def __init__(self, work: Callable[[], dict[str, Outcome]]) -> None:
        super().__init__(daemon=True)
        self._work = work
        self._result: dict[str, Outcome] = {}
        self._raised: BaseException | None = None
        self.start()

    def run(self) -> None:
        try:
            self._result = self._work()
        except BaseException as raised:  # noqa: BLE001 - handed on to the thread that waits
            self._raised = raised

    def result(self) -> dict[str, Outcome]:
        """Wait for the work and give its result, or raise what it raised."""
        self.join()
        if self._raised is not None:
            raise self._raised
        return self._result


def _run(check: Check) -> Outcome:
    start = time.perf_counter()
    try:
        comparisons = tuple(check.measure())
    except Exception as error:  # noqa: BLE001 - whatever breaks one check, the others are run and it is named
        return Outcome(check, (), time.perf_counter() - start, f"{type(error).__name__}: {error}")
    problem = None if comparisons else "it compared nothing"
    return Outcome(check, comparisons, time.perf_counter() - start, problem)
