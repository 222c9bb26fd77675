"""Environment variables on which the bytes of results and the time of a process depend.

The command ``python -m pipeline``, its workers and the tests assign them before NumPy is imported.
Loading an exported model leaves the environment of the calling program unchanged.
"""

import os
import platform
import sys
from pathlib import Path

# one thread per process
BOUNDS = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    # its sine and exponential differ in the last bits from the C library's
    "NUMBA_DISABLE_INTEL_SVML": "1",
}
# environment variable: "any" leaves the instruction set open
PROCESSOR = "PIPELINE_PROCESSOR"
FLAGS = Path("/proc/cpuinfo")
NOT_EQUAL = (
    f"this processor has no AVX2 and FMA, or {PROCESSOR} is set: numbers may differ in the last "
    "digits from the committed results (`python -m pipeline audit` compares within 1e-5)"
)


def has_equal_bytes() -> bool:
    """Return True on an x86-64 processor with AVX2 and FMA, on which all bytes are equal."""
    if os.environ.get(PROCESSOR) == "any" or platform.machine() not in (
        "x86_64",
        "AMD64",
    ):
        return False
    lines = FLAGS.read_text().splitlines() if FLAGS.is_file() else []
    flags = next((line.split() for line in lines if line.startswith("flags")), [])
    return {"avx2", "fma"} <= {*flags}


if has_equal_bytes():
    # no instruction set newer than AVX2, whose kernels round differently; X86_V4 does not include
    # the newer two features
    BOUNDS |= {
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    }
os.environ.update(BOUNDS)  # over the user's values
# else numba spends time on colours of internal messages that are never shown
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
# as in the Makefile: without cached bytecode every process compiles its modules anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
