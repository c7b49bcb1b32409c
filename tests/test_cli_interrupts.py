"""Ctrl-C while modules are imported."""

import signal
import time
from importlib.machinery import ExtensionFileLoader

import pytest

from anser.cli.process import Interrupts


@pytest.fixture
def default_handler():
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, previous)


def test_an_interrupt_during_the_import_of_an_extension_module_arrives_after_it(default_handler):
    """An exception inside the initialization of jaxlib ended the process with a memory fault in 2 of 80 interrupts."""
    interrupts, initialized = Interrupts(), []

    def initialize(self):
        signal.raise_signal(signal.SIGINT)
        initialized.append(self)

    with interrupts.watched():
        initialize(ExtensionFileLoader("jaxlib._jax", "_jax.so"))
        assert interrupts.arrived
        assert initialized
        with pytest.raises(KeyboardInterrupt):
            time.sleep(10.0)


def test_another_interrupt_arrives_at_once(default_handler):
    interrupts = Interrupts()
    with interrupts.watched(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert interrupts.arrived
