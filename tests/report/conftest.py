"""The flight that reports are made of."""

import pytest

from support.made_flight import make_flight


@pytest.fixture(scope="session")
def flight():
    return make_flight()
