"""Held-out motions: the law of the noise has the highest score. A joint that moved in the held-out
motion alone is refused, and a matrix model has no score for singular poses.
"""

import numpy as np
import pandas as pd
import pytest
from planar_poses import chain

from pipeline.configuration import config
from pipeline.models.other_motions import EACH, MotionSteps, other_motions
from pipeline.verdicts.model_card import recommended

__all__ = ["chain"]
JOINTS, RATE = ("a", "b", "c"), 100.0


def motion(number: int, moving: tuple[int, ...] = (0, 1, 2), *, tails=None, law="scaled"):
    """Five takes of a motion through regular poses; noise of 2 % of the step and 20 µrad, or of
    another growth with the step.
    """
    rng = np.random.default_rng(number)
    share = (1 - np.cos(np.pi * np.arange(121) / 120)) / 2
    far = np.zeros(3)
    far[list(moving)] = rng.uniform(0.2, 0.5, len(moving))
    path = np.array([0.3, 1.4, -0.4]) + share[:, None] * far
    dq = np.tile(np.diff(path, axis=0), (5, 1, 1))
    grown = {"additive": 4e-9, "scaled": (0.02 * dq) ** 2, "distance": 1e-6 * np.abs(dq)}
    std = np.sqrt(np.broadcast_to(2e-5**2 + grown[law], dq.shape))
    e = rng.standard_normal(dq.shape) if tails is None else rng.standard_t(tails, dq.shape)
    q = path[:-1] + 1e-4 * rng.standard_normal((5, 1, 3))
    return MotionSteps(str(number), np.broadcast_to(q, dq.shape), dq, std * e)


def recommend(motions) -> tuple[str | None, str, dict[str, pd.DataFrame]]:
    tables = other_motions(motions, JOINTS, RATE)
    name, why = recommended(tables["other_motions"], tables["motion_spread"], tables["motions"])
    return name, why, dict(tables)


@pytest.mark.parametrize(
    ("tails", "law", "allowed"),
    [
        (None, "scaled", {"scaled_all", "scaled_t"}),
        (4.0, "scaled", {"scaled_t"}),
        (4.0, "distance", {"distance_t"}),
        (4.0, "additive", {"additive_t", "scaled_t", "distance_t"}),
    ],
)
def test_the_law_of_the_noise_is_recommended_and_its_spread_is_the_measured(tails, law, allowed):
    name, why, tables = recommend([motion(k, tails=tails, law=law) for k in range(4)])
    assert name in allowed and "4 held-out motions" in why
    spread = tables["motion_spread"].query("model == @name")
    ratio = spread["predicted_rad"] / spread["measured_rad"]
    assert ratio.between(0.7, 1.4).all()
    tails_of = tables["tails"].query("model == @name")
    assert (tails_of["three_sigma"] > 0.96).all()
    heavy = tables["tails"].query("model == 'scaled_all'")["kurtosis"].min()
    assert heavy > 4 if tails else heavy < 4


def test_a_joint_that_moves_in_the_held_out_motion_alone_is_refused_by_name():
    _, _, tables = recommend([motion(1, (0,)), motion(2, (1, 2)), motion(3, (1, 2))])
    rows = tables["other_motions"].set_index(["model", "motion"])
    assert np.isnan(rows.loc[("scaled_all", "1"), "score"])
    assert "noise of a at a step" in rows.loc[("scaled_all", "1"), "reason"]
    assert np.isnan(rows.loc[("scaled_all", EACH), "score"])
    assert np.isfinite(rows.loc[("additive_all", EACH), "score"])
    # fitted to all motions its gain is known
    assert tables["untold"].query("model == 'scaled_all'").empty


def test_a_matrix_model_is_scored_on_regular_motions_and_refused_at_a_singular_pose(chain):
    options = config.model_options(["gaussian"])
    motions = [motion(k) for k in range(3)]

    def rows(given) -> pd.DataFrame:
        scored = other_motions(given, JOINTS, RATE, pose_noise=1e-6, chain=chain, matrix=options)[
            "other_motions"
        ]
        return scored[scored["model"] == "gaussian"]

    assert rows(motions)["score"].notna().all()
    straight = motion(3)
    bent = straight.q.copy()
    bent[..., 1] = chain.straight
    straight = straight._replace(q=bent)
    refused = rows([*motions, straight])
    assert refused["score"].isna().any()
    assert refused["reason"].str.contains("singular").any()
