"""Trims, linear models, step tests, margins and surveys of airframes with surfaces of their own."""

import pytest

pytestmark = pytest.mark.long

SPEED, ALTITUDE = 55.0, 400.0
