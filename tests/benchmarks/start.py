"""First use and speed of the kernel, as reports/benchmarks/start.json: ``python
tests/benchmarks/start.py FOLDER``, FOLDER being for the machine code in between.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from contests import HERE, ROOT, machine, write_results

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
sys.path[:0] = {[str(ROOT), str(ROOT / "tests"), str(HERE)]!r}
begin = time.process_time()
import pipeline.core.environment
VARIANT
import pipeline.models.draws, pipeline.filtering.particle_filter
import pipeline.models.wishart.perturbation, pipeline.models.wishart.quadrature
imported = time.process_time() - begin
import numpy as np
from scenario import ROBOTS, scene, take
from pipeline.models.kinds import build_model
from pipeline.models.draws import draw_steps
"""
# processor time in s
FIRST = """
begin = time.process_time()
for arm in ROBOTS:
    take(4, arm).filtered(100, np.random.default_rng(1))
print(json.dumps({"imports": imported, "first use": time.process_time() - begin}))
"""
# ns a particle and step, the least of 12 calls
SPEED = """
result = {}
for arm in ROBOTS:
    stage, rng = scene(arm), np.random.default_rng(1)
    n, chain = len(stage.start.mean), stage.chain
    q = stage.start.mean + 0.05 * rng.standard_normal((20_000, n))
    v = chain.jacobian(stage.start.mean) @ np.full(n, 1e-3)
    wishart = {"kind": "wishart", "sigma_b": 0.25}
    for law, options in {
        "pivoted LU": wishart | {"decomposition": "pivoted_lu"},
        "QR of J": wishart | {"decomposition": "qr"},
        "QR of the transpose": wishart | {"decomposition": "qr_transposed"},
        "Gaussian": {"kind": "gaussian", "alpha": 0.1, "u": 1e3},
        "additive": {"kind": "additive", "noise_covariance": (1e-6 * np.eye(n)).tolist()},
    }.items():
        model, least = build_model(options), np.inf
        for _ in range(12):
            begin = time.perf_counter()
            draw_steps(model, chain, q, v, rng)
            least = min(least, time.perf_counter() - begin)
        result[f"{arm}, {law}"] = round(1e9 * least / len(q), 1)
print(json.dumps(result))
"""


# no loop of the kernel is vectorised
SCALAR = {"NUMBA_LOOP_VECTORIZE": "0", "NUMBA_SLP_VECTORIZE": "0"}


def answer(program: str, cache: Path, variant: str = "", **setting: str) -> dict[str, float]:
    """Run ``program`` with machine code in the folder ``cache``; return the values it prints."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)} | setting
    command = [sys.executable, "-c", COMMON.replace("VARIANT", variant) + program]
    ran = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, cwd=ROOT)
    return json.loads(ran.stdout.splitlines()[-1])


def main(folder: Path) -> None:
    """Measure and write."""
    shutil.rmtree(folder, ignore_errors=True)
    compiled, *cached = [answer(FIRST, folder) for _ in range(4)]
    speeds = answer(SPEED, folder)
    # constants of the loops are compiled in: another folder, removed before
    other = answer(SPEED, folder / "c_library", C_LIBRARY)
    scalar = answer(SPEED, folder / "scalar", **SCALAR)
    measured = {
        "machine": machine(),
        "imports_seconds": min(each["imports"] for each in cached),
        "cached_seconds": min(each["first use"] for each in cached),
        "compiled_seconds": compiled["first use"],
    }
    speeds = {
        name: {"kernel": ns, "C library": other[name], "scalar": scalar[name]}
        for name, ns in speeds.items()
    }
    write_results("start", measured | {"nanoseconds": speeds})


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
