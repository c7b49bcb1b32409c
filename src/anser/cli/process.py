"""The process of the command line.

Ctrl-C with one message and exit code 130, and standard streams that may be closed or full. Standard library only,
because it is imported before everything else.
"""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, TextIO

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
        from anser.files import remove_temporary_outputs

        remove_temporary_outputs()
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


class GuardedStream:
    """A text stream that goes silent at the first text that cannot be written.

    Attributes
    ----------
    failure
        Why it went silent; None as long as it is written.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write a text, or nothing if the stream is silent."""
        self._guard(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flush the stream, unless it is silent."""
        self._guard(self._stream.flush)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _guard(self, write: Callable[[], object]) -> None:
        if self.failure is not None:
            return
        try:
            write()
        except OSError as error:
            self.failure = error
            _discard(self._stream)


@contextlib.contextmanager
def guarded_streams() -> Iterator[Callable[[], str | None]]:
    """Guard standard output and standard error in the block.

    A reader that has read enough, as ``head`` does, is no failure, and of standard error nobody could be told.

    Returns
    -------
    Function that flushes standard output and returns why it could not be written; None if all of it was, or if its
    reader closed it.
    """
    _open_closed_descriptors()
    before = sys.stdout, sys.stderr
    out, err = (GuardedStream(_tolerant(stream)) for stream in before)
    sys.stdout, sys.stderr = out, err  # pyright: ignore[reportAttributeAccessIssue]

    def unwritten() -> str | None:
        out.flush()
        if out.failure is None or isinstance(out.failure, BrokenPipeError):
            return None
        return out.failure.strerror or str(out.failure)

    try:
        yield unwritten
    finally:
        sys.stdout, sys.stderr = before


def _tolerant(stream: TextIO | None) -> TextIO:
    """Make a stream write characters that its encoding lacks as escapes; one that is closed gets nothing."""
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8")
    reconfigure = getattr(stream, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="backslashreplace")
    return stream


def _open_closed_descriptors() -> None:
    """Open the null device where a standard stream is closed: the next file would get its number, and its messages."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _discard(stream: TextIO) -> None:
    """Send what the stream still holds to the null device, or it fails again when the process ends."""
    with contextlib.suppress(OSError, ValueError):
        target = os.open(os.devnull, os.O_WRONLY)
        os.dup2(target, stream.fileno())
        os.close(target)
