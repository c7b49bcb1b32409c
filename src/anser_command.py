"""Entry point of the command `anser`: Ctrl-C ends it with one message also while the package itself is imported.

The module stands outside the package, whose import would come first. It imports built-in modules only: `signal`, which
imports `enum`, would take several milliseconds before the handler is installed.
"""

import _signal  # pyright: ignore[reportMissingImports] - a built-in module without a stub
import os
import sys

INTERRUPTED = 130


def main() -> None:
    """Run the command line; `anser.cli` handles Ctrl-C from there on."""
    from anser.cli import main as run_command_line

    run_command_line()


def _stop(number: int, frame: object) -> None:
    os.write(2, b"stopped\n")
    os._exit(INTERRUPTED)


# A process of a campaign imports this module too, after multiprocessing; only the command itself reports the end.
if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler and "multiprocessing" not in sys.modules:
    _signal.signal(_signal.SIGINT, _stop)
