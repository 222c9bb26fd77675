"""A function with its address is the function, and is looked up once."""

from __future__ import annotations

from numba import float64, njit, types

from pipeline.core.compiled import passed
from pipeline.core.passing import addressed

KIND = types.FunctionType(float64(float64))


@passed
def twice(x):
    return 2.0 * x


@njit(float64(KIND, float64))
def at(function, x):
    return function(x) + 1.0


def test_what_is_handed_over_by_its_address_is_called_and_known_from_then_on(monkeypatch):
    assert at(addressed(twice, KIND), 3.0) == at(twice, 3.0) == 7.0
    monkeypatch.setattr(type(twice), "get_compile_result", None)
    assert at(addressed(twice, KIND), 4.0) == 9.0
