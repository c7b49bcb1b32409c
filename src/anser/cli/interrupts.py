"""Ctrl-C: the first one stops the command, wherever it arrives; one message, exit code 130, nothing half-written."""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from types import FrameType

INTERRUPTED = 130


class Interrupts:
    """Interrupts of this process.

    Attributes
    ----------
    arrived
        Whether there was one. A library may have caught the exception, or made another of it.
    """

    def __init__(self) -> None:
        self.arrived = False

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Note an interrupt in the block, besides raising KeyboardInterrupt; not if the process ignores them."""
        self.arrived = False
        handler = signal.getsignal(signal.SIGINT)
        if handler is not signal.default_int_handler:
            yield
            return
        signal.signal(signal.SIGINT, self._note)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, handler)

    def check(self) -> None:
        """Raise KeyboardInterrupt if one arrived: a library may have swallowed it."""
        if self.arrived:
            raise KeyboardInterrupt

    def end_process(self) -> None:
        """End at once, with the message: the threads of compilers and other libraries are not waited for."""
        from anser.output_files import remove_unfinished

        remove_unfinished()
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.write("stopped\n")
            sys.stderr.flush()
        os._exit(INTERRUPTED)

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        self.arrived = True
        sys.unraisablehook = lambda _: None  # an interrupt within a finaliser is no fault to be told
        raise KeyboardInterrupt


interrupts = Interrupts()
