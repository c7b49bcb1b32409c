"""Printed tables of the founding thesis compared with the aircraft model."""

import equinox as eqx
import pytest

from anser.verification import f16_data
from anser.verification.f16_data import THESIS_TABLES
from support.checks import assert_passes


def test_all_852_entries_agree():
    comparisons = assert_passes(THESIS_TABLES, 852)
    assert len({(c.group, c.point) for c in comparisons}) == 852


@pytest.mark.parametrize("variant", ["textbook", "s119"])
def test_the_other_variants_differ(monkeypatch, variant):
    """Elevator axis and aileron reference differ; s119 also has different table entries."""
    load = f16_data.load_f16
    monkeypatch.setattr(f16_data, "load_f16", lambda _, **options: load(variant, **options))
    short = {c.group.partition(",")[0] for c in THESIS_TABLES.measure() if c.fails}
    assert {"CX0", "Cm0", "Clda", "Cnda", "CXq"} <= short
    assert ("T_max" in short) == (variant == "s119")


@pytest.mark.parametrize("group", [0, 1, 2])
def test_a_table_that_is_off_by_a_thousandth_fails(monkeypatch, group):
    load = f16_data.load_f16

    def load_changed(name, **options):
        return eqx.tree_at(
            lambda airframe: airframe.tables.cells[group], load(name, **options), replace_fn=lambda x: x + 1e-3
        )

    monkeypatch.setattr(f16_data, "load_f16", load_changed)
    assert any(c.fails for c in THESIS_TABLES.measure())
