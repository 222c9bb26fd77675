"""The stage readings decides what the recordings have evidence on, with a depth camera or without,
and again the same.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from known_law import JOINTS, ROOT, TAKES

from pipeline.core import contracts
from pipeline.core.columns import spread
from pipeline.stages import readings

OUT = Path("data/readings")
NOISE = 1e-4 * np.eye(3)


@pytest.fixture
def claims(project) -> None:
    """The paper's claims in the project."""
    Path("reports").mkdir(exist_ok=True)
    Path("reports/claims.yaml").write_bytes((ROOT / "reports/claims.yaml").read_bytes())


def film(project) -> None:
    """A depth camera that saw the test takes at every tenth step."""
    _, q, _ = project
    k = np.arange(0, q.shape[1], 10)
    rng = np.random.default_rng(2)
    angles = q[TAKES:, k] + rng.multivariate_normal(np.zeros(3), NOISE, (TAKES, len(k)))
    takes = [f"take_{number:02d}" for number in range(TAKES, 2 * TAKES)]
    frame = {"take": np.repeat(takes, len(k)), "part": "test"}
    frame |= {"frame": np.tile(np.arange(len(k)), TAKES), "t": np.tile(k / 100, TAKES)}
    nodes = dict.fromkeys(("x2", "z2", "x3", "z3", "xe", "ze"), 0.0)
    fit = {"points": 1, "objective": 0.0}
    table = pd.DataFrame(frame | spread("q", JOINTS, angles) | nodes | fit)
    Path("data/articulate").mkdir(parents=True)
    contracts.write(table, "angles", Path("data/articulate"))


def verdicts() -> pd.DataFrame:
    """The readings' verdicts by claim and reading."""
    readings.run()
    rows = contracts.read("readings", OUT)
    return rows.pivot(index="claim", columns="reading", values="holds")


def test_without_a_camera_the_claims_about_motion_alone_are_decided(project, claims):
    ruled = verdicts()
    assert set(ruled.columns) == {"pivoted LU", "QR of J", "QR of Jᵀ (control)"}
    assert not any(claim.startswith(("filter", "kinect", "wrench")) for claim in ruled.index)
    assert {"spread-followed-by-wishart", "mean-error"} <= set(ruled.index)
    # no reading of the Wishart model bears on the others
    of_gaussian = ruled.loc["spread-followed-by-gaussian"]
    assert of_gaussian.nunique() == 1


@pytest.mark.slow
def test_with_a_camera_the_filter_is_decided_and_again_the_same(project, claims):
    film(project)
    ruled = verdicts()
    assert {"filter-accuracy-equal", "kinect-biased"} <= set(ruled.index)
    pd.testing.assert_frame_equal(ruled, verdicts())


def test_without_a_wishart_model_nothing_is_written(project, claims, choose):
    choose(models=["additive"])
    readings.run()
    assert OUT.is_dir() and not contracts.exists("readings", OUT)
