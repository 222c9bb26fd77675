"""A new dataset of an arm in space: rigid bodies follow its links, and a controller's logs stand
beside them.
"""

from __future__ import annotations

from motive_files import START, random_take
from omegaconf import OmegaConf

from pipeline.core import config, datasheet
from pipeline.formats.motion.motive import write_motive
from pipeline.tools.new_dataset.command import run


def written(name: str) -> tuple[dict, dict]:
    """Datasheet and option file, as plain data."""
    files = (datasheet.path_of(name), config.CONF / f"dataset/{name}.yaml")
    return tuple(OmegaConf.to_container(OmegaConf.load(file)) for file in files)


def test_rigid_bodies_follow_an_arm_in_space_and_logs_named_as_takes_are_its_encoders(
    root, space_exports
):
    run(["space", "--from", str(space_exports)])
    sheet, option = written("space")
    (body,) = random_take(9).bodies
    assert sheet["mocap"]["bodies"] == {
        body: {"name": body, "mount": {"position": "???", "rpy": "???"}}
    }
    assert sheet["mocap"]["markers"] == {body: "???"}
    assert (sheet["encoders"]["time"], sheet["encoders"]["actual"]) == (
        "time",
        ["measured_a", "measured_b"],
    )
    assert "one of logs/hold_*.csv, logs/move_*.csv" in datasheet.path_of("space").read_text()
    assert option["measurement"] == "encoders" and len(option["robot"]["joints"]) == 7
    assert "plane" not in option["robot"] and "joint_log" not in option
    # control: a log of another name is a table of something else, and markers are a planar arm's
    for log in (space_exports / "logs").iterdir():
        log.rename(log.with_stem(f"other_{log.stem}"))
    for name in ("move_1", "move_2", "hold_1"):
        write_motive(space_exports / f"mocap/{name}.csv", random_take(9, body=False), start=START)
    run(["plane", "--from", str(space_exports)])
    sheet, option = written("plane")
    assert "encoders" not in sheet and "bodies" not in sheet["mocap"]
    assert option["robot"]["plane"] and "measurement" not in option
