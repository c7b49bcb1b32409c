"""Ctrl-C while modules are imported."""

import signal
import subprocess
import sys
import time
import tomllib
from importlib.machinery import ExtensionFileLoader
from pathlib import Path

import pytest

from anser.cli.process import Interrupts

_ROOT = Path(__file__).parents[1]


def test_an_interrupt_during_the_import_of_an_extension_module_arrives_after_it():
    """An exception inside the initialization of jaxlib ended the process with a memory fault in 2 of 80 interrupts."""
    interrupts, initialized = Interrupts(), []

    def initialize(self):
        signal.raise_signal(signal.SIGINT)
        initialized.append(self)

    with interrupts.watched():
        initialize(ExtensionFileLoader("jaxlib._jax", "_jax.so"))
        assert interrupts.arrived
        assert initialized
        begin = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            time.sleep(10.0)
    assert time.monotonic() - begin < 5.0  # the main thread is woken from its wait


def test_another_interrupt_arrives_at_once():
    interrupts = Interrupts()
    with interrupts.watched(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert interrupts.arrived


_INTERRUPTED_IMPORT = """
import importlib.abc, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)

class Interrupting(importlib.abc.MetaPathFinder):
    def find_spec(self, fullname, path, target=None):
        if fullname == sys.argv[1]:
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
from {module} import main
main()
"""


@pytest.mark.parametrize("module", ["lazy_loader", "anser.cli.process", "anser.cli.commands"])
def test_an_interrupt_at_any_import_of_the_command_is_one_message(module):
    entry_point = tomllib.loads((_ROOT / "pyproject.toml").read_text())["project"]["scripts"]["anser"]
    entry_module, function = entry_point.split(":")
    assert function == "main"
    code = _INTERRUPTED_IMPORT.format(module=entry_module)
    ended = subprocess.run([sys.executable, "-c", code, module], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (130, "stopped\n")


def test_a_process_that_ignores_interrupts_goes_on():
    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\nimport anser_command\n"
    code += "signal.raise_signal(signal.SIGINT); print('went on')"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, "went on\n")
