"""From the raw logs of a robot that repeats its motions to the tables and the process noise, on real and on made-up logs."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf

from pipeline import config, contracts, datasheet
from pipeline.arm.model import load_arm
from pipeline.errors import ConfigError, RecordingError, SingularJacobianError
from pipeline.instruments.joint_log import JointLog, read_joint_log, read_movement, write_joint_log
from pipeline.perception.repetitions import align, excursions, find_repetitions
from pipeline.stages import ingest, inventory, noise, track

ROOT = Path(__file__).parents[2]
FILES = ("log_q_actual.csv", "log_q_target.csv", "log_qd_target.csv")
FIRST_MOTION = {"start": [-1.5708, -1.5708, 0.0, -1.5708], "end": [-1.5708, -0.1745, 1.0472, -2.6180]}  # joints 1 to 4


@pytest.fixture(scope="session")
def ur5() -> Path:
    folder = ROOT / OmegaConf.load(datasheet.path_of("ur5")).recordings
    if not folder.is_dir():
        pytest.skip(f"the UR5's recordings are not at {folder}")
    return folder.resolve()


@pytest.fixture
def project(tmp_path, monkeypatch):
    """An empty project in which stages can run, and a way to choose its dataset."""
    folder = tmp_path / "project"
    folder.mkdir()
    for name in ("pipeline", "dvc.yaml"):
        (folder / name).symlink_to(ROOT / name)
    monkeypatch.chdir(folder)

    def choose(dataset: str, recordings: Path, **overrides) -> None:
        params = OmegaConf.load(ROOT / "params.yaml")
        params.update({"dataset": dataset, "scale": "smoke", "overrides": {"dataset": {"recordings": str(recordings)} | overrides}})
        OmegaConf.save(params, folder / "params.yaml")
        config.write_config(Path("params.yaml"))

    return choose


def movement(ur5: Path, number: int) -> list[np.ndarray]:
    return read_movement(next(ur5.glob(f"Movement_No{number}_*")), FILES, joints=6, rate=125.0)[0]


def quality(name: str, take: str) -> float:
    table = contracts.read("quality", Path("data/ingest"))
    return table.loc[(table["quantity"] == name) & table["take"].str.contains(take), "value"].sum()


# the real robot


def test_movement_5_is_four_ways_out_and_three_back_and_one_cut_off(ur5):
    _, target, speed = movement(ur5, 5)
    runs = excursions(target, speed)
    assert [(run.first, run.steps) for run in runs if run.whole] == [
        (376, 302), (750, 302), (1124, 302), (1498, 302), (1872, 302), (2247, 302), (2621, 302),
    ]  # fmt: skip
    assert [run.first for run in runs if not run.whole] == [2995]
    ends = np.array([target[run.last, 2] - target[run.first - 1, 2] for run in runs if run.whole])
    assert (ends > 1).sum() == 4 and (ends < -1).sum() == 3


def test_the_first_motion_of_the_four_rounds_is_one_command_in_spite_of_a_row(ur5):
    found = {}
    for number in (6, 7):
        _, target, speed = movement(ur5, number)
        runs = find_repetitions(target, speed, [0, 1, 2, 3], FIRST_MOTION["start"], FIRST_MOTION["end"], steps=633, rest=35)
        found[number] = [(target, run) for run in runs.found]
    assert [len(runs) for runs in found.values()] == [3, 1]
    assert [run.steps for runs in found.values() for _, run in runs] == [633, 633, 633, 632]
    target, run = found[6][0]
    reference = target[run.first : run.first + 634, 1:4]
    for target, run in found[6] + found[7]:
        first = align(target[:, 1:4], run.first, reference)
        assert np.abs(target[first : first + 634, 1:4] - reference).max() < 1.4e-4
    # by its first row, the last take would be 8 mrad off
    assert np.abs(target[run.first : run.first + 634, 1:4] - reference).max() > 5e-3


@pytest.mark.parametrize(("dataset", "takes", "steps", "cut_off", "others"), [("ur5", 4, 372, 1, 3), ("ur5_rounds", 4, 361, 0, 20)])
def test_the_real_logs_go_from_raw_files_to_process_noise(ur5, project, dataset, takes, steps, cut_off, others):
    project(dataset, ur5)
    for stage in (ingest, track, noise):
        stage.run()
    joints, trajectory = contracts.read("joints", Path("data/track")), contracts.read("trajectory", Path("data/ingest"))
    names, q = contracts.stacked(joints, ["q1", "q2", "q3"])
    assert q.shape == (takes, steps + 1, 3) and len(set(names)) == takes and set(joints["part"]) == {"training"}
    assert (quality("excursions_cut_off", "Movement"), quality("excursions_other_motion", "Movement")) == (cut_off, others)
    assert all(0 < quality("command_deviation", take) < 1.3e-4 for take in names)
    assert all(0.3e-3 < quality("lag_behind_command", take) < 1.0e-3 for take in names)
    velocity = trajectory[["vx", "vz", "vphi"]].to_numpy()[:-1]
    still = ~velocity.any(axis=1)
    assert still[:34].all() and still[-35:].all() and not still[34:-35].any()
    pose = trajectory[["x", "z", "phi"]].to_numpy()
    np.testing.assert_allclose(np.diff(pose, axis=0), velocity / 125, atol=1e-12)
    chain = load_arm("pipeline/arm/ur5.urdf", ["joint_2", "joint_3", "joint_4"], "wrist_centre", {}).chain
    np.testing.assert_allclose(chain.pose(q.mean(axis=0)), pose, atol=2e-3)
    _, w = contracts.stacked(contracts.read("process_noise", Path("data/noise")), ["w1", "w2", "w3"])
    varying = (w - w.mean(axis=0)) * np.sqrt(takes / (takes - 1))
    spread = {name: np.sqrt(np.mean(varying[:, rows] ** 2, axis=(0, 1))) for name, rows in (("rest", still), ("moving", ~still))}
    # as was found on this and other movements of the robot: at most 24 µrad at rest, 43 to 145 µrad moving
    assert np.all(spread["rest"] < 24e-6) and np.all(spread["moving"] > 40e-6) and np.all(spread["moving"] < 145e-6)
    # a position-controlled arm does not wander: what one step adds the next takes back
    moving = varying[:, ~still]
    recoil = np.sum(moving[:, 1:] * moving[:, :-1], axis=(0, 1)) / np.sum(moving**2, axis=(0, 1))
    assert np.all(recoil < -0.3)


def test_the_real_repetitions_are_found_without_the_commanded_speeds(ur5, project):
    project("ur5", ur5)
    ingest.run()
    names, q = ingested()
    # the angle creeps and settles at rest by up to 10 mrad/s
    project("ur5", ur5, joint_log={"speed": None, "rest_speed": 1e-2})
    ingest.run()
    found = ingested()
    assert found[0] == names and quality("speed_from_angles", "Movement") == 1
    np.testing.assert_array_equal(found[1][:, :-1], q[:, 1:])


def test_the_process_noise_is_that_of_the_joints_whatever_the_pose(ur5, project):
    """J(q̃)⁻¹ẋᵈΔt is the commanded joint step up to second order, so the noise is what the measured step has beyond it."""
    project("ur5_rounds", ur5)
    for stage in (ingest, track, noise):
        stage.run()
    _, q = contracts.stacked(contracts.read("joints", Path("data/track")), ["q1", "q2", "q3"])
    _, w = contracts.stacked(contracts.read("process_noise", Path("data/noise")), ["w1", "w2", "w3"])
    _, target, speed = movement(ur5, 6)
    run = excursions(target, speed)[3]
    command = target[run.first - 1 : run.last + 1, 1:4]
    rows = slice(34, 34 + len(command))
    direct = np.diff(q[0, rows], axis=0) - np.diff(command, axis=0)
    difference = w[0, 34 : 34 + len(direct)] - direct
    assert np.sqrt(np.mean(difference**2)) < 0.25 * np.sqrt(np.mean(direct**2))


def test_a_motion_from_the_straight_elbow_is_refused_by_name(ur5, project):
    choice = {"movements": "Movement_No[67]_*", "start": FIRST_MOTION["start"][1:], "end": FIRST_MOTION["end"][1:]}
    project("ur5", ur5, joint_log=choice, motion={"steps": 633 + 70})
    ingest.run()
    assert quality("repetitions", "Movement") == 4
    track.run()
    with pytest.raises(SingularJacobianError, match="in line"):
        noise.run()


def test_a_truncated_and_a_malformed_copy_of_a_real_log(ur5, project, tmp_path):
    copied = tmp_path / "ur5"
    shutil.copytree(next(ur5.glob("Movement_No5_*")), copied / "Movement_No5_copy", copy_function=shutil.copyfile)
    copied.chmod(0o755)
    (copied / "Movement_No5_copy").chmod(0o755)
    file = copied / "Movement_No5_copy" / FILES[0]
    content = file.read_bytes()
    file.write_bytes(content[: int(0.75 * len(content))])
    project("ur5", copied)
    ingest.run()
    assert (quality("repetitions", "copy"), quality("cut_rows", "copy"), quality("excursions_cut_off", "copy")) == (3, 2, 1)
    damaged = content.replace(b"-2.135030", b"-2.13503O", 1)
    file.write_bytes(damaged)
    with pytest.raises(RecordingError, match="not a finite number") as caught:
        ingest.run()
    assert caught.value.evidence["line"] == 1
    lines = content.split(b"\n")
    file.write_bytes(b"\n".join(lines[:100] + lines[101:]))
    with pytest.raises(RecordingError, match="samples are missing"):
        ingest.run()


# a made-up robot, of which everything is known


HOME, AWAY = np.array([1.0, -2.1, -1.9, -0.4, 0.5, 0.0]), np.array([0.8, -3.0, -0.3, -1.5, 0.4, 0.1])


def write_movement(folder: Path, ways: int, *, late: float = 0.0, offset: float = 0.0, noise: float = 0.0, seed: int = 0) -> None:
    """Logs of ``ways`` out and back of 100 steps with 60 rows at rest between; measured angles ``late`` s behind the commanded ones."""
    rng = np.random.default_rng(seed)
    rows = np.arange(60 + 160 * ways)

    def progress(t: np.ndarray) -> np.ndarray:
        way, since = np.divmod(np.clip(t - 60 + 1, 0, None), 160)
        share = (1 - np.cos(np.pi * np.clip(since / 101, 0, 1))) / 2
        return np.where(way % 2 == 0, share, 1 - share)

    target = HOME + offset + progress(rows)[:, None] * (AWAY - HOME)
    speed = np.gradient(target, axis=0) * 125
    since = (rows - 60) % 160
    speed[(rows < 60) | (since >= 100)] = 0.0
    actual = HOME + offset + progress(rows - late * 125)[:, None] * (AWAY - HOME) + rng.normal(0, noise, target.shape)
    folder.mkdir(parents=True)
    for name, values in zip(FILES, (actual, target, speed), strict=True):
        write_joint_log(folder / name, JointLog(rows / 125, values, {}))


MADE_UP = {"movements": "move_*", "start": HOME[1:4].tolist(), "end": AWAY[1:4].tolist(), "rest": 20}


def test_repetitions_are_gathered_over_movements_and_their_mean_command_is_the_trajectory(project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, offset=1e-4, noise=1e-5)
    write_movement(tmp_path / "logs/move_2", 1, late=8e-4, offset=-1e-4, noise=1e-5, seed=1)
    project("ur5", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run()
    names, q = contracts.stacked(contracts.read("joint_log", Path("data/ingest")), ["q1", "q2", "q3"])
    assert names == ["move_1_1", "move_1_2", "move_1_3", "move_2_1"] and q.shape == (4, 141, 3)
    # three takes 0.1 mrad above and one as much below: 0.05 and 0.15 mrad off their mean
    np.testing.assert_allclose([quality("command_deviation", name) for name in names], [5e-5, 5e-5, 5e-5, 1.5e-4], atol=1e-6)
    np.testing.assert_allclose(np.mean([quality("lag_behind_command", name) for name in names]), 8e-4, atol=2e-5)
    trajectory = contracts.read("trajectory", Path("data/ingest"))
    chain = load_arm("pipeline/arm/ur5.urdf", ["joint_2", "joint_3", "joint_4"], "wrist_centre", {}).chain
    ends = chain.pose(np.array([HOME, AWAY])[:, 1:4] + 5e-5)
    np.testing.assert_allclose(trajectory.loc[[0, 140], ["x", "z", "phi"]].to_numpy(), ends, atol=2e-6)


@pytest.mark.parametrize(
    ("choice", "steps", "words"),
    [
        ({"movements": "run_*"}, 140, "no folder"),
        ({"end": [0.0, 0.0, 0.0]}, 140, r"0 repetition.*-2.1, -1.9, -0.4\] to \[-3.0, -0.3, -1.5\] in 100 steps"),
        ({}, 200, "0 repetition.*in 100 steps"),
        ({"rest": 58}, 216, "0 repetition"),
        ({"movements": "move_2"}, 140, "1 repetition"),
        ({"tolerance": 1e-4}, 140, "another motion"),
    ],
)
def test_too_few_or_unequal_repetitions_are_refused_with_what_there_is(project, tmp_path, choice, steps, words):
    write_movement(tmp_path / "logs/move_1", 5, offset=1e-4)
    write_movement(tmp_path / "logs/move_2", 1, offset=-1e-4)
    project("ur5", tmp_path / "logs", joint_log=MADE_UP | choice, motion={"steps": steps})
    with pytest.raises(RecordingError, match=words):
        ingest.run()
    assert not Path("data/ingest").exists()


def test_recordings_that_are_not_there_are_refused_by_their_folder(project, tmp_path):
    project("ur5", tmp_path / "nowhere")
    for run in (ingest.run, lambda: inventory.run(str(tmp_path / "nowhere"))):
        with pytest.raises(RecordingError, match="exist") as caught:
            run()
        assert caught.value.evidence["file"] == tmp_path / "nowhere"


@pytest.mark.parametrize("choice", [{"columns": [2, 3]}, {"columns": [2, 3, 7]}, {"rest": 0}, {"start": [0.0]}])
def test_options_that_name_no_chain_are_refused(project, tmp_path, choice):
    with pytest.raises(ConfigError, match="columns"):
        project("ur5", tmp_path, joint_log=choice)


def test_the_inventory_tells_changed_recordings_apart(tmp_path, capsys):
    write_movement(tmp_path / "logs/move_1", 1)
    tables = []
    for byte in (b"", b" "):
        with (tmp_path / "logs/move_1" / FILES[0]).open("ab") as file:
            file.write(byte)
        inventory.run(str(tmp_path / "logs"))
        (tmp_path / "inventory.csv").write_text(capsys.readouterr().out)
        tables.append(pd.read_csv(tmp_path / "inventory.csv", index_col="file"))
    before, after = tables
    assert list(before.index) == [f"move_1/{name}" for name in FILES]
    assert list(before.index[(before != after).any(axis=1)]) == [f"move_1/{FILES[0]}"]
    assert (after["bytes"] - before["bytes"]).tolist() == [1, 0, 0]


# the same robot with logs of another form, and with repetitions that were disturbed


def write_table(folder: Path, source: Path, *, speed: bool) -> None:
    """The logs of a movement as one table: degrees, milliseconds, semicolons and decimal commas under labels."""
    values = read_movement(source, FILES, joints=6, rate=125.0)[0]
    names = [f"{what}_{j}" for what in ("ist", "soll", "v") for j in range(1, 7)]
    lines = [";".join(["Zeit", *names[: 18 if speed else 12]])]
    for row, cells in enumerate(np.rad2deg(np.hstack(values[: 3 if speed else 2])).tolist()):
        lines.append(";".join([str(8 * row), *(f"{cell:.8f}" for cell in cells)]).replace(".", ","))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{source.name}.txt").write_text("\n".join([*lines, ""]))


def signals(*names: str) -> dict[str, list[str]]:
    return {{"ist": "actual", "soll": "target", "v": "speed"}[name]: [f"{name}_{j}" for j in range(1, 7)] for name in names}


TABLES = {
    "movements": "*.txt", "actual": None, "target": None, "speed": None, "time": "Zeit", "angle_unit": "deg", "time_unit": "ms",
}  # fmt: skip


def ingested() -> tuple[list[str], np.ndarray]:
    return contracts.stacked(contracts.read("joint_log", Path("data/ingest")), ["q1", "q2", "q3"])


def test_one_table_a_movement_gives_what_one_file_a_signal_does(project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, noise=1e-5)
    project("ur5", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run()
    names, q = ingested()
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=True)
    project("ur5", tmp_path / "tables", joint_log=MADE_UP | TABLES | {"signals": signals("ist", "soll", "v")}, motion={"steps": 140})
    ingest.run()
    found = ingested()
    assert found[0] == names
    np.testing.assert_allclose(found[1], q, rtol=0, atol=1e-9)
    assert quality("speed_from_angles", "move") == 0


def test_without_a_speed_the_steps_of_the_commanded_angles_are_it(project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, noise=1e-5)
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=False)
    choice = MADE_UP | TABLES | {"signals": signals("ist", "soll"), "rest_speed": 1e-3}
    project("ur5", tmp_path / "tables", joint_log=choice, motion={"steps": 140})
    ingest.run()
    names, q = ingested()
    assert names == ["move_1_1", "move_1_2", "move_1_3"] and q.shape == (3, 141, 3)
    assert quality("speed_from_angles", "move") == 1
    np.testing.assert_allclose(q[:, [0, -1]], np.array([[HOME, AWAY]])[:, :, 1:4].repeat(3, axis=0), atol=1e-4)


def push(folder: Path, way: int, size: float) -> None:
    """Push joint 3 aside by ``size`` (rad) in the middle of the given way out (from 0)."""
    log = read_joint_log(folder / FILES[0], joints=6)
    first = 60 + 320 * way + 30
    log.values[first : first + 40, 2] += size * np.sin(np.linspace(0, np.pi, 40))
    write_joint_log(folder / FILES[0], log)


def test_a_disturbed_repetition_is_left_out_and_named_and_the_others_stay_as_they_were(project, tmp_path, capsys):
    write_movement(tmp_path / "logs/move_1", 9, noise=5e-5)
    project("ur5", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run()
    names, q = ingested()
    assert len(names) == 5 and quality("disturbed_from_row", "move_1") == 0
    push(tmp_path / "logs/move_1", 2, 2e-3)
    ingest.run()
    found = ingested()
    assert found[0] == [name for name in names if name != "move_1_3"]
    np.testing.assert_array_equal(found[1], np.delete(q, 2, axis=0))
    assert quality("disturbed_from_row", "move_1") == 60 + 2 * 320
    assert quality("disturbance", "move_1_3") > 6 > quality("disturbance", "move_1_4")
    assert "disturbed from row 700" in capsys.readouterr().out


def test_a_disturbed_repetition_is_refused_where_the_option_says_so(project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 9, noise=5e-5)
    project("ur5", tmp_path / "logs", joint_log=MADE_UP | {"disturbed": "refuse"}, motion={"steps": 140})
    ingest.run()
    push(tmp_path / "logs/move_1", 2, 2e-3)
    with pytest.raises(RecordingError, match="from row 700 was disturbed") as caught:
        ingest.run()
    assert caught.value.evidence["take"] == "move_1_3"


def test_a_limit_on_the_residual_finds_what_two_repetitions_cannot_show(project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, noise=5e-5)
    push(tmp_path / "logs/move_1", 1, 2e-3)
    project("ur5", tmp_path / "logs", joint_log=MADE_UP | {"residual_limit": 1e-3, "disturbed_beyond": 1e9}, motion={"steps": 140})
    ingest.run()
    assert ingested()[0] == ["move_1_1", "move_1_3"]


@pytest.mark.parametrize(
    "choice",
    [
        {"signals": {"actual": ["a"]}}, {"signals": {"force": list(range(6))}}, {"angle_unit": "grad"}, {"time_unit": "min"},
        {"disturbed": "keep"},
    ],
)  # fmt: skip
def test_options_of_logs_that_mean_nothing_are_refused(project, tmp_path, choice):
    with pytest.raises(ConfigError, match=r"dataset\.joint_log"):
        project("ur5", tmp_path, joint_log=choice)


def test_a_table_without_the_places_of_its_angles_is_refused(project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5)
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=True)
    project("ur5", tmp_path / "tables", joint_log=MADE_UP | TABLES | {"signals": signals("ist")}, motion={"steps": 140})
    with pytest.raises(ConfigError, match="target angles"):
        ingest.run()
