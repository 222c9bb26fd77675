"""What is played of an arm in space: of a filter's take its posterior, else one step ahead."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from spatial_take import UR5

from pipeline.core import contracts
from pipeline.core.columns import spread, triangle
from pipeline.core.options.dataset import Dataset, Motion
from pipeline.core.task import SPACE
from pipeline.tools.page.player import player
from pipeline.tools.page.posterior import FILTER, FIT
from pipeline.tools.page.take import FRAMES, STEPS, TRACK, read_take

ROOT = Path(__file__).parents[3]
M, RATE = 400, 100.0
JOINTS = UR5.joints
NOISE = np.diag(np.arange(1.0, 7.0)) * 1e-8


def steps_of(take: str, part: str) -> dict:
    k = np.arange(M + 1)
    return {"take": take, "part": part, "k": k, "t": k / RATE}


@pytest.fixture
def dataset(tmp_path, monkeypatch) -> Dataset:
    """A UR5 that was logged: two training takes and a test take, and a fitted additive model."""
    monkeypatch.chdir(tmp_path)
    Path("pipeline").symlink_to(ROOT / "pipeline")
    motion = Path("data/ingest/motion")
    for folder in (TRACK, motion, FIT / "additive", FIT / "given"):
        folder.mkdir(parents=True)
    q = 0.4 + 0.3 * np.sin(np.arange(M + 1)[:, None] / RATE + np.arange(1, 7))
    joints, noise = [], []
    for number, (take, part) in enumerate(
        (("train_1", "training"), ("train_2", "training"), ("test_1", "test"))
    ):
        rows = pd.DataFrame(steps_of(take, part) | spread("q", JOINTS, q + 1e-4 * number))
        joints.append(rows.assign(residual=0.0))
        beside = pd.DataFrame(steps_of(take, part) | spread("w", JOINTS, 0 * q))
        noise += [beside[beside["k"] > 0]] if part == "training" else []
    contracts.write(pd.concat(joints, ignore_index=True), "joints", TRACK)
    contracts.write(pd.concat(noise, ignore_index=True), "process_noise", TRACK)
    grid = {"k": np.arange(M + 1), "t": np.arange(M + 1) / RATE}
    commanded = spread("x", SPACE, np.zeros((M + 1, 6))) | spread("v", SPACE, np.ones((M + 1, 6)))
    contracts.write(pd.DataFrame(grid | commanded), "trajectory", motion)
    additive = {"kind": "additive", "noise_covariance": NOISE.tolist()}
    (FIT / "additive/parameters.json").write_text(json.dumps(additive))
    return Dataset(name="lab", recordings="raw", robot=UR5, motion=Motion(RATE, M))


def test_without_a_filter_a_training_take_is_played_one_step_ahead(dataset):
    take = read_take(dataset, ["additive"])
    assert take.name == "train_1" and take.joints == tuple(JOINTS) and take.frame_q is None
    assert (len(take.t), len(take.frame_t), take.t[-1]) == (STEPS, FRAMES, M / RATE)
    np.testing.assert_allclose(take.posteriors["additive"].covariance[5], NOISE)
    played = player(take)
    assert played.scene and not played.filtered and len(played.frames) == FRAMES


def test_with_a_filter_its_test_take_is_played(dataset):
    rows = pd.DataFrame(steps_of("test_1", "test") | spread("m", JOINTS, np.ones((M + 1, 6))))
    covariance = np.broadcast_to(4 * NOISE, (M + 1, 6, 6))
    rows = rows.assign(**triangle("c", JOINTS, covariance), ess=50.0, resampled=False)
    rows = rows.assign(measured=True, clipped=0, outside=0)
    (FILTER / "additive").mkdir(parents=True)
    contracts.write(rows, "posterior", FILTER / "additive")
    take = read_take(dataset, ["additive"])
    assert take.name == "test_1" and player(take).filtered
    np.testing.assert_allclose(take.posteriors["additive"].covariance[5], 4 * NOISE)


def test_where_no_model_says_anything_nothing_is_played(dataset, capsys):
    # a dispersion whose steps have no covariance
    wide = {"kind": "wishart", "sigma_b": 0.95, "decomposition": "qr_transposed"}
    (FIT / "given/parameters.json").write_text(json.dumps(wide))
    assert read_take(dataset, ["given"]) is None
    said = capsys.readouterr().out
    assert "given is left out of the player: the covariance of a Wishart step exists only" in said
