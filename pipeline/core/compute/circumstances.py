"""What the bytes of results hang on beside the trials: code, libraries, processor; compared before
a worker of a cluster is given any.
"""

from __future__ import annotations

import hashlib
import os
import platform
from functools import cache
from importlib.metadata import distributions
from pathlib import Path

import numpy as np

import pipeline


@cache
def circumstances() -> dict[str, str]:
    """Name and state of everything by which this process could give other bytes than another.

    Once per process, so that a worker that has imported modules keeps saying which: an edit of the
    code since then shows.
    """
    return {
        "the code of pipeline": _code(Path(pipeline.__file__).parent),
        "python": platform.python_version(),
        **{
            name: os.environ.get(name, "unset")
            for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENBLAS_CORETYPE")
        },
        **{distribution.name.lower(): distribution.version for distribution in distributions()},
        "the arithmetic that numpy was imported with": _arithmetic(),
        "the project's folder (the time of its dvc.yaml)": _folder(),
    }


def difference(here: dict[str, str], there: dict[str, str]) -> str | None:
    """The first of the circumstances that is another there, in words; what is not installed on both
    sides is left to its import.
    """
    for name, state in here.items():
        if there.get(name, state) != state:
            return f"{name} is {there[name]} there and {state} here"
    return None


def _code(folder: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        digest.update(f"{file.relative_to(folder)}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:12]


def _folder() -> str:
    """When the dvc.yaml in the working folder was written, to the nanosecond: another in a copy of
    the project, one on a shared disk.
    """
    file = Path("dvc.yaml")
    return str(file.stat().st_mtime_ns) if file.exists() else "none"


def _arithmetic() -> str:
    """A digest of sums and functions whose last bits follow the instruction set and the threads
    that numpy and scipy run on.
    """
    from scipy import linalg

    x = np.linspace(0.1, 3.0, 40_000).reshape(200, 200)
    positive = x @ x.T + 200 * np.eye(200)
    values = [
        *[function(x) for function in (np.exp, np.log, np.sin, np.tan, np.arctan, np.sqrt)],
        *[x**1.7, x.sum(axis=0), x.ravel() @ x.ravel(), x @ x[0], positive],
        *[
            np.linalg.inv(positive),
            np.linalg.cholesky(positive),
            np.linalg.svd(x)[0],
            linalg.solve(positive, x),
        ],
    ]
    return hashlib.sha256(
        b"".join(np.ascontiguousarray(value).tobytes() for value in values)
    ).hexdigest()[:12]
