"""numba's options for the whole project, and the folder of its machine code.

numba loads what it compiled with ``cache=True`` while the file of the function itself is unchanged.
But the machine code also holds functions and constants from other files. So the cache folder is
named after a hash of all sources of the pipeline.
"""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numba

SOURCES = Path(__file__).parents[1]
VARIABLE = "NUMBA_CACHE_DIR"
KEPT = 3  # folders of earlier sources beside the current one


def sources_hash(folder: Path = SOURCES) -> str:
    """Hash of the paths and contents of all Python files in ``folder``."""
    digest, files = hashlib.sha256(), []
    # os.walk passes over caches that another process removes meanwhile
    for place, _, names in os.walk(folder):
        files += [Path(place, name) for name in names if name.endswith(".py")]
    for file in sorted(files):
        digest.update(f"{file.relative_to(folder)}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Writable folder of the machine code of these sources: in ``NUMBA_CACHE_DIR`` where the user
    has set it, beside Python's own compiled code, in the user's cache, or one of this process
    alone. Folders of earlier sources are removed but for the newest few.
    """
    name = f"pipeline-{sources_hash()}"
    given = os.environ.get(VARIABLE)
    if given and Path(given).name == name:  # set by the process that started this one
        return Path(given)
    user = Path(os.path.expanduser("~"), ".cache", "pipeline")
    for base in [Path(given)] if given else [SOURCES / "__pycache__", user]:
        folder = base / name
        try:
            if not folder.is_dir():
                folder.mkdir(parents=True)
                earlier = {*base.glob("pipeline-*")} - {folder}
                with suppress(OSError):  # another process may remove them meanwhile
                    for old in sorted(earlier, key=lambda one: one.stat().st_mtime)[:-KEPT]:
                        shutil.rmtree(old, ignore_errors=True)
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix=f"{name}-"))


# numba reads the variable when it is imported, and again whenever it sees a changed environment
os.environ[VARIABLE] = numba.config.CACHE_DIR = str(cache_folder())

# other threads run meanwhile, and a division by zero gives the result of IEEE 754; no fastmath,
# with which the bits would differ between processors
OPTIONS = {"nogil": True, "error_model": "numpy"}
# without the entries from Python and C, which take a third of the time to compile
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, **OPTIONS}


def compiled(function: Callable) -> Callable:
    """Decorator: ``njit`` for a function that Python calls, with a cache."""
    return numba.njit(cache=True, **OPTIONS)(function)


def inner(function: Callable) -> Callable:
    """Decorator: ``njit`` for a function that compiled functions alone call. A call from Python
    ends the process: tests call it within a compiled function (``tests/compiled_calls.py``).
    """
    return numba.njit(**INNER)(function)


def inlined(function: Callable) -> Callable:
    """Decorator: an inner function inlined by LLVM, so that loops around it are vectorised."""
    return numba.njit(forceinline=True, **INNER)(function)
