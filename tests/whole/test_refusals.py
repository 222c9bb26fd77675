"""Bad input stops the stage that meets it with one message that says where, and leaves what stood
before intact.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf
from project_copy import run

from pipeline.core.errors import PipelineError
from pipeline.recordings.quality import quality_row

pytestmark = pytest.mark.slow

RAW = Path("data/raw/youbot/recordings")


@pytest.fixture
def project(reproduced: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A reproduced project to damage, as the current folder."""
    folder = tmp_path / "project"
    shutil.copytree(
        reproduced, folder, symlinks=True, ignore=shutil.ignore_patterns("cache", ".git")
    )
    for file in folder.rglob("*"):  # what DVC linked from its cache is read-only
        if file.is_file():
            file.chmod(0o644)
    monkeypatch.chdir(folder)
    return folder


def contents(folder: Path) -> dict[str, str]:
    return {
        str(file): hashlib.md5(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


def refuses(stage: str, *says: str, item: str | None = None, out: str | None = None) -> str:
    """Run the stage, which must refuse and say all of ``says``; its folder must be as it was and
    nothing half-written left.
    """
    folder = Path("data") / (out or stage)
    before = contents(folder)
    with pytest.raises(PipelineError) as caught:
        import_module(f"pipeline.stages.{stage}").run(*([item] if item else []))
    message = str(caught.value)
    assert "\n" not in message
    for word in says:
        assert word in message, message
    assert before and contents(folder) == before
    assert not list(Path("data").glob("**/.*.partial"))
    return message


refuses_motion, refuses_depth, refuses_force = (
    partial(refuses, "ingest", item=part) for part in ("motion", "depth", "force")
)


def test_a_missing_take(project):
    for file in (RAW / "optitrack").glob("test_*.csv"):
        file.unlink()
    refuses_motion("test", "optitrack/test_*.csv")


def test_a_truncated_take(project):
    file = RAW / "optitrack/train_003.csv"
    file.write_bytes(file.read_bytes()[:-40])
    refuses_motion("train_003.csv")


def test_a_take_with_a_header_and_no_data(project):
    file = RAW / "optitrack/train_002.csv"
    file.write_bytes(b"\r\n".join(file.read_bytes().split(b"\r\n")[:7]) + b"\r\n")
    refuses_motion("train_002.csv")


def test_a_take_of_the_wrong_length(project):
    file = RAW / "optitrack/train_001.csv"
    file.write_bytes(b"\r\n".join(file.read_bytes().split(b"\r\n")[:-20]) + b"\r\n")
    refuses_motion("train_001.csv", "321")


def test_a_value_in_a_take_that_is_no_number(project):
    file = RAW / "optitrack/train_001.csv"
    lines = file.read_text().splitlines(keepends=True)
    cells = lines[30].split(",")
    cells[4] = "inf"
    lines[30] = ",".join(cells)
    file.write_text("".join(lines), newline="")
    refuses_motion("train_001.csv", "31")


def test_a_depth_frame_that_is_no_image(project):
    (RAW / "kinect/test_002/depth/0004.png").write_text("not an image")
    refuses_depth("0004.png")


def test_a_depth_frame_that_is_cut_off(project):
    file = RAW / "kinect/test_001/depth/0007.png"
    file.write_bytes(file.read_bytes()[:500])
    refuses_depth("0007.png")


def test_a_missing_depth_frame(project):
    (RAW / "kinect/test_001/depth/0005.png").unlink()
    refuses_depth("0005.png")


def test_a_trajectory_with_a_value_that_is_not_finite(project):
    lines = (RAW / "trajectory.csv").read_text().splitlines()
    lines[12] = ",".join(["nan", *lines[12].split(",")[1:]])
    (RAW / "trajectory.csv").write_text("\n".join(lines) + "\n")
    refuses_motion("trajectory.csv", "13")


def test_a_force_log_without_its_header(project):
    file = RAW / "force/C2.csv"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[1:]))
    refuses_force("C2.csv")


def test_recordings_that_do_not_exist(project):
    shutil.rmtree(RAW)
    refuses("files", str(RAW))


def set_option(key: str, value: object) -> None:
    file = Path("data/config.yaml")
    config = OmegaConf.load(file)
    OmegaConf.update(config, key, value, merge=False)
    OmegaConf.save(config, file)


def test_a_singular_jacobian_on_the_way(project):
    # of joint angles that the robot's controller logged, in place of the motion capture's
    joints = pd.read_parquet("data/track/joints.parquet").drop(columns="residual")
    straight = -np.radians(146.0)  # the first two links of the youBot in line
    joints.loc[(joints["take"] == "train_004") & (joints["k"] == 100), "q:arm_joint_3"] = straight
    joints.to_parquet("data/ingest/motion/joint_log.parquet", index=False)
    lag = [
        quality_row(take, "training", "joint log", "lag_behind_command", 0.0, "s")
        for take in joints["take"].unique()
    ]
    pd.DataFrame(lag).to_parquet("data/ingest/motion/quality.parquet", index=False)
    names = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
    log = {"movements": "*", "joints": names, "rest": 1, "tolerance": 1.0}
    set_option("dataset.joint_log", log | {"start": [0.0] * 3, "end": [0.0] * 3})
    for instrument in ("mocap", "depth"):
        set_option(f"dataset.{instrument}", None)
    refuses("track", "singular", "train_004", "step 100")


def test_limits_that_leave_too_few_takes(project):
    set_option("dataset.limits.residual_rms", 1e-5)
    refuses(
        "track",
        "the limits leave 0 training",
        "train_001 (residual_rms",
        "dataset.limits.residual_rms",
    )


def test_a_limit_on_gaps_beyond_what_is_interpolated(project):
    set_option("dataset.limits.longest_gap", 50)
    refuses("track", "50", "dataset.limits.longest_gap", "dataset.mocap.max_gap")


def test_a_gap_in_the_markers_that_is_too_long_where_no_limit_leaves_the_take_out(project):
    set_option("dataset.limits.longest_gap", None)
    file = Path("data/ingest/motion/markers.parquet")
    markers = pd.read_parquet(file)
    markers.loc[
        (markers["take"] == "train_001") & (markers["link"] == 2) & markers["k"].between(50, 90),
        ["x", "y", "z"],
    ] = np.nan
    markers.to_parquet(file, index=False)
    refuses("track", "train_001", "50")


def damage_parameters(model: str, **values: object) -> None:
    file = Path(f"data/fit/{model}/parameters.json")
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


def test_a_bound_below_the_norm_of_the_inverse_jacobian_clips_the_noise_and_is_counted(project):
    metrics = Path("data/filter/gaussian/filter.json")
    before = json.loads(metrics.read_text())["particle_steps_with_clipped_noise"]
    damage_parameters("gaussian", u=5.0)
    import_module("pipeline.stages.filter").run("gaussian")
    posterior = pd.read_parquet("data/filter/gaussian/posterior.parquet")
    moving = posterior["k"] > 0
    # every particle of every step, as ‖J⁻¹‖ of this arm is nowhere as small
    assert posterior.loc[moving, "clipped"].min() > 0 == before
    counted = json.loads(metrics.read_text())["particle_steps_with_clipped_noise"]
    assert counted == posterior["clipped"].sum()


def test_a_dispersion_out_of_its_range(project):
    damage_parameters("wishart", sigma_b=2.0)
    refuses("filter", "sigma_B", item="wishart", out="filter/wishart")


def test_a_filter_whose_weights_all_vanish(project):
    # a thousand times the noise carries every particle beyond the joint limits
    covariance = json.loads(Path("data/fit/additive/parameters.json").read_text())[
        "noise_covariance"
    ]
    damage_parameters("additive", noise_covariance=(np.array(covariance) * 1e8).tolist())
    refuses("filter", "weights vanished", "test_00", "step", item="additive", out="filter/additive")


def test_a_table_that_breaks_its_contract(project):
    file = Path("data/track/process_noise.parquet")
    noise = pd.read_parquet(file)
    noise.loc[7, "w:arm_joint_3"] = np.inf
    noise.to_parquet(file, index=False)
    refuses("fit", "process_noise", "w:arm_joint_3", item="additive", out="fit/additive")


def test_the_command_prints_one_line_and_exits_with_an_error(project):
    (RAW / "kinect/test_002/depth/0004.png").write_text("not an image")
    done = run("python", "-m", "pipeline", "ingest", "depth", cwd=project)
    assert done.returncode == 1
    assert [line for line in done.stderr.splitlines() if line.startswith("error: ingest: ")]
    assert "Traceback" not in done.stderr


def test_check_names_every_refusal_of_ingest_at_once_and_writes_nothing(project):
    sheet = project / "data/raw/youbot/dataset.yaml"
    text = sheet.read_text()
    sheet.write_text(text.replace("link1_a:", "link1_ax:").replace("force/C2.csv", "force/C9.csv"))
    (RAW / "kinect/test_002/depth/0004.png").write_text("not an image")
    before = contents(project)
    done = run("python", "-m", "pipeline", "check", cwd=project)
    assert done.returncode == 1 and "error: check: 3 to be mended" in done.stderr, done.stdout
    for word in ("no marker named link1_ax", "force/C9.csv", "0004.png"):
        assert done.stdout.count(word) == 1, done.stdout
    assert {**before} == contents(project)


def test_a_depth_camera_without_the_motion_capture_that_sets_its_clock(project):
    set_option("dataset.mocap", None)
    refuses_depth("dataset.depth", "motion capture")
