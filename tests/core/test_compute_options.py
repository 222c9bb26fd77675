"""The options that say where trials run."""

from __future__ import annotations

import math
from functools import partial

import pytest

from pipeline.core.errors import ConfigError
from pipeline.core.options.compute import Compute, Dask


@pytest.mark.parametrize("workers", [0, 1, 8])
def test_a_number_of_workers_is_taken(workers):
    assert Compute(workers).workers == workers


@pytest.mark.parametrize(
    ("wrong", "key"),
    [
        (partial(Compute, -1), "compute.workers"),
        (partial(Dask, timeout=0.0), "compute.dask.timeout"),
        (partial(Dask, timeout=math.nan), "compute.dask.timeout"),
    ],
)
def test_what_no_cluster_can_have_is_refused(wrong, key):
    with pytest.raises(ConfigError) as refused:
        wrong()
    assert refused.value.evidence["key"] == key
