"""Compiled functions that are handed to compiled code again and again.

numba asks at each call which code a function that is handed over has: a quarter of a millisecond
for three of them, as long as a thousand particles take. A function of :func:`addressed` says it at
once.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import types


class Addressed(types.WrapperAddressProtocol):
    """A compiled function as one of ``kind``."""

    def __init__(self, function: Callable, kind: types.FunctionType) -> None:
        self._numba_type_ = kind
        # held, as the code goes when nobody holds it
        self._code = function.get_compile_result(kind.signature)
        name = self._code.fndesc.llvm_cfunc_wrapper_name
        self._address = self._code.library.get_pointer_to_function(name)

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> object:
        """What it takes and returns."""
        return self._numba_type_.signature


_KNOWN: dict[Callable, Addressed] = {}


def addressed(function: Callable, kind: types.FunctionType) -> Addressed:
    """The ``function``, always handed over as one of the same ``kind``."""
    if function not in _KNOWN:
        _KNOWN[function] = Addressed(function, kind)
    return _KNOWN[function]
