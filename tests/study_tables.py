"""Small tables in the shape of those that the studies write."""

from __future__ import annotations

import numpy as np
import pandas as pd

GAP = float("nan")


def parameter_recovery() -> pd.DataFrame:
    """Two parameters of the additive model, and σ_B by two estimators."""
    parts = [
        pd.DataFrame(
            {"data": data, "estimator": estimator, "parameter": names, "truth": 1.0, "mean": 1.1}
        ).assign(
            relative_bias=[-0.2, 0.01][: len(names)],
            relative_bias_standard_error=0.01,
            root_mean_square_error=0.1,
            standard_deviation=0.1,
            bootstrap_standard_error=0.1,
            coverage=0.9,
            datasets=10,
            without_an_estimate=0,
        )
        for data, estimator, names in [
            ("additive", "additive", ["sigma_omega_11_rad2", "sigma_omega_12_rad2"]),
            ("wishart 0.25", "wishart", ["sigma_b"]),
            ("wishart 0.25", "wishart_ml", ["sigma_b"]),
        ]
    ]
    return pd.concat(parts, ignore_index=True)


def sigma_b_choices() -> pd.DataFrame:
    """The recordings and data of one truth, over three ratios and three floors."""
    rng = np.random.default_rng(11)
    sources = [("recorded", GAP), ("drawn", 0.25), ("drawn without measurement noise", 0.25)]
    choices = [("ratio", [0.1, 1.0, 10.0], 0.2), ("floor", 1.0, [0.1, 0.2, 0.3])]
    parts = [
        pd.DataFrame(
            {
                "estimator": "wishart",
                "source": source,
                "truth": truth,
                "varied": varied,
                "share": share,
                "floor": floor,
            }
        ).assign(sigma_b=rng.random(3), sigma_b_moving=0.3, bound=0.1)
        for source, truth in sources
        for varied, share, floor in choices
    ]
    return pd.concat(parts, ignore_index=True)
