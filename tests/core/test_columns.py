"""Families of columns: what is spread over the joints' names is read back as it was."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core import columns

NAMES = ("base", "elbow", "tip")


def test_columns_bear_the_names_in_their_order():
    assert columns.columns("q", NAMES) == ["q:base", "q:elbow", "q:tip"]
    assert columns.pairs("c", NAMES[:2]) == ["c:base:base", "c:base:elbow", "c:elbow:elbow"]


def test_values_are_spread_over_their_columns_and_read_back():
    array = np.arange(24.0).reshape(2, 4, 3)
    table = pd.DataFrame(columns.spread("q", NAMES, array))
    assert table["q:elbow"].tolist() == array[..., 1].ravel().tolist()
    np.testing.assert_array_equal(columns.values(table, "q"), array.reshape(-1, 3))


def test_symmetric_matrices_are_spread_over_their_upper_triangle_and_read_back():
    half = np.random.default_rng(3).random((5, 3, 3))
    full = half + half.swapaxes(1, 2)
    table = pd.DataFrame(columns.triangle("c", NAMES, full))
    assert list(table) == columns.pairs("c", NAMES)
    np.testing.assert_array_equal(columns.matrices(table, "c", NAMES), full)
    # the control: in another order of the joints they are other matrices, or none
    with pytest.raises(KeyError):
        columns.matrices(table, "c", NAMES[::-1])


def test_the_members_of_a_family_are_those_of_its_own_columns_alone():
    table = pd.DataFrame(columns=["k", "q:tip", "q:base", "c:tip:tip", "qq:tip", 7])
    assert columns.members(table, "q") == ("tip", "base")
    assert columns.members(table, "c") == ()


def test_values_of_another_number_of_joints_are_refused():
    with pytest.raises(ValueError, match="shape"):
        columns.spread("q", NAMES, np.zeros((2, 2)))
