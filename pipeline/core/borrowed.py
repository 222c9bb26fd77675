"""Arrays that compiled code borrows.

numba counts who holds an array: up by one for each view of it and down again, each time by an
instruction that no other thread may come between. A step of a block of particles makes many views.
Whoever called the compiled code from Python holds its arguments all the while, so that within it
nobody needs to count.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_null_value
from numba.core.typing.templates import Signature
from numba.extending import intrinsic


@intrinsic
def borrowed(typingctx: object, arrays: object) -> tuple:
    """The same ``arrays``, in tuples of any depth, as views that are not counted: of arguments from
    Python alone, and neither returned to it nor kept.
    """

    def code(context: object, builder: ir.IRBuilder, signature: Signature, given: list) -> object:
        return _uncounted(context, builder, arrays, given[0])

    return arrays(arrays), code


def _uncounted(context: object, builder: ir.IRBuilder, kind: object, value: object) -> object:
    """The ``value`` of the type ``kind`` with no holder: numba leaves alone a count that is not
    there.
    """
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value=value)
        array.meminfo = get_null_value(array.meminfo.type)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for index, part in enumerate(kind):
            one = _uncounted(context, builder, part, builder.extract_value(value, index))
            value = builder.insert_value(value, one, index)
    return value
