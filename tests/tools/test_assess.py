"""Innovations of takes of a known model are as large as predicted; takes of one kind are
called different as seldom as is said; a push is found, in its joint and at its time; a new log is
cut and brought in phase as the dataset's own were.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from exported_models import PARAMETERS, write_model
from joint_logs import MADE_UP, ingested, write_movement
from numpy.random import default_rng
from numpy.testing import assert_array_equal

from pipeline.configuration import config
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.models import load
from pipeline.models.exported.writer import error_record
from pipeline.models.model import Commands
from pipeline.recordings.runs import joint_runs
from pipeline.stages import ingest, track
from pipeline.tools.assess import command
from pipeline.tools.characterize.logs import folder_logs

JOINTS = ["a", "b", "c"]
POSE = np.diag([1.0, 2.0, 1.5]) * 1e-6


TAKES = 60
TASK_STEPS = np.outer(np.sin(np.linspace(0, 3, 40)), [0.0005, -0.0005, 0.01])


def drawn_takes(model) -> tuple[np.ndarray, np.ndarray]:
    """Commanded poses of the task before each of TASK_STEPS (40, 3), and measured joint angles
    (TAKES, 41, 3) in rad that the model draws.
    """
    rng = default_rng(1)
    start = np.array([0.3, 1.5, -0.4])
    path = [start]
    for step in TASK_STEPS:
        path.append(path[-1] + model.chain.nominal_step(path[-1], step))
    targets = model.chain.pose(np.array(path[:-1]))

    q = np.tile(start, (TAKES, 1))
    true = [q]
    for step, target in zip(TASK_STEPS, targets, strict=True):
        commanded = model.command(q, target, task_step=step)
        q = model.step(q, task_step=commanded, rng=rng)
        true.append(q)
    noise = rng.multivariate_normal(np.zeros(3), POSE, (TAKES, len(true)))
    return targets, np.stack(true, axis=1) + noise


@pytest.mark.parametrize("share", [0.0, 0.2])
@pytest.mark.parametrize("kind", PARAMETERS)
def test_innovations_are_as_large_as_predicted(kind, share, chain, tmp_path):
    model = load(write_model(tmp_path / "model.json", kind, chain, share=share))
    targets, poses = drawn_takes(model)
    commands = Commands(TASK_STEPS, targets, share)

    def square(pose: np.ndarray) -> float:
        """Mean normalised square for the noise ``pose``."""
        model.record["pose_covariance_rad2"] = pose.tolist()
        error, covariance = command.innovations_of(model, commands, poses)
        white = np.linalg.solve(covariance, error[..., None])[..., 0]
        return float(np.vecdot(error, white).mean())

    # 3 on average; 2400 steps of heavy tails vary by a few per cent
    assert square(POSE) == pytest.approx(3.0, rel=0.08)
    # control: the measured poses are not exact
    assert square(np.eye(3) * 1e-12) > 3.5


def innovations(seed: int, takes: int = 51) -> np.ndarray:
    """Innovations of heavy-tailed steps that are predicted as normal, with another scale in every
    take; the evidence is then far from normal.
    """
    rng = default_rng(seed)
    return rng.gamma(4, 1 / 4, (takes, 1, 1)) * rng.standard_t(4, (takes, 100, 3))


def verdict(drawn: np.ndarray) -> command.TakeVerdict:
    """On the last of the takes, compared with all before it."""
    last = len(drawn) - 1
    earlier = np.arange(len(drawn)) < last
    predicted = np.broadcast_to(np.eye(3), (*drawn.shape, 3))
    return command.judge(drawn, predicted, last, earlier, JOINTS, 100.0)


def test_a_take_of_the_same_kind_is_called_another_as_seldom_as_the_level_says():
    called = [not verdict(innovations(seed)).behaves for seed in range(150)]
    # at most LEVEL: 7.5 of 150 on average, and not beyond five standard deviations of that
    assert 0 < sum(called) < 7.5 + 5 * np.sqrt(7.5)
    assert verdict(innovations(0)).limit == command.LEVEL / 2
    assert verdict(innovations(0, takes=5)).limit == 1 / 5


@pytest.mark.parametrize(("joint", "first"), [(1, 0), (2, 60)])
def test_a_push_is_found_in_its_joint_and_span(joint, first):
    drawn = innovations(3)
    assert verdict(drawn).behaves

    drawn[-1, first : first + 8, joint] += 12.0
    pushed = verdict(drawn)
    assert not pushed.behaves and pushed.p_spans <= pushed.limit
    text = command.assessment("new", "model.json", 0, pushed)
    assert (
        "new does NOT behave as the 50 takes it is compared with (model.json)." in text
    )
    begins = f"{JOINTS[joint]} from {first / 100:.3g} to {(first + 10) / 100:.3g} s, less likely"
    assert f"largest difference: {begins}" in text


@pytest.fixture
def logs(log_project, tmp_path) -> Path:
    """The folder of a movement of nine repetitions that the stages have read."""
    write_movement(tmp_path / "logs/move_1", 17, noise=5e-5)
    motion = {"steps": 140, "pose_noise": 5e-5}
    log_project("ur5_planar", tmp_path / "logs", joint_log=MADE_UP, motion=motion)
    ingest.run("motion")
    track.run()
    return tmp_path / "logs"


def test_a_log_of_the_dataset_is_read_as_the_dataset_has_it(logs):
    settings = config.sections("assess", command.HERE / "reads.yaml")
    names, q = ingested()
    takes = command.new_takes(logs / "move_1", settings.dataset, q.mean(axis=0))

    assert [*takes] == names
    assert_array_equal(np.stack([*takes.values()]), q)

    write_movement(logs / "other", 1, offset=0.5)
    with pytest.raises(RecordingError, match="no repetition of the dataset's motion"):
        command.new_takes(logs / "other", settings.dataset, q.mean(axis=0))
    with pytest.raises(
        ConfigError,
        match="of the dataset other, which has no run here",
    ):
        command.run_folder("other", Path("other.json"))
    with pytest.raises(ConfigError, match="none of ur5_planar in data/export"):
        command.run(logs / "move_1")
    with pytest.raises(RecordingError, match="no such file"):
        command.new_takes(logs / "absent", settings.dataset, q.mean(axis=0))


def test_a_single_run_is_assessed_by_an_exported_error_law_without_a_run_of_stages(
    tmp_path,
    capsys,
    monkeypatch,
):
    monkeypatch.chdir(tmp_path)
    for name, seed, noise in (
        ("move_1", 1, 5e-5),
        ("move_2", 2, 5e-5),
        ("new", 3, 5e-5),
        ("loose", 4, 1e-3),
    ):
        write_movement(tmp_path / name, 2, noise=noise, seed=seed)
    logs = folder_logs(tmp_path, {})
    read = {name: logs.movements[name] for name in ("move_1", "move_2")}
    runs = joint_runs(read, logs.rate).runs
    options = config.model_options(["joint_step"])["joint_step"]
    record = error_record("joint_step", options, runs, "bench")
    Path("model.json").write_text(json.dumps(record))
    printed = {}
    for name in ("new", "loose"):
        command.run(tmp_path / name, Path("model.json"))
        printed[name] = capsys.readouterr().out
    low, high = re.search(
        r"one sample: ([\d.]+) to ([\d.]+) by joint",
        printed["new"],
    ).groups()
    assert 0.8 < float(low) < float(high) < 1.25
    for words in ("of 5 runs", "new_1", "new_2"):
        assert words in printed["new"]
    assert "loose_1 does NOT behave as the 4 runs of model.json" in printed["loose"]
    assert not Path("data").exists()

    record["joints"] = record["parameters"]["joints"] = [f"axis_{j}" for j in range(6)]
    Path("model.json").write_text(json.dumps(record))
    with pytest.raises(RecordingError, match="the log has no joint axis_0, axis_1"):
        command.run(tmp_path / "new", Path("model.json"))
