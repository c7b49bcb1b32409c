"""The integrator's checks pass, and detect a method of lower order."""

import equinox as eqx
import jax
import pytest

from anser.verification import integrator
from anser.verification.integrator import INTEGRATION_CHECKS
from support.checks import assert_passes


@pytest.mark.parametrize(
    ("check", "count"), list(zip(INTEGRATION_CHECKS, (6, 4), strict=True)), ids=lambda x: getattr(x, "key", "")
)
def test_a_check_passes(check, count):
    assert_passes(check, count)


def test_a_method_of_second_order_is_detected(monkeypatch):
    """With the midpoint rule as integrator, the observed order is two."""
    from anser.aircraft import motion_derivative

    def midpoint(airframe, environment, time, state, controls, step):
        def rate(y):
            return motion_derivative(airframe, environment, time, y, controls)

        half_step = jax.tree.map(lambda y, k: y + 0.5 * step * k, state, rate(state))
        return jax.tree.map(lambda y, k: y + step * k, state, rate(half_step))

    to_file_value = integrator._fly.__wrapped__
    monkeypatch.setattr(integrator, "advance", midpoint)
    monkeypatch.setattr(integrator, "_fly", eqx.filter_jit(lambda *arguments: to_file_value(*arguments)))
    comparisons = integrator.order()
    assert all(c.obtained == pytest.approx(2.0, abs=0.2) for c in comparisons)
    assert not any(c.passes for c in comparisons)
