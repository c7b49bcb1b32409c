"""Loop transfer function of the autopilot, broken at one breakpoint."""

from jaxtyping import Array

from anser.analysis.loop_margins import ExcitedLoop


def break_loop(loop: ExcitedLoop, index: int) -> tuple[Array, Array, Array]:
    """Return A, B (column) and C (row) of the loop transfer function at breakpoint `index`, the other loops closed.

    Input is the command passed on; output is minus the computed command: negative feedback.
    """
    B, C = loop.B[:, index : index + 1], loop.C[index : index + 1]
    return loop.A - B @ C, B, -C
