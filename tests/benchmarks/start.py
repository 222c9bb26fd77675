"""First use and speed of the kernel, as reports/benchmarks/start.json: ``python
tests/benchmarks/start.py FOLDER``, FOLDER being for the machine code in between. Each measurement
is a process of its own, ``python start.py FUNCTION``.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from contests import machine, write_results

# no loop of the kernel is vectorised
SCALAR = {"NUMBA_LOOP_VECTORIZE": "0", "NUMBA_SLP_VECTORIZE": "0"}
CALLS = 12


def first_use() -> dict[str, float]:
    """Processor times in s of the imports and of the first filters of three arms."""
    begin = time.process_time()
    import pipeline.filtering.particle_filter
    import pipeline.models.draws
    import pipeline.models.wishart.perturbation
    import pipeline.models.wishart.quadrature  # noqa: F401

    imports = time.process_time() - begin
    import numpy as np
    from scenario import ROBOTS, take

    begin = time.process_time()
    for arm in ROBOTS:
        take(4, arm).filtered(100, np.random.default_rng(1))
    return {"imports": imports, "filters": time.process_time() - begin}


def laws(joints: int) -> dict[str, dict]:
    """Parameters of every law for an arm of so many joints."""
    wishart = {"kind": "wishart", "sigma_b": 0.25}
    covariance = [[1e-6 * (i == j) for j in range(joints)] for i in range(joints)]
    return {
        "pivoted LU": wishart | {"decomposition": "pivoted_lu"},
        "QR of J": wishart | {"decomposition": "qr"},
        "QR of the transpose": wishart | {"decomposition": "qr_transposed"},
        "Gaussian": {"kind": "gaussian", "alpha": 0.1, "u": 1e3},
        "additive": {"kind": "additive", "noise_covariance": covariance},
    }


def draws() -> dict[str, float]:
    """Time in ns a particle and step of the draws of every law, the least of CALLS calls."""
    import numpy as np
    from scenario import ROBOTS, scene

    from pipeline.models.draws import draw_steps
    from pipeline.models.kinds import build_model

    result = {}
    for arm in ROBOTS:
        chain, _, start, *_ = scene(arm)
        n = len(start.mean)
        rng = np.random.default_rng(1)
        q = start.mean + 0.05 * rng.standard_normal((20_000, n))
        v = chain.jacobian(start.mean) @ np.full(n, 1e-3)
        for law, parameters in laws(n).items():
            model = build_model(parameters)
            seconds = []
            for _ in range(CALLS):
                begin = time.perf_counter()
                draw_steps(model, chain, q, v, rng)
                seconds.append(time.perf_counter() - begin)
            result[f"{arm}, {law}"] = round(1e9 * min(seconds) / len(q), 1)
    return result


def answer(function: str, cache: Path, **setting: str) -> dict[str, float]:
    """Result of a function in a process with machine code in the folder ``cache``."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)} | setting
    command = [sys.executable, __file__, function]
    ran = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE)
    return json.loads(ran.stdout)


def main(folder: Path) -> None:
    """Measure and write."""
    shutil.rmtree(folder, ignore_errors=True)
    compiled, *cached = [answer("first_use", folder) for _ in range(4)]
    # constants of the loops are compiled in: another folder for each; in turn, as speeds change
    settings = {"kernel": {}, "scalar": SCALAR}
    runs = []
    for _ in range(3):
        by_setting = {}
        for name, setting in settings.items():
            by_setting[name] = answer("draws", folder / name, **setting)
        runs.append(by_setting)
    nanoseconds = {}
    for law in runs[0]["kernel"]:
        nanoseconds[law] = {
            name: min(run[name][law] for run in runs) for name in settings
        }
    measured = {
        "machine": machine(),
        "imports_seconds": min(used["imports"] for used in cached),
        "cached_seconds": min(used["filters"] for used in cached),
        "compiled_seconds": compiled["filters"],
        "nanoseconds": nanoseconds,
    }
    write_results("start", measured)


if __name__ == "__main__":
    if sys.argv[1] in ("first_use", "draws"):
        print(json.dumps(globals()[sys.argv[1]]()))
    else:
        main(Path(sys.argv[1]).resolve())
