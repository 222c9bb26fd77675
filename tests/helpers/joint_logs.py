"""Recordings of a robot that repeats its motions, as tests of several stages read them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf
from written_logs import write_joint_log

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.formats.joints.log import JointLog

ROOT = Path(__file__).parents[2]
FILES = ("log_q_actual.csv", "log_q_target.csv", "log_qd_target.csv")


def quality(name: str, take: str) -> float:
    """Sum of a measure of quality over the takes whose names hold ``take``, as ingest wrote it."""
    table = contracts.read("quality", Path("data/ingest/motion"))
    of_takes = table["take"].str.contains(take)
    return table.loc[of_takes & (table["quantity"] == name), "value"].sum()


def ingested() -> tuple[list[str], np.ndarray]:
    """Takes and joint angles (N, K, 3) in rad that ingest wrote."""
    table = contracts.read("joint_log", Path("data/ingest/motion"))
    return contracts.stacked(table, "q")


HOME = np.array([1.0, -2.1, -1.9, -0.4, 0.5, 0.0])
AWAY = np.array([0.8, -3.0, -0.3, -1.5, 0.4, 0.1])


def write_movement(
    folder: Path,
    ways: int,
    *,
    late=0.0,
    offset=0.0,
    noise: float = 0.0,
    seed: int = 0,
) -> None:
    """Logs of ``ways`` out and back of 100 steps with 60 rows at rest between; measured angles
    ``late`` s behind the commanded ones.
    """
    # 1/s; rows
    rate = 125
    rest = 60
    period = 160
    rows = np.arange(rest + period * ways)

    def angles_at(t: np.ndarray) -> np.ndarray:
        """(N, 6) rad at the rows ``t``."""
        way, since = np.divmod(np.clip(t - rest + 1, 0, None), period)
        phase = np.pi * np.clip(since / 101, 0, 1)
        share = (1 - np.cos(phase)) / 2
        progress = np.where(way % 2 == 0, share, 1 - share)
        return HOME + offset + progress[:, None] * (AWAY - HOME)

    target = angles_at(rows)
    speed = np.gradient(target, axis=0) * rate
    resting = (rows < rest) | ((rows - rest) % period >= 100)
    speed[resting] = 0.0
    errors = np.random.default_rng(seed).normal(0, noise, target.shape)
    actual = angles_at(rows - late * rate) + errors

    folder.mkdir(parents=True)
    for name, values in zip(FILES, (actual, target, speed), strict=True):
        write_joint_log(folder / name, JointLog(rows / rate, {"actual": values}, {}))


def there_and_back(
    start: np.ndarray,
    end: np.ndarray,
    *,
    rest: int,
    times: int,
) -> np.ndarray:
    """Commanded angles (N, n) in rad that go there and back in 80 rows each, ``times`` times, with
    ``rest`` rows between.
    """
    phase = np.pi * np.arange(1, 81) / 80
    share = (1 - np.cos(phase)) / 2
    stroke = np.outer(share, end - start)
    at_start = np.tile(start, (rest, 1))
    at_end = np.tile(end, (rest, 1))
    cycle = [start + stroke, at_end, end - stroke, at_start]
    return np.vstack([at_start, *cycle * times])


ENDS = {"start": HOME[1:4].tolist(), "end": AWAY[1:4].tolist()}
MADE_UP = {"movements": "move_*", **ENDS, "rest": 20}  # section joint_log


@pytest.fixture
def log_project(tmp_path, monkeypatch) -> Callable[..., None]:
    """An empty project in which stages can run, and a way to choose its dataset."""
    folder = tmp_path / "project"
    folder.mkdir()
    for name in ("pipeline", "dvc.yaml"):
        (folder / name).symlink_to(ROOT / name)
    monkeypatch.chdir(folder)

    def chosen(dataset: str, recordings: Path, **overrides) -> None:
        params = OmegaConf.load(ROOT / "params.yaml")
        overrides = {"dataset": {"recordings": str(recordings)} | overrides}
        params.update({"dataset": dataset, "scale": "smoke", "overrides": overrides})
        OmegaConf.save(params, folder / "params.yaml")
        config.write_config(Path("params.yaml"))

    return chosen
