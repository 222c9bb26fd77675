"""Small tables in the shape of those the stages write."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.core.columns import columns, pairs

MODELS = ["additive", "wishart", "gaussian"]
STEPS = 20
JOINTS = ["arm_1", "arm_2", "arm_3"]


def grid():
    return {"k": np.arange(STEPS + 1), "t": np.arange(STEPS + 1) / 100}


def takes_of(part, count, names, rng):
    tables = [
        pd.DataFrame({"take": f"{part}_{n + 1:03d}", "part": part} | grid()) for n in range(count)
    ]
    return [
        table.assign(**{c: rng.normal(j, 0.1, STEPS + 1) for j, c in enumerate(names, start=1)})
        for table in tables
    ]


def six_rows() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Two planes and two rows of two configurations, the modelled wrench twice as wide."""
    grid = np.linspace(-4, 4, 21)
    x, y = (c.ravel() for c in np.meshgrid(grid, grid, indexing="ij"))
    planes, marginals = [], []
    for name in ("T3", "T4"):
        for source, width in (("measured", 1.0), ("modelled", 2.0)):
            own = {"configuration": name, "source": source}
            for pair in (("fx", "fy"), ("mx", "mz")):
                density = np.exp(-(x**2 + y**2) / (2 * width**2)) / width**2
                table = {"row_x": pair[0], "row_y": pair[1], "x": x, "y": y, "density": density}
                planes.append(pd.DataFrame(own | table))
            for row in ("fx", "mz"):
                density = np.exp(-(grid**2) / (2 * width**2)) / width
                table = {"row": row, "value": grid, "density": density}
                marginals.append(pd.DataFrame(own | table))
    return pd.concat(planes, ignore_index=True), pd.concat(marginals, ignore_index=True)


@pytest.fixture
def tables() -> dict[str, pd.DataFrame]:
    """One table of each kind that a figure shows, from one seed."""
    rng = np.random.default_rng(11)
    joints = pd.concat(
        [
            *takes_of("training", 5, columns("q", JOINTS), rng),
            *takes_of("test", 3, columns("q", JOINTS), rng),
        ]
    )
    noise = pd.concat(takes_of("training", 5, columns("w", JOINTS), rng))
    named = columns("e", JOINTS) + columns("s", JOINTS)
    filters = ["none", *MODELS, "wishart_closed"]
    filtered = [t.assign(model=name) for name in filters for t in takes_of("test", 3, named, rng)]
    deviation = [
        pd.DataFrame(
            grid()
            | {"source": source, "error": rng.random(STEPS + 1)}
            | {name: rng.random(STEPS + 1) for name in columns("s", JOINTS)}
        )
        for source in ["recorded", *MODELS]
    ]
    kinect = [
        pd.DataFrame({"take": take, "frame": np.arange(6), "t": np.arange(6) / 30.0})
        .assign(**{name: rng.normal(size=6) for name in columns("b", JOINTS)})
        .assign(**{name: rng.uniform(0.5, 1, 6) for name in pairs("r", JOINTS)})
        for take in ("test_001", "none")
    ]
    nodes = {
        "initial": [(0.0, 0.1), (0.1, 0.2), (0.0, 0.2), (-0.2, 0.2)],
        "extended": [(0.0, 0.1), (0.1, 0.1), (0.2, 0.3), (0.4, 0.3)],
    }
    skeleton = [
        pd.DataFrame(xz, columns=["x", "z"]).assign(view=view, node=range(4))
        for view, xz in nodes.items()
    ]
    cloud = [
        pd.DataFrame(
            {"view": view, "x": rng.uniform(-0.2, 0.4, 50), "z": rng.uniform(0.1, 0.3, 50)}
        )
        for view in nodes
    ]
    errors = [
        pd.DataFrame({"agents": m, "system": range(40), "error": rng.gamma(2, 0.2 / m, 40)})
        for m in (3, 10)
    ]
    errors = [
        table.assign(covariance_error_diagonal=table["error"], covariance_error_full=table["error"])
        for table in errors
    ]
    fx, fy = (
        c.ravel() for c in np.meshgrid(np.linspace(-2, 6, 9), np.linspace(0, 9, 10), indexing="ij")
    )
    densities = [
        pd.DataFrame(
            {
                "configuration": name,
                "source": source,
                "fx": fx,
                "fy": fy,
                "density": rng.random(len(fx)),
            }
        )
        for name in ("C1", "C2")
        for source in ("measured", "modelled")
    ]
    bounds = np.linspace(17.0, 20.0, 4)
    ridges = [
        pd.DataFrame(
            {
                "model": "gaussian",
                "u": bounds,
                "alpha": 2 / bounds,
                "level": 1.0,
                "excess": (bounds - 18.0) ** 2,
            }
        ),
    ]
    ratios = np.geomspace(1e-5, 1e-1, 5)
    weights = [
        pd.DataFrame({"ratio": ratios, "sigma_b": falling, "point": "curve", "source": source})
        for source, falling in (
            ("recorded", [0.7, 0.6, 0.5, 0.2, 0.0]),
            ("drawn", [0.3, 0.25, 0.1, 0.05, 0.0]),
        )
    ]
    weights += [
        pd.DataFrame({"ratio": [5e-3], "sigma_b": 0.27, "point": "moments", "source": "recorded"}),
        pd.DataFrame({"ratio": [5e-5], "sigma_b": 0.27, "point": "moments", "source": "drawn"}),
        pd.DataFrame({"ratio": [1e-3], "sigma_b": 0.5, "point": "used", "source": "recorded"}),
    ]
    measured = [
        ("residual_rms", "m", [2e-4, 2e-3, 3e-4], 1e-3),
        ("clock_drift", "s/s", [-1e-3, 2e-3, 0.0], 0.02),
        ("interpolated", "1", 0.0, np.nan),
    ]
    judged = [
        pd.DataFrame(
            {
                "take": ["train_001", "train_002", "test_001"],
                "part": ["training", "training", "test"],
                "measure": measure,
            }
        ).assign(
            value=value,
            unit=unit,
            limit=limit,
            beyond=lambda rows: rows["value"] > rows["limit"],
            left_out=[False, True, False],
        )
        for measure, unit, value, limit in [
            *measured,
            ("clock_drift_standard_error", "s/s", 1e-3, np.nan),
        ]
    ]
    lists = {
        "takes": judged,
        "ridges": ridges,
        "sigma_b_weights": [each.assign(model="wishart") for each in weights],
        "joints": [joints.assign(residual=0.0)],
        "process_noise": [noise[noise["k"] > 0]],
        "deviation": deviation,
        "filter_error": filtered,
        "noise_quantiles": [
            pd.DataFrame(
                {"normal": np.linspace(-3, 3, 9), "noise": np.linspace(-3, 3, 9) ** 3}
            ).assign(model=model, joint=joint)[["model", "joint", "normal", "noise"]]
            for model in ("scaled_all", "scaled_t")
            for joint in JOINTS
        ],
        "kinect_noise": kinect,
        "skeleton": skeleton,
        "cloud": cloud,
        "wrench_errors": errors,
        "force_density": densities,
    }
    planes, marginals = six_rows()
    whole = {"wrench_planes": planes, "wrench_marginals": marginals}
    return whole | {name: pd.concat(parts, ignore_index=True) for name, parts in lists.items()}


@pytest.fixture
def configurations() -> dict[str, SimpleNamespace]:
    """Two arrangements of robots, of three and of four cables."""
    return {
        "C1": SimpleNamespace(direction=[0.0, np.pi / 2, np.pi], tension=[5.0, 4.0, 2.0]),
        "C2": SimpleNamespace(direction=[0.3, 1.9, 3.0, 5.0], tension=[5.0, 4.0, 2.0, 1.0]),
    }
