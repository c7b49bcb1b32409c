"""What is said where a library of an extra is not installed."""

import sys

import pytest

from anser.campaigns.cluster import _client
from anser.campaigns.store import StoreError
from anser.execution.linearizing import Linearized
from anser.results.extras import missing


def test_the_extra_is_named():
    said = 'pyarrow is not installed: pip install "anser[parquet]" (in a clone: pip install -e ".[parquet]")'
    assert missing("pyarrow", "parquet") == said


def test_a_linear_model_without_python_control_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ImportError, match=r'python-control is not installed: pip install "anser\[control\]"'):
        Linearized.state_space(object.__new__(Linearized))


def test_a_cluster_without_dask_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(StoreError, match=r'dask is not installed: pip install "anser\[campaign\]"'),
        _client("tcp://x:1"),
    ):
        pass
