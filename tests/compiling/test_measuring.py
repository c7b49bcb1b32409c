"""Records of compiled programs, and messages about the program that a process waits for."""

import re
import time

import jax
import jax.numpy as jnp
import pytest

from anser.compiling import measuring
from anser.compiling.measuring import Compilation, compilation_message, count_equations, measured, waiting
from anser.compiling.options import compiled, compiled_quickly


@pytest.fixture
def records(monkeypatch):
    monkeypatch.setattr(measuring, "compilations", [])
    monkeypatch.setattr(measuring, "_at_work", [])
    return measuring.compilations


def _work(seconds):
    end_s = time.process_time() + seconds
    while time.process_time() < end_s:
        pass


def test_equations_are_counted_with_those_of_called_programs():
    def double(x):
        return jax.lax.fori_loop(0, 3, lambda _, y: y * 2.0, x)

    alone = count_equations(jax.make_jaxpr(double)(1.0).jaxpr)
    inside = count_equations(jax.make_jaxpr(lambda x: jax.jit(double)(x) + jax.jit(double)(2.0 * x))(1.0).jaxpr)
    assert alone >= 3
    assert inside == 2 * alone + 4  # two calls, a sum, a product


def test_a_compiled_program_leaves_a_record(monkeypatch):
    import anser.compiling.program as program

    records = []
    monkeypatch.setattr(program, "compilations", records)
    monkeypatch.setattr(program, "_active_stores", [])

    def _times_three_compiled(x):
        return 3.0 * jnp.sin(x)

    fresh = compiled(_times_three_compiled)
    fresh(jnp.ones(3))
    fresh(jnp.ones(3))
    compiled_quickly(_times_three_compiled, "three times")(jnp.ones(4))
    assert [(r.title, r.equations, r.is_compiled) for r in records] == [
        ("times three", 2, True),
        ("three times", 2, True),
    ]
    assert all(r.cpu_s["compiling"] > 0.0 for r in records)
    with pytest.raises(TypeError):
        compiled(lambda x: x + "text")(jnp.ones(3))
    assert len(records) == 2


def test_stages_at_work_share_the_time_equally(records):
    first, second = Compilation("first", {}), Compilation("second", {})
    with measured(first, "compiling"):
        _work(0.2)
        with measured(second, "tracing"):
            _work(0.2)
    assert first.cpu_s["compiling"] == pytest.approx(0.3, abs=0.06)
    assert second.cpu_s["tracing"] == pytest.approx(0.1, abs=0.06)


def test_the_message_names_the_program_and_the_time_left(records):
    record = Compilation("replanning", {})
    records.append(record)
    assert compilation_message() is None
    with waiting(), measured(record, "tracing"):
        assert compilation_message() == "compiling program 1 (replanning)"
    record.equations = 100_000
    with measured(record, "compiling"):
        assert compilation_message() is None  # nobody waits
        with waiting():
            assert re.fullmatch(r"compiling program 1 \(replanning\), about \d+ s left", compilation_message())
    assert compilation_message() is None


def test_a_program_that_is_loaded_meanwhile_is_not_awaited(records):
    with waiting(), measured(Compilation("replanning", {}), "tracing"):
        assert compilation_message() is None


def test_the_estimate_follows_the_programs_compiled_before(records):
    done = Compilation("done", {}, equations=50_000, is_compiled=True)
    done.cpu_s["compiling"] = 500.0
    prior_s = Compilation("other", {"option": True}, equations=10_000).estimate_s
    records.append(done)
    assert Compilation("next", {}, equations=10_000).estimate_s == pytest.approx(85.0, rel=0.05)
    assert Compilation("other", {"option": True}, equations=10_000).estimate_s == prior_s
