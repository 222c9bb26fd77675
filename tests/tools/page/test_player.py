"""What the player shows at a frame is the take's tables at that time, joint by joint."""

from __future__ import annotations

import io
import json
import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from pipeline.tools.page.frames import SPREAD
from pipeline.tools.page.player import Player, player
from pipeline.tools.page.posterior import Posterior
from pipeline.tools.page.take import Pictures, Take

STEPS, FRAMES = 41, 5
JOINTS = ("shoulder", "elbow", "wrist")
COVARIANCE = np.array([[4.0, 1.5, 0.5], [1.5, 9.0, -2.0], [0.5, -2.0, 16.0]]) * 1e-6
BIAS = {"additive": 0.001, "gaussian": -0.002}


def take_of(joints: tuple[str, ...]) -> Take:
    t, n = np.arange(STEPS) / 100, len(joints)
    number = np.arange(1, n + 1)
    truth = np.sin(t[:, None] + number)
    at = np.linspace(0, 0.4, FRAMES)
    covariance = np.broadcast_to(COVARIANCE[:n, :n], (STEPS, n, n))
    ends = 10.0 * np.arange(n + 1) + np.arange(FRAMES)[:, None]
    return Take(
        name="test_007",
        joints=joints,
        t=t,
        truth=truth,
        posteriors={
            model: Posterior(truth + number * bias, covariance, np.full(STEPS, 250.4))
            for model, bias in BIAS.items()
        },
        frame_t=at,
        frame_q=np.sin(at[:, None] + number) + 0.01 * number,
        view=Pictures(
            [np.full((3, 4, 3), 50 * n, np.uint8) for n in range(FRAMES)],
            (200, 100),
            np.stack([ends, ends + 1], axis=-1),
        ),
    )


@pytest.fixture
def played() -> Player:
    return player(take_of(JOINTS))


def test_every_frame_has_its_image_links_errors_and_bounds(played):
    assert played.take == "test_007" and list(played.models) == list(BIAS)
    assert [frame["t"] for frame in played.frames] == ["0.00", "0.10", "0.20", "0.30", "0.40"]
    assert [frame["cursor"] for frame in played.frames] == [0, 25, 50, 75, 100]
    for number, frame in enumerate(played.frames):
        content = b64decode(frame["image"].removeprefix("data:image/webp;base64,"))
        assert Image.open(io.BytesIO(content)).getcolors() == [(12, (50 * number,) * 3)]
    assert played.frames[2]["links"] == "2.0,3.0 12.0,13.0 22.0,23.0 32.0,33.0"
    for frame in played.frames:
        for model, shown in frame["models"].items():
            errors = [f"{1e3 * j * BIAS[model]:.1f}" for j in (1, 2, 3)]
            bounds = ["2.0", "3.0", "4.0"]
            pairs = zip(errors, bounds, strict=True)
            assert shown["texts"] == [*(f"{e} ± {b}" for e, b in pairs), "250"]


def test_the_ellipses_are_one_standard_deviation_of_the_particles(played):
    angle = np.linspace(0, 2 * np.pi, 50)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    for model, shown in played.frames[1]["models"].items():
        for (i, j), text in zip(((0, 1), (1, 2)), shown["ellipses"], strict=True):
            a, b, c, d, e, f = map(float, re.findall(r"-?[\d.]+", text))
            places = np.array([[a, c], [b, d]]) @ circle + [[e], [f]]
            panel = played.spreads[model].panels[i]
            x = panel.x.low + places[0] / SPREAD * (panel.x.high - panel.x.low)
            y = panel.y.high - places[1] / SPREAD * (panel.y.high - panel.y.low)
            centred = np.stack([x, y]) / 1e3 - BIAS[model] * np.array([[i + 1], [j + 1]])
            inverse = np.linalg.inv(COVARIANCE[np.ix_([i, j], [i, j])])
            distance = np.sqrt(np.einsum("in,ij,jn->n", centred, inverse, centred))
            assert distance == pytest.approx(1.0, abs=0.01)


def test_the_depth_cameras_deviation_lies_where_the_axes_say(played):
    for (x, y), panel in zip(
        played.frames[3]["dots"], played.spreads["additive"].panels, strict=True
    ):
        i = JOINTS.index(panel.x_label.split()[0])
        assert x == pytest.approx(panel.x.place(10 * (i + 1)), abs=0.1)
        assert y == pytest.approx(panel.y.place(10 * (i + 2)), abs=0.1)


@pytest.mark.parametrize("joints", [("shoulder", "elbow"), JOINTS])
def test_every_joint_has_its_panel_by_its_name(joints):
    played = player(take_of(joints))
    assert [panel.label for panel in played.angles.panels] == [f"{name} (rad)" for name in joints]
    for model in BIAS:
        labels = [panel.label for panel in played.errors[model].panels]
        assert labels == [f"{name} (mrad)" for name in joints]
        assert len(played.spreads[model].panels) == len(joints) - 1
    assert len(played.frames[0]["models"]["additive"]["texts"]) == len(joints) + 1


def test_models_side_by_side_have_one_scale_and_frames_are_plain_data(played):
    scales = {(p.y.low, p.y.high) for plot in played.errors.values() for p in plot.panels}
    assert len(scales) == 1
    assert json.loads(json.dumps(played.frames, allow_nan=False)) == played.frames


def test_a_wider_spread_widens_the_scale():
    take = take_of(JOINTS)
    wide = {m: replace_covariance(p, 100) for m, p in take.posteriors.items()}
    one, other = player(take), player(replace(take, posteriors=wide))
    highest = [p.errors["additive"].panels[0].y.high for p in (one, other)]
    assert highest[1] > 3 * highest[0]


def replace_covariance(posterior: Posterior, factor: float) -> Posterior:
    return posterior._replace(covariance=factor * posterior.covariance)
