"""Errors carry their evidence, in the message and across processes."""

from __future__ import annotations

import pickle

import pytest

from pipeline.core import errors
from pipeline.core.errors import PipelineError

KINDS = [
    kind
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, PipelineError)
]


@pytest.mark.parametrize("kind", KINDS)
def test_the_message_ends_with_the_evidence(kind):
    error = kind("the column is torn", file="a.csv", line=7, take=None)
    assert str(error) == "the column is torn [file a.csv, line 7]"
    assert error.evidence == {"file": "a.csv", "line": 7}
    assert str(kind("no evidence")) == "no evidence"


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_survives_the_way_back_from_a_worker(kind):
    error = pickle.loads(pickle.dumps(kind("the column is torn", file="a.csv", line=7)))
    assert type(error) is kind
    assert str(error) == "the column is torn [file a.csv, line 7]"
    assert (error.message, error.evidence) == ("the column is torn", {"file": "a.csv", "line": 7})
