"""Functions for the workers of a test cluster, and a scheduler and workers in separate processes."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

TESTS = Path(__file__).parents[1]


def marked(folder, chunk):
    """Write a file instead of flying."""
    (folder / str(chunk)).write_text("")


def slow(folder, chunk):
    """As `marked`, but every chunk except the first takes an hour."""
    if chunk > 0:
        time.sleep(3600.0)
    marked(folder, chunk)


def deadly(folder, chunk):
    """As `marked`, but chunk 1 kills the worker."""
    if chunk == 1:
        with (folder / "deaths").open("a") as deaths:
            deaths.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    marked(folder, chunk)


class Worker:
    """A worker process without a nanny, optionally restarted after its death."""

    def __init__(self, address, options, is_restarted):
        command = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
        self._command, self._options, self._is_restarted = [*command, "--no-dashboard"], options, is_restarted
        self._process = self._start()
        threading.Thread(target=self._restart_after_death, daemon=True).start()

    def kill(self):
        """Kill the worker permanently."""
        self._is_restarted = False
        self._process.kill()

    def _start(self):
        return subprocess.Popen(self._command, stderr=subprocess.DEVNULL, **self._options)

    def _restart_after_death(self):
        self._process.wait()
        while self._is_restarted:
            self._process = self._start()
            self._process.wait()


@contextlib.contextmanager
def start_cluster(path=(str(TESTS), *sys.path), is_restarted=False):
    """Start a scheduler and one worker with a module path; yield the address, the scheduler and the worker."""
    options = {"env": {**os.environ, "PYTHONPATH": os.pathsep.join(path)}, "stdout": subprocess.DEVNULL}
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    with subprocess.Popen([*command, "--no-dashboard"], stderr=subprocess.PIPE, text=True, **options) as scheduler:
        address = next(match[0] for line in scheduler.stderr if (match := re.search(r"tcp://127\.0\.0\.1:\d+", line)))
        threading.Thread(target=scheduler.stderr.read, daemon=True).start()
        worker = Worker(address, options, is_restarted)
        try:
            yield address, scheduler, worker
        finally:
            worker.kill()
            scheduler.kill()
