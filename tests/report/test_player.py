"""What the player shows at a frame is the take's tables at that time."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from pipeline.report.player import player

STEPS, FRAMES = 41, 5
COVARIANCE = np.array([[4.0, 1.5, 0.5], [1.5, 9.0, -2.0], [0.5, -2.0, 16.0]]) * 1e-6
BIAS = {"additive": 0.001, "gaussian": -0.002}


@pytest.fixture
def played() -> dict:
    t = np.arange(STEPS) / 100
    take = {"take": "test_007", "part": "test"}
    q = {f"q{j}": np.sin(t + j) for j in (1, 2, 3)}
    rows = []
    for model, bias in BIAS.items():
        means = {f"m{j}": q[f"q{j}"] + j * bias for j in (1, 2, 3)}
        entries = {f"c{i}{j}": COVARIANCE[i - 1, j - 1] for i in (1, 2, 3) for j in range(i, 4)}
        rows.append(pd.DataFrame(take | {"k": np.arange(STEPS), "t": t, "model": model} | means | entries | {"ess": 250.4} | q))
    at = np.linspace(0, 0.4, FRAMES)
    nodes = {f"{axis}{n}": 10.0 * n + np.arange(FRAMES) for n in range(4) for axis in "uv"}
    frames = take | {"frame": np.arange(FRAMES) * 3, "t": at} | {f"q{j}": np.sin(at + j) + 0.01 * j for j in (1, 2, 3)}
    return player(pd.DataFrame(frames | {"width": 200, "height": 100} | nodes), pd.concat(rows), [bytes([n]) for n in range(FRAMES)])


def test_every_frame_has_its_image_links_errors_and_bounds(played):
    assert played["take"] == "test_007" and list(played["models"]) == list(BIAS)
    assert [frame["t"] for frame in played["frames"]] == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert played["frames"][2]["image"] == "data:image/png;base64,Ag==" and played["frames"][2]["u"] == [2, 12, 22, 32]
    for frame in played["frames"]:
        assert frame["measured"] == pytest.approx([10, 20, 30], abs=0.01)
        for model, values in frame["models"].items():
            assert values["error"] == pytest.approx([1e3 * j * BIAS[model] for j in (1, 2, 3)], abs=1e-3)
            assert values["bound"] == [2, 3, 4] and values["ess"] == 250


def test_the_ellipses_are_one_and_two_standard_deviations_of_the_particles(played):
    for model, values in played["frames"][1]["models"].items():
        for (i, j), (x, y) in zip(((0, 1), (1, 2)), values["ellipses"], strict=True):
            gap = x.index(None)
            points = np.array([x[:gap] + x[gap + 1 :], y[:gap] + y[gap + 1 :]], dtype=float) / 1e3
            centred = points - BIAS[model] * np.array([[i + 1], [j + 1]])
            distance = np.einsum("in,ij,jn->n", centred, np.linalg.inv(COVARIANCE[np.ix_([i, j], [i, j])]), centred)
            assert np.sqrt(distance) == pytest.approx([1.0] * gap + [2.0] * gap, abs=0.01)


def test_every_plot_has_its_place_and_all_is_plain_data(played):
    assert list(played["figures"]) == [
        "play-depth", "play-joints", "play-error-additive", "play-spread-additive", "play-error-gaussian", "play-spread-gaussian",
    ]  # fmt: skip
    assert json.loads(json.dumps(played, allow_nan=False)) == played
    bounds = {tuple(played["figures"][f"play-error-{model}"]["layout"]["yaxis"]["range"]) for model in BIAS}
    assert len(bounds) == 1, "models side by side need one scale"
