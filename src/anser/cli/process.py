"""Process of the command line: Ctrl-C with one message and exit code 130; closed or full standard streams.

This module uses the standard library only, because it is imported first.
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from importlib.machinery import ExtensionFileLoader
from types import FrameType
from typing import Any, TextIO

INTERRUPTED = 130


class Interrupts:
    """Record of interrupts (Ctrl-C) of this process; `arrived` stays True even if a library catches the exception."""

    def __init__(self) -> None:
        self.arrived = False

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Record interrupts in the `with` block and raise KeyboardInterrupt, unless the process ignores Ctrl-C."""
        self.arrived = False
        handler = signal.getsignal(signal.SIGINT)
        if handler in (signal.SIG_IGN, None):
            yield
            return
        signal.signal(signal.SIGINT, self._note)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, handler)

    def check(self) -> None:
        """Raise KeyboardInterrupt if an interrupt has arrived, even if a library has caught the exception."""
        if self.arrived:
            raise KeyboardInterrupt

    def end_process(self) -> None:
        """Remove temporary outputs, print "stopped" and end the process at once, with exit code 130."""
        from anser.files import remove_temporary_outputs

        remove_temporary_outputs()
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.write("stopped\n")
            sys.stderr.flush()
        os._exit(INTERRUPTED)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.arrived = True
        sys.unraisablehook = lambda _: None  # no message for an interrupt inside a finaliser
        if _loads_extension(frame):
            threading.Timer(_POSTPONED_S, _interrupt_main_thread, (number,)).start()
            return
        raise KeyboardInterrupt


def _interrupt_main_thread(number: int) -> None:
    """Send the signal `number` to the main thread, which a signal to another thread would not wake."""
    thread = threading.main_thread().ident
    if thread is not None and hasattr(signal, "pthread_kill"):
        signal.pthread_kill(thread, number)
    else:  # Windows
        signal.raise_signal(number)


_POSTPONED_S = 0.02
"""Delay, s, of an interrupt that arrives during the import of an extension module."""


def _loads_extension(frame: FrameType | None) -> bool:
    """Whether the frame or its callers import an extension module; an exception could then cause a memory fault."""
    while frame is not None:
        if isinstance(frame.f_locals.get("self"), ExtensionFileLoader):
            return True
        frame = frame.f_back
    return False


interrupts = Interrupts()


@contextlib.contextmanager
def without_dask() -> Iterator[None]:
    """Hide an installed dask from xarray in the `with` block, unless the command line has the option --cluster."""
    # xarray imports dask for every dataset, which takes half a second; an xarray imported before has already seen dask
    hidden = not {"dask", "xarray"} & set(sys.modules) and not any(word.startswith("--cluster") for word in sys.argv)
    if hidden:
        sys.modules["dask"] = None  # pyright: ignore[reportArgumentType] - the documented way to forbid an import
    try:
        yield
    finally:
        if hidden and sys.modules.get("dask", sys) is None:
            del sys.modules["dask"]


class GuardedStream:
    """Text stream that discards all text after the first failed write; `failure` is the error, or None."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write text, or discard text after a failure; return the number of characters."""
        self._guard(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flush the stream; after a failure, do nothing."""
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
    """Replace standard output and standard error by `GuardedStream` in the `with` block.

    Yields a function that flushes standard output and returns the reason for a failed write; None if no write failed.
    A pipe closed by the reader, such as ``head``, and failed writes to standard error do not count as failures.
    """
    _open_closed_descriptors()
    original_streams = sys.stdout, sys.stderr
    out, err = (GuardedStream(_tolerant(stream)) for stream in original_streams)
    sys.stdout, sys.stderr = out, err  # pyright: ignore[reportAttributeAccessIssue]

    def unwritten() -> str | None:
        out.flush()
        if out.failure is None or isinstance(out.failure, BrokenPipeError):
            return None
        return out.failure.strerror or str(out.failure)

    try:
        yield unwritten
    finally:
        sys.stdout, sys.stderr = original_streams


def _tolerant(stream: TextIO | None) -> TextIO:
    """Return the stream, set to escape characters outside its encoding; the null device if the stream is None."""
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8")
    reconfigure = getattr(stream, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="backslashreplace")
    return stream


def _open_closed_descriptors() -> None:
    """Open the null device for closed standard streams, so that no other file gets their descriptors."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _discard(stream: TextIO) -> None:
    """Redirect a stream's descriptor to the null device, so that its buffered text cannot fail at exit."""
    with contextlib.suppress(OSError, ValueError):
        target = os.open(os.devnull, os.O_WRONLY)
        os.dup2(target, stream.fileno())
        os.close(target)
