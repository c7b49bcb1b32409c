"""Messages for missing libraries of an extra."""

import sys

import pytest

from anser.analysis.linear_models import LinearizationResult
from anser.campaigns import StoreError
from anser.campaigns.cluster import _client
from anser.results.documents import install_hint


def test_the_extra_is_named():
    said = 'pyarrow is not installed: pip install "anser[parquet]" (in a clone: pip install -e ".[parquet]")'
    assert install_hint("pyarrow", "parquet") == said


def test_a_linear_model_without_python_control_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ImportError, match=r'python-control is not installed: pip install "anser\[control\]"'):
        LinearizationResult.state_space(object.__new__(LinearizationResult))


def test_a_cluster_without_dask_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(StoreError, match=r'dask is not installed: pip install "anser\[campaign\]"'),
        _client("tcp://x:1"),
    ):
        pass
