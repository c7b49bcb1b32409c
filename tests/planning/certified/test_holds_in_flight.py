"""Holds that are chosen again in flight."""

from types import SimpleNamespace

import numpy as np
import pytest

from anser.planning.certified.planner import _end_of_holds
from anser.planning.holds.hold_paths import choose_cell_count


@pytest.mark.parametrize("end", [180.0, 256.0, np.nextafter(256.0, 300.0), 256.5, 512.0, 7200.0])
def test_new_holds_have_as_many_cells_as_the_former_ones(end):
    """Holds end at the end of the flight to rounding, or a second after a later arrival."""
    cells = choose_cell_count(np.floor(end))
    former = SimpleNamespace(paths=SimpleNamespace(times=np.linspace([60.0, 61.0], end, cells + 1, axis=1)))
    assert choose_cell_count(_end_of_holds(former)) == cells
    assert end - 1.0 <= _end_of_holds(former) <= end
