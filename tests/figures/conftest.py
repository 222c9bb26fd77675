"""Small tables in the shape of those the stages write."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.core.columns import columns, pairs

MODELS, JOINTS = ["additive", "wishart", "gaussian"], ["arm_1", "arm_2", "arm_3"]
STEPS = 20
TIME = {"k": np.arange(STEPS + 1), "t": np.arange(STEPS + 1) / 100}


def stacked(tables) -> pd.DataFrame:
    return pd.concat(list(tables), ignore_index=True)


def takes_of(part: str, count: int, names: list[str], rng, **known) -> pd.DataFrame:
    """Takes whose j-th column is normal about j."""
    return stacked(
        pd.DataFrame(
            {"take": f"{part}_{n + 1:03d}", "part": part}
            | TIME
            | known
            | {c: rng.normal(j, 0.1, STEPS + 1) for j, c in enumerate(names, start=1)}
        )
        for n in range(count)
    )


def wrenches(rng) -> dict[str, pd.DataFrame]:
    """Forces of two planar configurations; two planes and two rows of two others, the modelled
    wrench twice as wide.
    """
    grid = np.linspace(-4, 4, 21)
    x, y = (c.ravel() for c in np.meshgrid(grid, grid, indexing="ij"))
    cells = np.meshgrid(np.linspace(-2, 6, 9), np.linspace(0, 9, 10), indexing="ij")
    fx, fy = (c.ravel() for c in cells)
    tables = {"force_density": [], "wrench_planes": [], "wrench_marginals": []}
    for source, width in (("measured", 1.0), ("modelled", 2.0)):
        plane = {"x": x, "y": y, "density": np.exp(-(x**2 + y**2) / (2 * width**2)) / width**2}
        line = {"value": grid, "density": np.exp(-(grid**2) / (2 * width**2)) / width}
        for name in ("C1", "C2"):
            own = {"configuration": name, "source": source, "fx": fx, "fy": fy}
            tables["force_density"].append(pd.DataFrame(own | {"density": rng.random(len(fx))}))
        for name in ("T3", "T4"):
            own = {"configuration": name, "source": source}
            for a, b in (("fx", "fy"), ("mx", "mz")):
                tables["wrench_planes"].append(pd.DataFrame(own | {"row_x": a, "row_y": b} | plane))
            for row in ("fx", "mz"):
                tables["wrench_marginals"].append(pd.DataFrame(own | {"row": row} | line))
    return {name: stacked(parts) for name, parts in tables.items()}


@pytest.fixture(scope="session")
def tables() -> dict[str, pd.DataFrame]:
    """One table of each kind that a figure shows, from one seed."""
    rng = np.random.default_rng(11)
    q, w, es = columns("q", JOINTS), columns("w", JOINTS), columns("e", JOINTS)
    es = es + columns("s", JOINTS)
    noise = takes_of("training", 5, w, rng)
    kinect = {"frame": np.arange(6), "t": np.arange(6) / 30.0}
    nodes = {
        "initial": [(0.0, 0.1), (0.1, 0.2), (0.0, 0.2), (-0.2, 0.2)],
        "extended": [(0.0, 0.1), (0.1, 0.1), (0.2, 0.3), (0.4, 0.3)],
    }
    u, ratios, normal = np.linspace(17.0, 20.0, 4), np.geomspace(1e-5, 1e-1, 5), np.arange(-3, 4.0)
    curves = {"recorded": [0.7, 0.6, 0.5, 0.2, 0.0], "drawn": [0.3, 0.25, 0.1, 0.05, 0.0]}
    points = [
        (ratio, level, "curve", name)
        for name, curve in curves.items()
        for ratio, level in zip(ratios, curve, strict=True)
    ]
    points += [(5e-3, 0.27, "moments", "recorded"), (5e-5, 0.27, "moments", "drawn")]
    points += [(1e-3, 0.5, "used", "recorded")]
    names = ["ratio", "sigma_b", "point", "source"]
    measures = [
        ("residual_rms", "m", [2e-4, 2e-3, 3e-4], 1e-3),
        ("clock_drift", "s/s", [-1e-3, 2e-3, 0.0], 0.02),
        ("interpolated", "1", 0.0, np.nan),
        ("clock_drift_standard_error", "s/s", 1e-3, np.nan),
    ]
    judged = {"take": ["train_001", "train_002", "test_001"], "left_out": [False, True, False]}
    judged |= {"part": ["training", "training", "test"]}
    return wrenches(rng) | {
        "joints": stacked([takes_of("training", 5, q, rng), takes_of("test", 3, q, rng)]).assign(
            residual=0.0
        ),
        "process_noise": noise[noise["k"] > 0],
        "filter_error": stacked(
            takes_of("test", 3, es, rng, model=name) for name in ("none", *MODELS, "wishart_closed")
        ),
        "deviation": stacked(
            pd.DataFrame(TIME | {"source": source, "error": rng.random(STEPS + 1)}).assign(
                **{name: rng.random(STEPS + 1) for name in columns("s", JOINTS)}
            )
            for source in ["recorded", *MODELS]
        ),
        "kinect_noise": stacked(
            pd.DataFrame({"take": take} | kinect)
            .assign(**{name: rng.normal(size=6) for name in columns("b", JOINTS)})
            .assign(**{name: rng.uniform(0.5, 1, 6) for name in pairs("r", JOINTS)})
            for take in ("test_001", "none")
        ),
        "skeleton": stacked(
            pd.DataFrame(xz, columns=["x", "z"]).assign(view=view, node=range(4))
            for view, xz in nodes.items()
        ),
        "cloud": stacked(
            pd.DataFrame(rng.uniform(0.0, 0.3, (50, 2)), columns=["x", "z"]).assign(view=view)
            for view in nodes
        ),
        "ridges": pd.DataFrame({"u": u, "alpha": 2 / u, "excess": (u - 18.0) ** 2}).assign(
            model="gaussian", level=1.0
        ),
        "sigma_b_weights": pd.DataFrame(points, columns=names).assign(model="wishart"),
        "noise_quantiles": stacked(
            pd.DataFrame({"model": model, "joint": joint, "normal": normal, "noise": normal**3})
            for model in ("scaled_all", "scaled_t", "distance_t")
            for joint in JOINTS
        ),
        "takes": stacked(
            pd.DataFrame(judged).assign(
                measure=measure, value=value, unit=unit, limit=limit, beyond=False
            )
            for measure, unit, value, limit in measures
        ),
        "wrench_errors": stacked(
            pd.DataFrame({"agents": m, "system": range(40), "error": rng.gamma(2, 0.2 / m, 40)})
            for m in (3, 10)
        ).assign(covariance_error_diagonal=0.1, covariance_error_full=0.1),
    }


@pytest.fixture(scope="session")
def options() -> dict[str, object]:
    """The options of all figures, with two arrangements of robots, of three and of four cables."""
    first = SimpleNamespace(direction=[0.0, np.pi / 2, np.pi], tension=[5.0, 4.0, 2.0])
    second = SimpleNamespace(direction=[0.3, 1.9, 3.0, 5.0], tension=[5.0, 4.0, 2.0, 1.0])
    configurations = {"configurations": {"C1": first, "C2": second}}
    return {"models": MODELS, "joints": JOINTS, "mode": "one_step"} | configurations
