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
    return 1


def slow(folder, chunk):
    """As `marked`, but all chunks after the first take an hour."""
    if chunk > 0:
        time.sleep(3600.0)
    return marked(folder, chunk)


def deadly(folder, chunk):
    """As `marked`, but chunk 1 kills its worker."""
    if chunk == 1:
        with (folder / "deaths").open("a") as deaths:
            deaths.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    return marked(folder, chunk)


@contextlib.contextmanager
def begun_cluster():
    """A scheduler and one worker without a nanny: the address, and both processes."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path])}
    quiet = {"env": environment, "stdout": subprocess.DEVNULL}
    words = [
        sys.executable,
        "-m",
        "distributed.cli.dask_scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--no-dashboard",
    ]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True, **quiet) as scheduler:
        address = next(found[0] for line in scheduler.stderr if (found := re.search(r"tcp://127\.0\.0\.1:\d+", line)))
        threading.Thread(target=scheduler.stderr.read, daemon=True).start()
        words = [
            sys.executable,
            "-m",
            "distributed.cli.dask_worker",
            address,
            "--nthreads",
            "1",
            "--no-nanny",
            "--no-dashboard",
        ]
        with subprocess.Popen(words, stderr=subprocess.DEVNULL, **quiet) as worker:
            try:
                yield address, scheduler, worker
            finally:
                for process in (worker, scheduler):
                    process.kill()
