"""Small tables in the shape of those the stages write."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

MODELS = ["additive", "wishart", "gaussian"]
STEPS = 20
JOINT_COLUMNS = [1, 2, 3]


def grid():
    return {"k": np.arange(STEPS + 1), "t": np.arange(STEPS + 1) / 100}


def takes_of(part, count, columns, rng):
    tables = [pd.DataFrame({"take": f"{part}_{n + 1:03d}", "part": part} | grid()) for n in range(count)]
    return [table.assign(**{c: rng.normal(j, 0.1, STEPS + 1) for j, c in enumerate(columns, start=1)}) for table in tables]


@pytest.fixture
def tables() -> dict[str, pd.DataFrame]:
    """One table of each kind that a figure shows, from one seed."""
    rng = np.random.default_rng(11)
    joints = pd.concat([*takes_of("training", 5, ["q1", "q2", "q3"], rng), *takes_of("test", 3, ["q1", "q2", "q3"], rng)])
    noise = pd.concat(takes_of("training", 5, ["w1", "w2", "w3"], rng))
    columns = [f"{c}{j}" for c in "es" for j in JOINT_COLUMNS]
    filtered = [t.assign(model=model) for model in MODELS for t in takes_of("test", 3, columns, rng)]
    deviation = [
        pd.DataFrame(grid() | {"source": source, "error": rng.random(STEPS + 1)} | {f"s{j}": rng.random(STEPS + 1) for j in JOINT_COLUMNS})
        for source in ["recorded", *MODELS]
    ]
    upper = [f"r{i}{j}" for i in JOINT_COLUMNS for j in JOINT_COLUMNS if i <= j]
    kinect = [
        pd.DataFrame({"take": take, "frame": np.arange(6), "t": np.arange(6) / 30.0})
        .assign(**{f"b{j}": rng.normal(size=6) for j in JOINT_COLUMNS})
        .assign(**{c: rng.uniform(0.5, 1, 6) for c in upper})
        for take in ("test_001", "none")
    ]
    nodes = {"initial": [(0.0, 0.1), (0.1, 0.2), (0.0, 0.2), (-0.2, 0.2)], "extended": [(0.0, 0.1), (0.1, 0.1), (0.2, 0.3), (0.4, 0.3)]}
    skeleton = [pd.DataFrame(xz, columns=["x", "z"]).assign(view=view, node=range(4)) for view, xz in nodes.items()]
    cloud = [pd.DataFrame({"view": view, "x": rng.uniform(-0.2, 0.4, 50), "z": rng.uniform(0.1, 0.3, 50)}) for view in nodes]
    errors = [pd.DataFrame({"agents": m, "system": range(40), "error": rng.gamma(2, 0.2 / m, 40)}) for m in (3, 10)]
    errors = [table.assign(covariance_error_diagonal=table["error"], covariance_error_full=table["error"]) for table in errors]
    fx, fy = (c.ravel() for c in np.meshgrid(np.linspace(-2, 6, 9), np.linspace(0, 9, 10), indexing="ij"))
    densities = [
        pd.DataFrame({"configuration": name, "source": source, "fx": fx, "fy": fy, "density": rng.random(len(fx))})
        for name in ("C1", "C2") for source in ("measured", "modelled")
    ]  # fmt: skip
    recovery = [
        pd.DataFrame({"data": data, "estimator": estimator, "parameter": names, "truth": 1.0, "mean": 1.1})
        for data, estimator, names in [
            ("additive", "additive", ["sigma_omega_11_rad2", "sigma_omega_12_rad2"]),
            ("wishart 0.25", "wishart", ["sigma_b"]),
            ("wishart 0.25", "wishart_ml", ["sigma_b"]),
        ]
    ]
    recovery = [
        table.assign(
            relative_bias=[-0.2, 0.01][: len(table)], relative_bias_standard_error=0.01, root_mean_square_error=0.1, standard_deviation=0.1,
            bootstrap_standard_error=0.1, coverage=0.9, datasets=10, without_an_estimate=0,
        )
        for table in recovery
    ]  # fmt: skip
    choices = [
        pd.DataFrame({"estimator": "wishart", "source": source, "truth": truth, "varied": varied, "share": share, "floor": floor}).assign(
            sigma_b=rng.random(3), sigma_b_moving=0.3, bound=0.1
        )
        for source, truth in [("recorded", np.nan), ("drawn", 0.25), ("drawn without measurement noise", 0.25)]
        for varied, share, floor in [("ratio", [0.1, 1.0, 10.0], 0.2), ("floor", 1.0, [0.1, 0.2, 0.3])]
    ]
    bounds = np.linspace(17.0, 20.0, 4)
    ridges = [
        pd.DataFrame({"model": "gaussian", "u": bounds, "alpha": 2 / bounds, "level": 1.0, "excess": (bounds - 18.0) ** 2}),
    ]
    words = [("holds", "fails", "no evidence", "holds"), ("fails", "fails", "holds", "holds")]
    variations = [("", ""), ("clock", "not aligned"), ("chance", "other draws"), ("chance", "other takes")]
    graded = {"severity": [1.0, 2.0, 3.0], "severity_unit": "rows", "outcome": "", "as_expected": True, "rule": "", "found": ""}
    suffered = [
        pd.DataFrame(graded | {"fault": fault, "instrument": of, "error": error, "clean_error": clean, "error_unit": unit})
        for fault, of, error, clean, unit in (
            ("take: dropped", "motion capture", [0.01, 0.02, np.nan], 0.01, "rad"),
            ("take: swapped", "motion capture", np.nan, 0.01, "rad"),
            ("frames: frozen", "depth camera", [0.05, 0.05, 0.1], 0.05, "rad"),
            ("log: saturated", "force transducer", [0.0, 0.1, 1.0], 0.0, "N"),
        )
    ]
    sensitivity = [
        pd.DataFrame({"claim": claim, "about": about, "case": ["joint 1", "joint 2"], "value": 1.0, "than": np.nan}).assign(
            setting=setting, variation=variation, holds=word, verdict=word, changed=word != of_claim[0]
        )
        for (claim, about), of_claim in zip([("first-claim", "method"), ("second-claim", "robots")], words, strict=True)
        for (setting, variation), word in zip(variations, of_claim, strict=True)
    ]
    measured = [
        ("residual_rms", "m", [2e-4, 2e-3, 3e-4], 1e-3),
        ("clock_drift", "s/s", [-1e-3, 2e-3, 0.0], 0.02),
        ("interpolated", "1", 0.0, np.nan),
    ]
    judged = [
        pd.DataFrame({"take": ["train_001", "train_002", "test_001"], "part": ["training", "training", "test"], "measure": measure}).assign(
            value=value, unit=unit, limit=limit, beyond=lambda rows: rows["value"] > rows["limit"], left_out=[False, True, False]
        )
        for measure, unit, value, limit in [*measured, ("clock_drift_standard_error", "s/s", 1e-3, np.nan)]
    ]
    gap = float("nan")
    compared = [
        pd.DataFrame({"steps": steps, "model": ["additive", "gaussian", "student"], "score": score, "mean": [10.0, 10.6, 10.5]}).assign(
            difference=[gap, 0.6, 0.5], low=[gap, 0.5, gap], high=[gap, 0.7, gap]
        )
        for steps in ("all", "moving", "moving, least third of ‖J⁻¹‖: 13 to 14", "particle filter") for score in ("log_score", "nees")
    ]  # fmt: skip
    lists = {
        "model_scores": compared,
        "sensitivity": sensitivity,
        "faults": suffered,
        "takes": judged,
        "parameter_recovery": recovery, "sigma_b_choices": choices, "ridges": ridges,
        "joints": [joints.assign(residual=0.0)], "process_noise": [noise[noise["k"] > 0]], "deviation": deviation, "filter_error": filtered,
        "kinect_noise": kinect, "skeleton": skeleton, "cloud": cloud, "wrench_errors": errors, "force_density": densities,
    }  # fmt: skip
    return {name: pd.concat(parts, ignore_index=True) for name, parts in lists.items()}


@pytest.fixture
def configurations() -> dict[str, SimpleNamespace]:
    """Two arrangements of robots, of three and of four cables."""
    return {
        "C1": SimpleNamespace(direction=[0.0, np.pi / 2, np.pi], tension=[5.0, 4.0, 2.0]),
        "C2": SimpleNamespace(direction=[0.3, 1.9, 3.0, 5.0], tension=[5.0, 4.0, 2.0, 1.0]),
    }
