"""Bad input stops the stage that meets it with one message that says where, and leaves the earlier
results intact.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf
from project_copy import error_line, run

from pipeline.core.errors import PipelineError
from pipeline.recordings.quality import quality_row

pytestmark = pytest.mark.slow

RAW = Path("data/raw/youbot/recordings")
FRAME = RAW / "kinect/test_002/depth/0004.png"


@pytest.fixture(scope="module")
def damaged(reproduced: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the reproduced project, to be damaged and mended by one test after the other."""
    folder = tmp_path_factory.mktemp("refusals") / "project"
    ignored = shutil.ignore_patterns("cache", ".git")
    shutil.copytree(reproduced, folder, symlinks=True, ignore=ignored)
    for file in folder.rglob("*"):  # what DVC linked from its cache is read-only
        if file.is_file() and not file.is_symlink():
            file.chmod(0o644)
    return folder


@pytest.fixture
def project(damaged: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The project as the current folder; its data are restored after the test."""
    shutil.copytree(damaged / "data", tmp_path / "data")
    monkeypatch.chdir(damaged)
    yield damaged
    shutil.rmtree(damaged / "data")
    shutil.copytree(tmp_path / "data", damaged / "data")


def contents(folder: Path) -> dict[str, str]:
    return {
        str(file): hashlib.md5(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


def refuses(command: str, *says: str) -> None:
    """Run the stage, which must refuse and say all of ``says``; its folder must be as it was and
    nothing half-written left.
    """
    stage, *item = command.split()
    folder = Path("data") / (stage if stage == "ingest" else command.replace(" ", "/"))
    before = contents(folder)
    with pytest.raises(PipelineError) as caught:
        import_module(f"pipeline.stages.{stage}").run(*item)
    message = str(caught.value)
    assert "\n" not in message and all(word in message for word in says), message
    assert before and contents(folder) == before
    assert not list(Path("data").glob("**/.*.partial"))


def bytes_of(name: str, change: Callable[[bytes], bytes]) -> Callable[[], None]:
    """Damage that changes the content of a recording."""
    file = RAW / name
    return lambda: file.write_bytes(change(file.read_bytes()))


def cell(row: int, place: int, text: bytes) -> Callable[[bytes], bytes]:
    """Change of one cell of a table."""

    def change(content: bytes) -> bytes:
        lines = content.split(b"\n")
        cells = lines[row].split(b",")
        lines[row] = b",".join([*cells[:place], text, *cells[place + 1 :]])
        return b"\n".join(lines)

    return change


def without_tests() -> None:
    for file in (RAW / "optitrack").glob("test_*.csv"):
        file.unlink()


def option(**values: object) -> Callable[[], None]:
    """Change of options, whose keys have __ for points."""

    def change() -> None:
        config = OmegaConf.load("data/config.yaml")
        for key, value in values.items():
            OmegaConf.update(config, f"dataset.{key.replace('__', '.')}", value, merge=False)
        OmegaConf.save(config, "data/config.yaml")

    return change


def table(name: str, change: Callable[[pd.DataFrame], object]) -> Callable[[], None]:
    """Damage to a table in place."""

    def damage() -> None:
        rows = pd.read_parquet(f"data/{name}.parquet")
        change(rows)
        rows.to_parquet(f"data/{name}.parquet", index=False)

    return damage


def set_rows(column: str, value: float, query: str) -> Callable[[pd.DataFrame], None]:
    def change(rows: pd.DataFrame) -> None:
        rows.loc[rows.eval(query), column] = value

    return change


def parameters(model: str, **values: object) -> Callable[[], None]:
    """Change of the parameters of a fitted model."""
    file = Path(f"data/fit/{model}/parameters.json")
    return lambda: file.write_text(json.dumps(json.loads(file.read_text()) | values))


# of two links: where one alone is hidden, the others determine the pose
GAP = "take == 'train_001' and link >= 2 and 50 <= k <= 90"
CASES = {  # damage, command of the stage, and words of its message
    "a missing take": (without_tests, "ingest motion", "optitrack/test_*.csv"),
    "a truncated take": (
        bytes_of("optitrack/train_003.csv", lambda b: b[:-40]), "ingest motion", "train_003.csv"),
    "a value that is no number": (
        bytes_of("optitrack/train_001.csv", cell(30, 4, b"inf")),
        "ingest motion", "train_001.csv", "31"),
    "a frame that is cut off": (
        bytes_of("kinect/test_001/depth/0007.png", lambda b: b[:500]), "ingest depth", "0007.png"),
    "a missing frame": (
        (RAW / "kinect/test_001/depth/0005.png").unlink, "ingest depth", "0005.png"),
    "no recordings": (lambda: shutil.rmtree(RAW), "files", str(RAW)),
    "depth without motion capture": (
        option(mocap=None), "ingest depth", "dataset.depth", "motion capture"),
    "limits that leave too few takes": (
        option(limits__residual_rms=1e-5), "track", "the limits leave 0 training",
        "train_001 (residual_rms", "dataset.limits.residual_rms"),
    "a limit beyond what is interpolated": (
        option(limits__longest_gap=50), "track", "50", "dataset.limits.longest_gap",
        "dataset.mocap.max_gap"),
    "a long gap where no limit leaves the take out": (
        lambda: (option(limits__longest_gap=None)(), *(
            table("ingest/motion/markers", set_rows(axis, np.nan, GAP))() for axis in "xyz")),
        "track", "train_001", "50"),
    "a table that breaks its contract": (
        table("track/process_noise", set_rows("w:arm_joint_3", np.inf, "index == 7")),
        "fit additive", "process_noise", "w:arm_joint_3"),
    "a dispersion out of its range": (
        parameters("wishart", sigma_b=2.0), "filter wishart", "sigma_B"),
    # ten thousand times the noise carries every particle beyond the joint limits
    "weights that all vanish": (
        parameters("additive", noise_covariance=(100.0 * np.eye(3)).tolist()),
        "filter additive", "weights vanished", "test_00", "step"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_refused_where_it_is_met(project, case):
    damage, command, *says = CASES[case]
    damage()
    refuses(command, *says)


def test_a_singular_jacobian_on_the_way(project):
    # of joint angles that the robot's controller logged, in place of the motion capture's
    joints = pd.read_parquet("data/track/joints.parquet").drop(columns="residual")
    straight = -np.radians(146.0)  # the first two links of the youBot in line
    joints.loc[joints.eval("take == 'train_004' and k == 100"), "q:arm_joint_3"] = straight
    joints.to_parquet("data/ingest/motion/joint_log.parquet", index=False)
    lag = [
        quality_row(take, "training", "joint log", "lag_behind_command", 0.0, "s")
        for take in joints["take"].unique()
    ]
    pd.DataFrame(lag).to_parquet("data/ingest/motion/quality.parquet", index=False)
    names = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
    log = {"movements": "*", "joints": names, "rest": 1, "tolerance": 1.0}
    option(joint_log=log | {"start": [0.0] * 3, "end": [0.0] * 3}, mocap=None, depth=None)()
    refuses("track", "singular", "train_004", "step 100")


def test_a_bound_below_the_norm_of_the_inverse_jacobian_clips_the_noise_and_is_counted(project):
    metrics = Path("data/filter/gaussian/filter.json")
    before = json.loads(metrics.read_text())["particle_steps_with_clipped_noise"]
    parameters("gaussian", u=5.0)()
    import_module("pipeline.stages.filter").run("gaussian")
    posterior = pd.read_parquet("data/filter/gaussian/posterior.parquet")
    # every particle of every step, as ‖J⁻¹‖ of this arm is nowhere as small
    assert posterior.loc[posterior["k"] > 0, "clipped"].min() > 0 == before
    counted = json.loads(metrics.read_text())["particle_steps_with_clipped_noise"]
    assert counted == posterior["clipped"].sum()


def test_check_names_every_refusal_of_ingest_at_once_and_writes_nothing(project):
    sheet = project / "data/raw/youbot/dataset.yaml"
    text = sheet.read_text()
    sheet.write_text(text.replace("link1_a:", "link1_ax:").replace("force/C2.csv", "force/C9.csv"))
    FRAME.write_text("not an image")
    # the command prints one line and exits with an error
    assert "0004.png" in error_line(run("python", "-m", "pipeline", "ingest", "depth", cwd=project))
    before = contents(project / "data") | contents(project / "reports")
    done = run("python", "-m", "pipeline", "check", cwd=project)
    assert error_line(done).startswith("error: check: 3 to be mended"), done.stdout
    for word in ("no marker named link1_ax", "force/C9.csv", "0004.png"):
        assert done.stdout.count(word) == 1, done.stdout
    assert contents(project / "data") | contents(project / "reports") == before
