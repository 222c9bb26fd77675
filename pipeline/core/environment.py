"""Environment variables on which the bytes of results depend.

The command ``python -m pipeline``, its workers and the tests assign them before NumPy is imported.
Loading an exported model leaves the environment of the calling program unchanged.
"""

import os

# one thread per process; no instruction set newer than AVX2, whose kernels round differently
BOUNDS = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENBLAS_CORETYPE": "Haswell",
    # X86_V4 does not include the newer two features
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    # its sine and exponential differ in the last bits from the C library's
    "NUMBA_DISABLE_INTEL_SVML": "1",
}


def assign() -> None:
    """Assign the variables, over the user's values; call it before the first import of NumPy."""
    os.environ.update(BOUNDS)
    # else numba spends time on colours of internal messages that are never shown
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")


assign()
