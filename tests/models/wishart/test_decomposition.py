"""What names a decomposition, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arm.chain import TASK
from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.models.wishart.decomposition import Decomposition, chosen
from pipeline.models.wishart.options import Options

JOINTS = ("shoulder", "elbow", "wrist")


def options(decomposition: str, **values: object) -> Options:
    return Options(
        "wishart", "label", estimator="likelihood", decomposition=decomposition, **values
    )


def test_an_option_names_a_decomposition_and_the_orders_of_lu():
    assert chosen(options("qr"), TASK, JOINTS) == Decomposition("qr")
    left = np.diag([0.15, 0.15, 1.0])
    given = options("given", left=left.tolist())
    assert chosen(given, TASK, JOINTS) == Decomposition("given", left=left)
    ordered = options("lu", rows=["phi", "x", "z"], order=["wrist", "shoulder", "elbow"])
    assert chosen(ordered, TASK, JOINTS) == Decomposition("lu", rows=(2, 0, 1), order=(2, 0, 1))


@pytest.mark.parametrize(
    ("key", "names"),
    [("rows", ["x", "z"]), ("rows", ["x", "z", "y"]), ("order", ["elbow", "elbow", "wrist"])],
)
def test_an_order_of_other_names_than_there_are_is_refused(key, names):
    with pytest.raises(ConfigError, match=f"{key} must name each of"):
        chosen(options("lu", **{key: names}), TASK, JOINTS)


@pytest.mark.parametrize("name", ["pivoted_lu", "qr", "qr_transposed", "given"])
def test_lu_alone_takes_orders(name):
    left = np.eye(3).tolist() if name == "given" else None
    with pytest.raises(ConfigError, match="no other, takes rows"):
        options(name, left=left, rows=["x", "z", "phi"])
    with pytest.raises(ModelDomainError, match="order of a decomposition"):
        Decomposition(name, left=left, order=[0, 1, 2])


@pytest.mark.parametrize(
    ("name", "left"),
    [
        ("svd", None),
        ("given", None),
        ("qr", np.eye(3)),
        ("given", [[1.0, 2.0], [3.0]]),
        ("given", np.zeros((3, 3))),
        ("given", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]),
        ("given", np.full((3, 3), np.nan)),
        ("given", "rows"),
    ],
)
def test_what_is_no_decomposition_is_refused(name, left):
    with pytest.raises(ModelDomainError):
        Decomposition(name, left=left)


@pytest.mark.parametrize("numbers", [[0, 0, 1], [1, 2, 3], [0.5, 1, 2]])
def test_an_order_is_of_numbers_from_zero_each_once(numbers):
    with pytest.raises(ModelDomainError, match="rows of a decomposition"):
        Decomposition("lu", rows=numbers)


def test_a_decomposition_of_another_size_than_the_jacobian_is_refused():
    Decomposition("lu", rows=[1, 0], order=[2, 0, 1]).require_size(2, 3)
    with pytest.raises(ModelDomainError, match="order of the decomposition has another size"):
        Decomposition("lu", rows=[1, 0], order=[1, 0]).require_size(2, 3)
