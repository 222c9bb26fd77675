"""A new joint log is cut and brought in phase as the dataset's own were, and a pushed repetition in
it is told from the others.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from joint_files import read_joint_log
from joint_logs import FILES, MADE_UP, ingested, write_movement
from written_logs import write_joint_log

from pipeline.core import config
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.stages import ingest, track
from pipeline.tools.assess import command
from pipeline.tools.assess.command import new_takes
from pipeline.tools.export.command import exported

MODEL = {"kind": "additive", "noise_covariance": (1e-9 * np.eye(3)).tolist()}
COVARIANCE = {"estimates": [], "covariance": []}


@pytest.fixture
def logs(log_project, tmp_path) -> Path:
    """The folder of a movement of nine repetitions that the stages have read, with a model."""
    write_movement(tmp_path / "logs/move_1", 17, noise=5e-5)
    motion = {"steps": 140, "pose_noise": 5e-5}
    log_project("ur5_planar", tmp_path / "logs", joint_log=MADE_UP, motion=motion)
    ingest.run("motion")
    Path("data/ingest/depth").mkdir()
    track.run()
    (folder := Path("data/fit/additive")).mkdir(parents=True)
    for name, values in {"parameters": MODEL, "covariance": COVARIANCE, "fit": {}}.items():
        (folder / f"{name}.json").write_text(json.dumps(values))
    return tmp_path / "logs"


def test_a_log_of_the_dataset_is_read_as_the_dataset_has_it(logs):
    settings = config.sections("assess", command.HERE / "reads.yaml")
    names, q = ingested()
    takes = new_takes(logs / "move_1", settings.dataset, q.mean(axis=0))
    assert [*takes] == names
    np.testing.assert_array_equal(np.stack([*takes.values()]), q)
    write_movement(logs / "other", 1, offset=0.5)
    with pytest.raises(RecordingError, match="no repetition of the dataset's motion"):
        new_takes(logs / "other", settings.dataset, q.mean(axis=0))
    with pytest.raises(RecordingError, match="no such file"):
        new_takes(logs / "absent", settings.dataset, q.mean(axis=0))


@pytest.mark.slow
def test_a_pushed_repetition_is_named_and_the_usual_ones_behave(logs, capsys):
    write_movement(logs / "new", 3, noise=5e-5, seed=5)
    log = read_joint_log(logs / "new" / FILES[0], joints=6)
    # the second way out, joint 3, in the middle of its motion
    log.signals["actual"][60 + 320 + 40 : 60 + 320 + 60, 2] += 1e-3
    write_joint_log(logs / "new" / FILES[0], log)
    with pytest.raises(ConfigError, match="none of ur5_planar in data/export"):
        command.run(logs / "new")
    settings = config.sections("export", Path("pipeline/tools/export/reads.yaml"))
    Path("data/export").mkdir()
    text = json.dumps(exported("additive", settings))
    Path("data/export/ur5_planar_additive.json").write_text(text)
    command.run(logs / "new")
    said = capsys.readouterr().out
    heads = re.findall(r"(new_\d) (behaves|does NOT behave) as the 9 takes", said)
    assert heads == [("new_1", "behaves"), ("new_2", "does NOT behave")]
    assert "largest difference: joint_3 from" in said.partition("new_2 does NOT")[2]
    assert all(Path(f"data/assess/new_{number}.png").is_file() for number in (1, 2))
