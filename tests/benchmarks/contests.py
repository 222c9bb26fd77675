"""All contests, run after run, as reports/benchmarks/contests.json: ``python
tests/benchmarks/contests.py FOLDER``, where FOLDER is for intermediate files.
"""

import json
import os
import platform
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("..", "helpers")]

import pipeline.core.environment  # noqa: F401 - before numpy: it fixes the arithmetic

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
INTERPRETER = ROOT / ".venv-peers/bin/python"
RESULTS = ROOT / "reports/benchmarks"
RUNS = 3
# the features of the level alone; without this setting the host's are added
LEVELS = {
    "host": {},
    "x86-64-v3": {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "+avx2,+fma"},
    "x86-64-v4": {
        "NUMBA_CPU_NAME": "x86-64-v4",
        "NUMBA_CPU_FEATURES": "+avx2,+fma,+avx512f",
    },
}
# least time and number of calls of either side
SECONDS = 0.4
CALLS = 9
KEPT = ("group", "name", "param", "extra_info")
OURS = ("numpy", "scipy", "numba", "cvxpy", "clarabel")
PEERS = re.findall(r"^[\w-]+", (HERE / "peers.in").read_text(), re.MULTILINE)
ASK_VERSIONS = (
    "import json, sys; from importlib.metadata import version; "
    'print(json.dumps({f"peers\' {name}": version(name) for name in sys.argv[1:]}))'
)


def machine() -> str:
    """Processor, usable cores, memory and system."""
    processor = re.search(r"model name\s*: (.+)", Path("/proc/cpuinfo").read_text())[1]
    cores = len(os.sched_getaffinity(0))
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    return f"{processor}, {cores} cores, {memory:.0f} GiB, {platform.system()}"


def write_results(name: str, measured: dict) -> None:
    """Write reports/benchmarks/NAME.json."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    (RESULTS / f"{name}.json").write_text(json.dumps(measured, indent=1) + "\n")


def run_contests(file: Path, level: str) -> list[dict]:
    """Run all contests once, or those of the filter compiled for another ``level`` of processor
    than the host's; return what pytest-benchmark writes to ``file``.
    """
    tests = HERE if level == "host" else HERE / "test_particle_filter.py"
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:xdist",
        "--benchmark-enable",
    ]
    command += ["--benchmark-only", f"--benchmark-max-time={SECONDS}"]
    command += [
        f"--benchmark-min-rounds={CALLS}",
        f"--benchmark-json={file}",
        str(tests),
    ]
    subprocess.run(command, cwd=ROOT, check=True, env=os.environ | LEVELS[level])
    benchmarks = json.loads(file.read_text())["benchmarks"]
    for benchmark in benchmarks:
        benchmark["group"] += "" if level == "host" else f", compiled for {level}"
    return benchmarks


def main(folder: Path) -> None:
    """Keep of each benchmark what the page needs, with the least time in s of each run."""
    folder.mkdir(parents=True, exist_ok=True)
    benchmarks = []
    for level in ("host", "x86-64-v3"):
        runs = []
        for number in range(RUNS):
            runs.append(run_contests(folder / f"{level}_{number}.json", level))
        for repetitions in zip(*runs, strict=True):
            benchmark = {key: repetitions[-1][key] for key in KEPT}
            benchmark["least"] = [run["stats"]["min"] for run in repetitions]
            benchmarks.append(benchmark)
    info = {"machine": machine(), "versions": versions()}
    write_results("contests", {"machine_info": info, "benchmarks": benchmarks})


def versions() -> dict[str, str]:
    """Versions of Python, and of our libraries and the peers' by name."""
    ask = [INTERPRETER, "-c", ASK_VERSIONS, *PEERS]
    answer = subprocess.run(ask, check=True, stdout=subprocess.PIPE).stdout
    ours = {name: version(name) for name in OURS}
    return {"python": platform.python_version(), **ours, **json.loads(answer)}


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
