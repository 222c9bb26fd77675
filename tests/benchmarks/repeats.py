"""All contests, run after run, as reports/benchmarks/contests.json: ``python
tests/benchmarks/repeats.py FOLDER``, where FOLDER is for what lies between.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from machine import machine, versions

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RUNS = 3
# either side of a contest is called for so many seconds, and at least so many times
SECONDS, CALLS = 0.4, 9
MEASURED = (f"--benchmark-max-time={SECONDS}", f"--benchmark-min-rounds={CALLS}")
KEPT = ("group", "name", "param", "extra_info")


def run(file: Path) -> list[dict]:
    """All contests once, as pytest-benchmark writes them to ``file``."""
    options = ("-q", "-p", "no:xdist", "--benchmark-enable", "--benchmark-only", *MEASURED)
    columns = ("--benchmark-group-by=group", "--benchmark-columns=min,median,rounds")
    command = (sys.executable, "-m", "pytest", *options, *columns, f"--benchmark-json={file}")
    subprocess.run([*command, HERE], cwd=ROOT, check=True)
    return json.loads(file.read_text())["benchmarks"]


def together(runs: list[list[dict]]) -> list[dict]:
    """Of each benchmark what the report needs: no dates, no names of machines, no single rounds,
    but the least time of each of the ``runs``, in s.

    Raises ValueError where one run has another benchmark than the first.
    """
    result = []
    for same in zip(*runs, strict=True):
        if len({one["fullname"] for one in same}) > 1:
            raise ValueError(f"runs differ: {[one['fullname'] for one in same]}")
        kept = {key: same[-1][key] for key in KEPT}
        result.append(kept | {"least": [one["stats"]["min"] for one in same]})
    return result


def main(folder: Path) -> None:
    """Run and write."""
    folder.mkdir(parents=True, exist_ok=True)
    benchmarks = together([run(folder / f"contests_{number}.json") for number in range(RUNS)])
    info = {"machine": machine(), "versions": versions()}
    written = json.dumps({"machine_info": info, "benchmarks": benchmarks}, indent=1)
    file = ROOT / "reports/benchmarks/contests.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(written + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
