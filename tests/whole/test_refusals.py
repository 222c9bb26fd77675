"""Bad input stops the stage that reads it with one message that names the place, and leaves the
earlier results intact.
"""

import json
import shutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf
from project_copy import contents, error_line, make_writable, run

from pipeline.core.errors import PipelineError

pytestmark = pytest.mark.slow

RAW = Path("data/raw/youbot/recordings")


@pytest.fixture(scope="module")
def damaged(reproduced: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the reproduced project, to be damaged and mended by one test after the other."""
    folder = tmp_path_factory.mktemp("refusals") / "project"
    ignored = shutil.ignore_patterns("cache", ".git")
    shutil.copytree(reproduced, folder, symlinks=True, ignore=ignored)
    make_writable(folder)
    return folder


@pytest.fixture
def project(damaged: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The project as the current folder; its data are restored after the test."""
    shutil.copytree(damaged / "data", tmp_path / "data")
    monkeypatch.chdir(damaged)
    yield
    shutil.rmtree(damaged / "data")
    shutil.copytree(tmp_path / "data", damaged / "data")


def without_tests() -> None:
    for file in (RAW / "optitrack").glob("test_*.csv"):
        file.unlink()


def cut_frame() -> None:
    file = RAW / "kinect/test_001/depth/0007.png"
    file.write_bytes(file.read_bytes()[:500])


def option(**values: object) -> Callable[[], None]:
    """Change of options, whose keys have __ for points."""

    def change() -> None:
        config = OmegaConf.load("data/config.yaml")
        for name, value in values.items():
            key = name.replace("__", ".")
            OmegaConf.update(config, f"dataset.{key}", value, merge=False)
        OmegaConf.save(config, "data/config.yaml")

    return change


def cells(
    name: str,
    columns: list[str],
    value: float,
    query: str,
) -> Callable[[], None]:
    """Change of values of a table."""

    def change() -> None:
        rows = pd.read_parquet(f"data/{name}.parquet")
        rows.loc[rows.eval(query), columns] = value
        rows.to_parquet(f"data/{name}.parquet", index=False)

    return change


def parameters(model: str, **values: object) -> Callable[[], None]:
    """Change of the parameters of a fitted model."""
    file = Path(f"data/fit/{model}/parameters.json")
    return lambda: file.write_text(json.dumps(json.loads(file.read_text()) | values))


def gap_without_limit() -> None:
    option(limits__longest_gap=None)()
    # of two links: where one alone is hidden, the others determine the pose
    query = "take == 'train_001' and link >= 2 and 50 <= k <= 90"
    cells("ingest/motion/markers", ["x", "y", "z"], np.nan, query)()


CASES = {  # damage, command of the stage, and words of its message
    "no recordings": (lambda: shutil.rmtree(RAW), "files", str(RAW)),
    "a missing take": (without_tests, "ingest motion", "optitrack/test_*.csv"),
    "a frame that is cut off": (cut_frame, "ingest depth", "0007.png"),
    "depth without motion capture": (
        option(mocap=None), "ingest depth", "dataset.depth", "motion capture"),
    "limits that leave too few takes": (
        option(limits__residual_rms=1e-5), "track", "the limits leave 0 training",
        "train_001 (residual_rms", "dataset.limits.residual_rms"),
    "a limit beyond what is interpolated": (
        option(limits__longest_gap=50), "track", "50", "dataset.limits.longest_gap",
        "dataset.mocap.max_gap"),
    "a long gap where no limit leaves the take out": (
        gap_without_limit, "track", "train_001", "50"),
    # ten thousand times the noise carries every particle beyond the joint limits
    "weights that all vanish": (
        parameters("additive", noise_covariance=(100.0 * np.eye(3)).tolist()),
        "filter additive", "weights vanished", "test_00", "step"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_refused_where_it_is_met_and_the_results_stay(project, case):
    damage, command, *words = CASES[case]
    damage()
    stage, *item = command.split()
    folder = Path("data", stage)
    if stage != "ingest":
        folder = folder.joinpath(*item)
    before = contents(folder)
    with pytest.raises(PipelineError) as caught:
        import_module(f"pipeline.stages.{stage}").run(*item)

    message = str(caught.value)
    assert "\n" not in message and all(word in message for word in words), message
    assert before and contents(folder) == before
    assert not list(Path("data").glob("**/.*.partial"))


def test_check_names_every_refusal_of_ingest_at_once_and_writes_nothing(project):
    sheet = Path("data/raw/youbot/dataset.yaml")
    text = sheet.read_text().replace("link1_a:", "link1_ax:")
    sheet.write_text(text.replace("force/C2.csv", "force/C9.csv"))
    cut_frame()
    before = [contents(Path(name)) for name in ("data", "reports")]
    done = run("python", "-m", "pipeline", "check", cwd=Path.cwd())

    assert error_line(done).startswith("error: check: 3 fault(s): correct"), done.stdout
    for word in ("no marker named link1_ax", "force/C9.csv", "0007.png"):
        assert done.stdout.count(word) == 1, done.stdout
    assert [contents(Path(name)) for name in ("data", "reports")] == before
