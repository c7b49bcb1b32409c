"""Strict tests: float64, no silent rank promotion, warnings are errors, stated shapes checked in the room `environment`."""

import atexit
import functools
import gc
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

# What one test module has compiled the others, the other worker and the commands that tests start need not: one cache
# for the run, which the first process makes and its children inherit.
if "ANSER_TEST_CACHE" not in os.environ:
    os.environ["ANSER_TEST_CACHE"] = tempfile.mkdtemp(prefix="anser-tests-")
    atexit.register(shutil.rmtree, os.environ["ANSER_TEST_CACHE"], ignore_errors=True)
os.environ.setdefault("ANSER_COMPILATION_CACHE", os.environ["ANSER_TEST_CACHE"])

# Compiling is most of what the tests take. XLA's older code generator compiles these programs in about half the time of
# its fusion emitters, LLVM's lowest optimisation takes another sixth off, and code in one piece a fifth, which otherwise
# is divided among threads; the results differ in rounding. Left alone where XLA_FLAGS are set. Newer versions no longer
# have that generator, and XLA ends a process that names a flag it does not know: so it is asked.
if "XLA_FLAGS" not in os.environ:
    lowest = "--xla_backend_optimization_level=0"
    quickest = f"{lowest} --xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
    asked = [sys.executable, "-c", "from jaxlib.xla_client import make_cpu_client; make_cpu_client()"]
    asking = {**os.environ, "XLA_FLAGS": quickest}
    known = subprocess.run(asked, env=asking, capture_output=True, check=False).returncode == 0
    os.environ["XLA_FLAGS"] = quickest if known else lowest

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # JAX reads it when it is imported
# NumPy's linear algebra otherwise occupies every core for each small product: twice the CPU time in tests of
# identification, beside a worker on the other core. Workers inherit it before they import NumPy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import pytest
import typer
from hypothesis import settings
from jaxtyping import install_import_hook

install_import_hook(["anser.environment"], "shape_checks.checked")  # before the first import of the room

from anser import cli  # noqa: E402
from anser.compiling import enable_compilation_cache  # noqa: E402
from anser.compiling.program import limit_memory_regions, release_all_programs  # noqa: E402
from support.shared_context import share_contexts  # noqa: E402

# A shell that starts the tests in the background lets them, and the commands that they start, ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
typer.main.get_command = functools.cache(typer.main.get_command)  # built once, as in a process of the command line
gc.set_threshold(200_000)  # as on the command line: tracing makes many small objects that live
enable_compilation_cache()
share_contexts()
# JAX keeps the programs that tests compile themselves, single operations included, for the other worker and for use
# after a release of the programs in memory.
jax.config.update("jax_compilation_cache_dir", os.environ["ANSER_TEST_CACHE"])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
jax.config.update("jax_numpy_rank_promotion", "raise")

# On a CI machine the same examples every time: what is found at random is found by people, and kept as an example. No
# deadline for an example: other work on the machine is no fault.
settings.register_profile("any machine", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "any machine")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, so that no worker waits for one at the end."""
    first = (
        "test_live_page.py",
        "test_flight_batches.py",
        "test_simulate.py",
        "test_cli.py",
        "test_identify.py",
        "test_user_parts_in_runs.py",
        "test_documented_commands.py",
    )
    items.sort(key=lambda item: first.index(item.path.name) if item.path.name in first else len(first))


def pytest_collection_finish() -> None:
    """Exclude the imported modules, which live to the end of the process, from garbage collection."""
    gc.freeze()


_RESIDENT_MAX_KIB = 3 << 20


@pytest.fixture(scope="module", autouse=True)
def programs_let_go():
    """Release what tests compile themselves before it fills the process: anser bounds its own programs only."""
    yield
    limit_memory_regions()
    status = Path("/proc/self/status")
    if status.exists() and int(status.read_text().split("VmRSS:")[1].split()[0]) > _RESIDENT_MAX_KIB:
        release_all_programs()


@pytest.fixture(name="anser")
def command_line(monkeypatch, capsys):
    """Run the command line in this process: exit code, standard output, standard error."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["anser", *map(str, words)])
        monkeypatch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call


@pytest.fixture
def undrawn_figures(monkeypatch):
    """Campaigns and rare events leave empty files in place of their figures, which the tests of the reports draw."""

    def save(drawings, dataset, style, folder, *, overwrite=False):
        paths = tuple(folder / f"{name}{suffix}" for name in drawings for suffix in (".svg", ".png"))
        for path in paths:
            path.touch()
        return paths

    monkeypatch.setattr("anser.report.campaign_figures.save_drawings", save)
