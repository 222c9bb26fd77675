"""The same robot with logs of another form, and with repetitions that were disturbed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_files import read_joint_log, read_movement
from joint_logs import AWAY, FILES, HOME, MADE_UP, ingested, quality, write_movement
from written_logs import write_joint_log

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.joints.log import JointLog
from pipeline.stages import ingest


def write_table(folder: Path, source: Path, *, speed: bool) -> None:
    """The logs of a movement as one table: degrees, milliseconds, semicolons and decimal commas
    under labels.
    """
    values = read_movement(source, FILES, joints=6, rate=125.0)[0]
    names = [f"{what}_{j}" for what in ("ist", "soll", "v") for j in range(1, 7)]
    lines = [";".join(["Zeit", *names[: 18 if speed else 12]])]
    for row, cells in enumerate(np.rad2deg(np.hstack(values[: 3 if speed else 2])).tolist()):
        lines.append(";".join([str(8 * row), *(f"{cell:.8f}" for cell in cells)]).replace(".", ","))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{source.name}.txt").write_text("\n".join([*lines, ""]))


def signals(*names: str) -> dict[str, list[str]]:
    return {
        {"ist": "actual", "soll": "target", "v": "speed"}[name]: [
            f"{name}_{j}" for j in range(1, 7)
        ]
        for name in names
    }


TABLES = {
    "movements": "*.txt",
    "actual": None,
    "target": None,
    "speed": None,
    "time": "Zeit",
    "angle_unit": "deg",
    "time_unit": "ms",
}


def test_one_table_a_movement_gives_what_one_file_a_signal_does(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, noise=1e-5)
    log_project("ur5_planar", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run("motion")
    names, q = ingested()
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=True)
    log_project(
        "ur5_planar",
        tmp_path / "tables",
        joint_log=MADE_UP | TABLES | {"signals": signals("ist", "soll", "v")},
        motion={"steps": 140},
    )
    ingest.run("motion")
    result = ingested()
    assert result[0] == names
    np.testing.assert_allclose(result[1], q, rtol=0, atol=1e-9)
    assert quality("speed_from_angles", "move") == 0


def test_without_a_speed_the_steps_of_the_commanded_angles_are_it(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, noise=1e-5)
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=False)
    choice = MADE_UP | TABLES | {"signals": signals("ist", "soll"), "rest_speed": 1e-3}
    log_project("ur5_planar", tmp_path / "tables", joint_log=choice, motion={"steps": 140})
    ingest.run("motion")
    names, q = ingested()
    assert names == ["move_1_1", "move_1_2", "move_1_3"] and q.shape == (3, 141, 3)
    assert quality("speed_from_angles", "move") == 1
    np.testing.assert_allclose(
        q[:, [0, -1]], np.array([[HOME, AWAY]])[:, :, 1:4].repeat(3, axis=0), atol=1e-4
    )


def push(folder: Path, way: int, size: float) -> None:
    """Push joint 3 aside by ``size`` (rad) in the middle of the given way out (from 0)."""
    log = read_joint_log(folder / FILES[0], joints=6)
    first = 60 + 320 * way + 30
    log.signals["actual"][first : first + 40, 2] += size * np.sin(np.linspace(0, np.pi, 40))
    write_joint_log(folder / FILES[0], log)


def test_a_disturbed_repetition_is_left_out_and_named_and_the_others_stay_as_they_were(
    log_project, tmp_path, capsys
):
    write_movement(tmp_path / "logs/move_1", 9, noise=5e-5)
    log_project("ur5_planar", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run("motion")
    names, q = ingested()
    assert len(names) == 5 and quality("disturbed_from_row", "move_1") == 0
    push(tmp_path / "logs/move_1", 2, 2e-3)
    ingest.run("motion")
    result = ingested()
    assert result[0] == [name for name in names if name != "move_1_3"]
    np.testing.assert_array_equal(result[1], np.delete(q, 2, axis=0))
    assert quality("disturbed_from_row", "move_1") == 60 + 2 * 320
    assert quality("disturbance", "move_1_3") > 6 > quality("disturbance", "move_1_4")
    assert "disturbed from row 700" in capsys.readouterr().out


def test_a_disturbed_repetition_is_refused_where_the_option_says_so(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 9, noise=5e-5)
    log_project(
        "ur5_planar",
        tmp_path / "logs",
        joint_log=MADE_UP | {"disturbed": "refuse"},
        motion={"steps": 140},
    )
    ingest.run("motion")
    push(tmp_path / "logs/move_1", 2, 2e-3)
    with pytest.raises(RecordingError, match="from row 700 was disturbed") as caught:
        ingest.run("motion")
    assert caught.value.evidence["take"] == "move_1_3"


def test_a_limit_on_the_residual_finds_what_two_repetitions_cannot_show(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, noise=5e-5)
    push(tmp_path / "logs/move_1", 1, 2e-3)
    log_project(
        "ur5_planar",
        tmp_path / "logs",
        joint_log=MADE_UP | {"residual_limit": 1e-3, "disturbed_beyond": 1e9},
        motion={"steps": 140},
    )
    ingest.run("motion")
    assert ingested()[0] == ["move_1_1", "move_1_3"]


def test_a_table_without_the_places_of_its_angles_is_refused(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5)
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=True)
    log_project(
        "ur5_planar",
        tmp_path / "tables",
        joint_log=MADE_UP | TABLES | {"signals": signals("ist")},
        motion={"steps": 140},
    )
    with pytest.raises(ConfigError, match="target angles"):
        ingest.run("motion")


@pytest.mark.parametrize("archive", [False, True])
def test_a_current_that_stands_out_leaves_its_repetition_out_where_it_is_logged(
    log_project, tmp_path, archive
):
    folder = tmp_path / "logs/move_1"
    write_movement(folder, 9, noise=5e-5)
    logs = [read_joint_log(folder / name, joints=6) for name in FILES]
    current = 2 + np.random.default_rng(2).normal(0, 0.1, logs[0].signals["actual"].shape)
    current[60 + 2 * 320 + 30 :][:40, 4] *= 2  # in the third way out, of a joint beside the chain
    write_joint_log(folder / "current.csv", JointLog(logs[0].time, {"actual": current}, {}))
    place, choice = tmp_path / "logs", MADE_UP | {"others": {"current": "current.csv"}}
    if archive:
        place = tmp_path / "archives"
        place.mkdir()
        rows = {name: log.signals["actual"] for name, log in zip("qd", logs, strict=False)}
        np.savez(place / "move_1.npz", time=logs[0].time, i=current, **rows)
        choice |= {"actual": None, "target": None, "speed": None, "time": "time"}
        choice |= {"others": {"current": ["i"]}, "signals": {"actual": ["q"], "target": ["d"]}}
        choice |= {"rest_speed": 1e-3}
    log_project("ur5_planar", place, joint_log=choice, motion={"steps": 140})
    ingest.run("motion")
    assert ingested()[0] == [f"move_1_{n}" for n in (1, 2, 4, 5)]
    assert quality("disturbance", "move_1_3") > 6 > quality("disturbance", "move_1_4")
    assert 0 < quality("smallest_push_found", "move_1") < 2e-3
    # the control: by the angles alone nobody sees it
    log_project("ur5_planar", place, joint_log=choice | {"others": {}}, motion={"steps": 140})
    ingest.run("motion")
    assert len(ingested()[0]) == 5
