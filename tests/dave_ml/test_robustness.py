"""Mutated and exhausting files: one kind of error, bounded time and memory."""

import resource
import time

import jax
import jax.numpy as jnp
import pytest
from files import ALL
from mutations import mutated

from anser.dave_ml import DaveMlError, read_dave_ml, write_dave_ml
from anser.dave_ml.elements import FILE_BYTES_MAX

SECONDS_MAX = 5.0
"""Processor time for the slowest file, s; the worst known file takes about 2 s on an idle machine of 2026."""
MEGABYTES_MAX = 1500
"""Permitted memory growth of the process: twenty times that of the worst file, since the files are generated here too."""


def resident_max():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def survive(seeds):
    """Read mutated files and return the number of readable files."""
    read = 0
    memory_before = resident_max()
    for seed in seeds:
        mutations, text = mutated(seed, list(ALL.values()))
        start = time.thread_time()
        try:
            model = read_dave_ml(text, f"mutant {seed}")
        except DaveMlError as error:
            message = str(error)
            assert message.startswith(f"mutant {seed}"), mutations
            assert "\n" not in message, mutations
            assert len(message) < 1500, mutations
        else:
            read += 1
            if read % 10 == 1:
                usable(model)
        assert time.thread_time() - start < SECONDS_MAX, (seed, mutations)
    assert resident_max() - memory_before < MEGABYTES_MAX
    return read


def usable(model):
    """Trace and write a model."""
    variables = tuple(model.definition.variables)
    jax.eval_shape(lambda inputs: model.evaluate(inputs, variables), {name: jnp.zeros(()) for name in model.inputs})
    reread = read_dave_ml(write_dave_ml(model), "again")
    assert reread.definition.variables == model.definition.variables


@pytest.mark.long
def test_100_mutated_files():
    assert 10 < survive(range(100)) < 50


@pytest.mark.long
def test_300_mutated_files():
    assert 30 < survive(range(300)) < 150


@pytest.mark.long
def test_10_000_mutated_files():
    assert 1000 < survive(range(300, 10_300)) < 5000


HEAD = '<DAVEfunc><fileHeader/><variableDef name="a" varID="a" units="nd"/>'
LINE = "<breakpointDef bpID='b'><bpVals>" + " ".join(map(str, range(1000))) + "</bpVals></breakpointDef>"
SQUARE = (
    LINE + '<griddedTableDef gtID="g"><breakpointRefs><bpRef bpID="b"/><bpRef bpID="b"/></breakpointRefs><dataTable>'
    + "1 " * 1_000_000 + "</dataTable></griddedTableDef>"
)  # fmt: skip


def function(k, table, arguments):
    argument_elements = '<independentVarRef varID="a"/>' * arguments
    return (
        f'<variableDef name="r" varID="r{k}" units=""/><function name="f">{argument_elements}<dependentVarRef varID="r{k}"/>'
        f"<functionDefn>{table}</functionDefn></function>"
    )


def on_the_moment_curve(count, dimensions):
    """Points with the greatest possible number of simplices."""
    curve = [[(k / count) ** power for power in range(1, dimensions + 1)] for k in range(count)]
    points = "".join(f"<dataPoint>{' '.join(map(repr, point))} 1</dataPoint>" for point in curve)
    table = f'<ungriddedTableDef utID="g">{points}</ungriddedTableDef>'
    return HEAD + table + function(0, '<ungriddedTableRef utID="g"/>', dimensions) + "</DAVEfunc>"


def calculations(count, last_content):
    definitions = "".join(
        f'<variableDef name="v" varID="v{k}" units=""><calculation><math><ci>v{k + 1}</ci></math></calculation>'
        "</variableDef>"
        for k in range(count)
    )
    return f'{HEAD}{definitions}<variableDef name="v" varID="v{count}" units="">{last_content}</variableDef></DAVEfunc>'


HEAVY = {
    "too large": (lambda: b" " * (FILE_BYTES_MAX + 1), "8,388,609 bytes"),
    "elements": (lambda: HEAD + "<a/>" * 200_000, "more than 100,000 elements"),
    "attributes": (lambda: HEAD + "<a " + " ".join(f'a{k}=""' for k in range(600_000)) + "/></DAVEfunc>", "<a> in <DAVEfunc>"),
    "numbers": (lambda: f"{HEAD}<breakpointDef bpID='b'><bpVals>{'1 ' * 2_000_000}</bpVals></breakpointDef></DAVEfunc>", "1,000,000 numbers"),
    "one table in a thousand functions": (
        lambda: HEAD + SQUARE + "".join(function(k, '<griddedTableRef gtID="g"/>', 2) for k in range(1000)) + "</DAVEfunc>",
        "more than 4,000,000 numbers at the corners",
    ),
    "a chain of calculations": (lambda: calculations(16_000, ""), ""),
    "a cycle of calculations": (
        lambda: calculations(16_000, "<calculation><math><ci>v0</ci></math></calculation>"),
        "needs v1 needs v2",
    ),
    "scattered points": (lambda: on_the_moment_curve(200, 3), ""),
    "more scattered points": (lambda: on_the_moment_curve(201, 3), "201 scattered points of 3 coordinates"),
}  # fmt: skip


@pytest.mark.parametrize("case", HEAVY)
def test_time_and_memory_are_bounded_for_exhausting_files(case):
    make, says = HEAVY[case]
    content = make()
    memory_before, start = resident_max(), time.thread_time()
    if says:
        with pytest.raises(DaveMlError) as caught:
            read_dave_ml(content, "heavy")
        assert says in str(caught.value)
    else:
        read_dave_ml(content, "heavy")
    assert time.thread_time() - start < SECONDS_MAX
    assert resident_max() - memory_before < 400
