"""What the workers of a cluster are given in tests, and a scheduler and workers in processes of their own."""

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
    """Fly nothing: leave a file."""
    (folder / str(chunk)).write_text("")


def slow(folder, chunk):
    """As `marked`, but all chunks after the first take an hour."""
    if chunk > 0:
        time.sleep(3600.0)
    marked(folder, chunk)


def deadly(folder, chunk):
    """As `marked`, but chunk 1 kills its worker."""
    if chunk == 1:
        with (folder / "deaths").open("a") as deaths:
            deaths.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    marked(folder, chunk)


class Worker:
    """A worker in a process of its own, without a nanny; begun again when it has died, where that is asked for."""

    def __init__(self, address, options, again):
        words = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
        self._words, self._options, self._again = [*words, "--no-dashboard"], options, again
        self._process = self._begun()
        threading.Thread(target=self._look_after, daemon=True).start()

    def kill(self):
        """Kill it for good."""
        self._again = False
        self._process.kill()

    def _begun(self):
        return subprocess.Popen(self._words, stderr=subprocess.DEVNULL, **self._options)

    def _look_after(self):
        self._process.wait()
        while self._again:
            self._process = self._begun()
            self._process.wait()


@contextlib.contextmanager
def begun_cluster(path=(str(TESTS), *sys.path), again=False):
    """A scheduler and one worker, who find modules in a path: the address, and both."""
    options = {"env": {**os.environ, "PYTHONPATH": os.pathsep.join(path)}, "stdout": subprocess.DEVNULL}
    words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    with subprocess.Popen([*words, "--no-dashboard"], stderr=subprocess.PIPE, text=True, **options) as scheduler:
        address = next(found[0] for line in scheduler.stderr if (found := re.search(r"tcp://127\.0\.0\.1:\d+", line)))
        threading.Thread(target=scheduler.stderr.read, daemon=True).start()
        worker = Worker(address, options, again)
        try:
            yield address, scheduler, worker
        finally:
            worker.kill()
            scheduler.kill()
