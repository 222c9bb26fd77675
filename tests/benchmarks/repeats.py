"""All contests, run after run, as reports/benchmarks/contests.json: ``python
tests/benchmarks/repeats.py FOLDER``, where FOLDER is for intermediate files.
"""

from __future__ import annotations

import json
import platform
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from contests import machine
from peer_process import INTERPRETER

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RUNS = 3
# either side of a contest is called for so many seconds, and at least so many times
SECONDS, CALLS = 0.4, 9
MEASURED = (f"--benchmark-max-time={SECONDS}", f"--benchmark-min-rounds={CALLS}")
KEPT = ("group", "name", "param", "extra_info")
OURS = ("numpy", "scipy", "numba", "cvxpy", "clarabel")
PEERS = re.findall(r"^[\w-]+", (HERE / "peers.in").read_text(), re.MULTILINE)
ASK_VERSIONS = (
    "import json, sys; from importlib.metadata import version; "
    "print(json.dumps({name: version(name) for name in sys.argv[1:]}))"
)


def versions() -> dict[str, str]:
    """Libraries here and, as ``peers' NAME``, in the peers' environment, with their versions."""
    command = [INTERPRETER, "-c", ASK_VERSIONS, *PEERS]
    answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    ours = {"python": platform.python_version()} | {name: version(name) for name in OURS}
    return ours | {f"peers' {name}": number for name, number in json.loads(answer).items()}


def run(file: Path) -> list[dict]:
    """All contests once, as pytest-benchmark writes them to ``file``."""
    options = ("-q", "-p", "no:xdist", "--benchmark-enable", "--benchmark-only", *MEASURED)
    columns = ("--benchmark-group-by=group", "--benchmark-columns=min,median,rounds")
    command = (sys.executable, "-m", "pytest", *options, *columns, f"--benchmark-json={file}")
    subprocess.run([*command, HERE], cwd=ROOT, check=True)
    return json.loads(file.read_text())["benchmarks"]


def together(runs: list[list[dict]]) -> list[dict]:
    """Part of each benchmark that the report needs, without dates and names of machines, and the
    least time in s of each of the ``runs``; raises ValueError where runs have other benchmarks.
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
    file = ROOT / "reports/benchmarks/contests.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({"machine_info": info, "benchmarks": benchmarks}, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
