"""On what and with what a benchmark was measured."""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
from importlib.metadata import version
from pathlib import Path

from peer_process import INTERPRETER

OURS = ("numpy", "scipy", "numba", "cvxpy", "clarabel")
PEERS = [
    re.match(r"[\w-]+", line)[0]
    for line in (Path(__file__).parent / "peers.in").read_text().splitlines()
]
ASK_VERSIONS = (
    "import json, sys; from importlib.metadata import version; "
    "print(json.dumps({name: version(name) for name in sys.argv[1:]}))"
)


def machine() -> str:
    """Processor, cores that may be used, memory and system."""
    processor = re.search(r"model name\s*: (.+)", Path("/proc/cpuinfo").read_text())[1]
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    return (
        f"{processor}, {len(os.sched_getaffinity(0))} cores, {memory:.0f} GiB of memory, "
        f"{platform.system()}"
    )


def versions() -> dict[str, str]:
    """Libraries here and, as ``peers' NAME``, in the peers' environment, with their versions."""
    requested = subprocess.run(
        [INTERPRETER, "-c", ASK_VERSIONS, *PEERS], check=True, capture_output=True, text=True
    )
    ours = {"python": platform.python_version()} | {name: version(name) for name in OURS}
    return ours | {
        f"peers' {name}": number for name, number in json.loads(requested.stdout).items()
    }
