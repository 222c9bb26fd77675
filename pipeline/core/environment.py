"""Environment variables on which the bytes of results depend.

The command ``python -m pipeline``, its workers and the tests assign them before numpy is imported;
an exported model, which a colleague loads in a program of their own, does not.
"""

import os

# one thread a process and no instruction set newer than AVX2, whose fused kernels round differently
BOUNDS = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENBLAS_CORETYPE": "Haswell",
    # the newer two are features of their own and would stay on without X86_V4
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    # a sine and an exponential of its own, which differ in the last bits from the C library's
    "NUMBA_DISABLE_INTEL_SVML": "1",
}


def assign() -> None:
    """Assign the variables, whatever the user has set; before the first import of numpy."""
    os.environ.update(BOUNDS)
    # messages of types that numba tries in vain: to colour them takes time and nobody sees them
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")


assign()
