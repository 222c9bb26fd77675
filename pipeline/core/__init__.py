"""What every room stands on. To import it settles the arithmetic of the process."""

import os

# The same bits on every processor: one thread a process and no instruction set newer than AVX2
# (fused kernels round differently). Set here because numpy reads them when it is imported, and
# workers inherit them.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
# the newer two are features of their own and would stay on without X86_V4
os.environ.setdefault("NPY_DISABLE_CPU_FEATURES", "X86_V4 AVX512_ICL AVX512_SPR")
# a sine and an exponential of its own, which differ in the last bits from the C library's
os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")
# the messages of types that it tries in vain would be coloured before they are thrown away: some
# hundredths of the time to compile
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
