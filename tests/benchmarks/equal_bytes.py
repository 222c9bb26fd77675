"""Comparison of the bytes of results on processors of other levels and on other numbers of
threads, as reports/benchmarks/equal_bytes.json: ``python tests/benchmarks/equal_bytes.py FOLDER``.

Each setting is a process of its own, each level a copy of the project in which everything is
compiled anew. The last is a control: an arithmetic that the project does not hold itself to, by
which some bytes have to differ.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from contests import machine

sys.path.append(str(Path(__file__).parents[1]))
from project_copy import ROOT, copy_project

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Setting:
    """Environment of a computation, and its number of threads or processes."""

    name: str
    level: str
    threads: int
    environment: dict[str, str]


# no features beside those of the level, which would be the host's
LEVELS = {
    "host": {},
    "x86-64-v3": {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "+avx2,+fma"},
    "x86-64-v4": {"NUMBA_CPU_NAME": "x86-64-v4", "NUMBA_CPU_FEATURES": "+avx2,+fma,+avx512f"},
}
NEEDED = {"x86-64-v4": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}}
THREADS = (1, 2)
SETTINGS = [
    Setting(f"{level}, {threads} thread{'s' * (threads > 1)}", level, threads, environment)
    for level, environment in LEVELS.items()
    for threads in THREADS
]
CONTROL = Setting("control", "host", 1, {"OPENBLAS_CORETYPE": "Sandybridge"})


def computed(setting: Setting, folder: Path) -> dict[str, str]:
    """The hash of each piece under ``setting``, in the copy of its level below ``folder``."""
    project = folder / setting.level
    if not project.exists():
        copy_project(project)
        for compiled in [*project.rglob("__pycache__")]:
            shutil.rmtree(compiled)
    answer = project / "result_bytes.json"
    paths = os.pathsep.join([str(project), str(HERE)])
    environment = {"PYTHONPATH": paths, "NUMBA_NUM_THREADS": str(setting.threads)}
    subprocess.run(
        [sys.executable, HERE / "result_bytes.py", answer, str(setting.threads)],
        cwd=project,
        env=os.environ | environment | setting.environment,
        check=True,
    )
    return json.loads(answer.read_text())


def main(folder: Path) -> None:
    """Compute under every setting that this machine has, and write."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    flags = {*re.search(r"flags\s*: (.+)", Path("/proc/cpuinfo").read_text())[1].split()}
    skipped = [one for one in SETTINGS if not NEEDED.get(one.level, set()) <= flags]
    run = [one for one in (*SETTINGS, CONTROL) if one not in skipped]
    answer = {
        "machine": machine(),
        "skipped": [one.name for one in skipped],
        "hashes": {one.name: computed(one, folder) for one in run},
    }
    file = ROOT / "reports/benchmarks/equal_bytes.json"
    file.write_text(json.dumps(answer, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
