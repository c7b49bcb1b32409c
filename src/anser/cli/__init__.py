"""Command line: the entry point of the program `anser`.

Exit codes: 0 success; 1 a requirement is not met; 2 invalid input; 3 internal fault; 130 stopped by Ctrl-C.

Modules that all commands share: `commands` (list of commands), `app` (options --json and --quiet), `console` (output
and error messages), `arguments`, `overrides` (option --set), `folders` (output folders), `process` (Ctrl-C, streams).
Each of the other modules contains related commands.
"""

import atexit
import gc
import signal
import sys

from anser.cli.process import INTERRUPTED, guarded_streams, interrupts, without_dask


def main() -> None:
    """Run the command of the command line, and end the process with the command's exit code."""
    # imports and tracing create many long-lived objects; frequent garbage collection costs 10 %
    gc.set_threshold(200_000)
    with guarded_streams() as unwritten, interrupts.watched(), without_dask():
        try:
            from anser.cli.commands import exit_code  # imported here so that Ctrl-C works during the imports

            code = exit_code()
        except BaseException:
            if not interrupts.arrived:
                raise
            code = INTERRUPTED
        if interrupts.arrived:
            interrupts.end_process()
        if (reason := unwritten()) is not None:
            sys.stderr.write(
                f"standard output: arrived a stream that cannot be written ({reason}); expected one that can\n"
            )
            code = 2
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)  # the work is done: ignore later interrupts
    atexit.register(gc.freeze)  # a last collection of all objects takes half a second
    sys.exit(code)


__all__ = ["main"]
