"""numba's options for the whole project, and the folder of its machine code. Without numba, which
an exported model does not need, :mod:`pipeline.core.interpreted` takes its place.

With ``cache=True`` numba loads machine code while the file of the function is unchanged. But the
machine code also contains functions and constants of other files. So the name of the cache folder
has a hash of the modules with compiled functions and of the modules that they import.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

try:
    import numba
except ImportError:
    numba = None

from pipeline.core.sources import SOURCES, imported_sources, module_files, sources_hash

COMPILED = re.compile(r"^@(?:compiled|inner|inlined)\b", re.MULTILINE)
VARIABLE = "NUMBA_CACHE_DIR"
KEPT = 3  # number of cache folders of earlier sources that are not removed


def compiled_sources() -> list[Path]:
    """Return the files with compiled functions and the files that they import, which define every
    function and constant in machine code. An import within a function defines none.
    """
    modules = []
    for name, file in module_files().items():
        if COMPILED.search(file.read_text(encoding="utf-8")):
            modules.append(name)
    return imported_sources(modules)


def cache_folder() -> Path:
    """Return a writable folder for the machine code, and remove old ones except the newest KEPT.

    It is in ``NUMBA_CACHE_DIR`` if set, else beside Python's bytecode, in ~/.cache, or temporary.
    """
    name = f"pipeline-{sources_hash(compiled_sources())}"
    setting = os.environ.get(VARIABLE)
    # the process that started this one has set it
    if setting and Path(setting).name == name:
        return Path(setting)
    user = Path(os.path.expanduser("~"), ".cache", "pipeline")
    for base in [Path(setting)] if setting else [SOURCES / "__pycache__", user]:
        folder = base / name
        try:
            if not folder.is_dir():
                folder.mkdir(parents=True)
                _remove_old(base, folder)
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix=f"{name}-"))


def _remove_old(base: Path, folder: Path) -> None:
    """Remove the cache folders in ``base`` except ``folder`` and the newest KEPT others."""
    earlier = {*base.glob("pipeline-*")} - {folder}
    with suppress(OSError):  # another process may remove them meanwhile
        by_age = sorted(earlier, key=lambda place: place.stat().st_mtime)
        for old in by_age[:-KEPT]:
            shutil.rmtree(old, ignore_errors=True)


# numba reads the variable when it is imported, and again whenever it sees a changed environment
if numba is not None:
    os.environ[VARIABLE] = numba.config.CACHE_DIR = str(cache_folder())

# nogil: other threads can run; numpy: a division by zero gives the result of IEEE 754; no
# fastmath, which gives other bits on other processors
OPTIONS = {"nogil": True, "error_model": "numpy"}
# no entry points from Python and C, which take a third of the compile time
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, **OPTIONS}


def compiled(function: Callable) -> Callable:
    """Decorate a function that Python calls: ``njit`` with a cache."""
    return numba.njit(cache=True, **OPTIONS)(function)


def inner(function: Callable) -> Callable:
    """Decorate a function for calls by compiled functions; a call by Python ends the process."""
    return numba.njit(**INNER)(function)


def inlined(function: Callable) -> Callable:
    """Decorate an inner function that LLVM inlines, so that loops around it are vectorised."""
    return numba.njit(forceinline=True, **INNER)(function)


# indices of poses: compiled loops visit one after the other, interpreted ones all at once
lanes = range

if numba is None:
    from pipeline.core import interpreted

    compiled = interpreted.compiled
    inner = interpreted.inner
    inlined = interpreted.inlined
    lanes = interpreted.lanes
    choose = interpreted.choose
else:

    @inlined
    def choose(condition: bool, first: float, second: float) -> float:
        """Return ``first`` where the ``condition`` holds, else ``second``."""
        return first if condition else second
