"""First use and speed of the kernel: ``python tests/benchmarks/start.py FOLDER`` writes
reports/benchmarks/start.json, FOLDER being for the machine code in between.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from contests import machine

ROOT = Path(__file__).parents[2]
ROUNDS = 3
# another elementary function for the kernel: the C library's, which no loop around it vectorises
C_LIBRARY = """
import math
import pipeline.core.elementary as own
own.sine_cosine = own.inlined(lambda angle: (math.sin(angle), math.cos(angle)))
own.exponential = own.inlined(lambda x: math.exp(x))
own.expm1 = own.inlined(lambda x: math.expm1(x))
"""
COMMON = f"""
import json, sys, time
sys.path[:0] = [{str(ROOT)!r}, {str(ROOT / "tests")!r}, {str(Path(__file__).parent)!r}]
begin = time.process_time()
import pipeline.core.environment
VARIANT
import pipeline.models.draws, pipeline.filtering.particle_filter
import pipeline.models.wishart.perturbation, pipeline.models.wishart.quadrature
imported = time.process_time() - begin
import numpy as np
from scenario import scene, take
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
"""
# processor time in s
FIRST = """
begin = time.process_time()
for arm in ("youbot", "ur5", "lwr4"):
    take(4, arm).filtered(100, np.random.default_rng(1))
print(json.dumps({"imports": imported, "first use": time.process_time() - begin}))
"""
# ns a particle and step, the least of 12 calls
SPEED = """
LAWS = {
    "pivoted LU": WishartModel(0.25, Decomposition("pivoted_lu")),
    "QR of J": WishartModel(0.25, Decomposition("qr")),
    "QR of the transpose": WishartModel(0.25, Decomposition("qr_transposed")),
    "Gaussian": GaussianModel(0.1, 1e3),
}
result = {}

def measure(name, steps, *arguments):
    least = np.inf
    for _ in range(12):
        begin = time.perf_counter()
        steps(*arguments, rng)
        least = min(least, time.perf_counter() - begin)
    result[name] = round(1e9 * least / 20_000, 1)

for arm in ("youbot", "ur5", "lwr4"):
    stage, rng = scene(arm), np.random.default_rng(1)
    n, chain = len(stage.start.mean), stage.chain
    q = stage.start.mean + 0.05 * rng.standard_normal((20_000, n))
    v = chain.jacobian(stage.start.mean) @ np.full(n, 1e-3)
    for law, model in (LAWS | {"additive": ScaledModel(1e-6 * np.eye(n))}).items():
        measure(f"{arm}, {law}", draw_steps, model, chain, q, v)
print(json.dumps(result))
"""


def answer(program: str, cache: Path, variant: str = "") -> dict[str, float]:
    """Run ``program`` with machine code in the folder ``cache``; return the values it prints."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-c", COMMON.replace("VARIANT", variant) + program]
    ran = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, cwd=ROOT)
    return json.loads(ran.stdout.splitlines()[-1])


def main(folder: Path) -> None:
    """Measure and write."""
    shutil.rmtree(folder, ignore_errors=True)
    compiled = answer(FIRST, folder)
    cached = [answer(FIRST, folder) for _ in range(ROUNDS)]
    speeds = answer(SPEED, folder)
    # constants of the loops are compiled in: another folder, removed before
    other = answer(SPEED, folder / "c_library", C_LIBRARY)
    measured = {
        "machine": machine(),
        "imports_seconds": min(each["imports"] for each in cached),
        "cached_seconds": min(each["first use"] for each in cached),
        "compiled_seconds": compiled["first use"],
        "nanoseconds": {
            name: {"kernel": ns, "C library": other[name]} for name, ns in speeds.items()
        },
    }
    file = ROOT / "reports/benchmarks/start.json"
    file.write_text(json.dumps(measured, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
