"""The joint angles of a new recording by the dataset's own formats, and of the takes that it is
held against.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from pipeline.core import contracts
from pipeline.core.errors import RecordingError
from pipeline.models.closed_loop import MeanPath
from pipeline.models.exported import ExportedModel
from pipeline.models.model import Commands
from pipeline.perception.markers import follower
from pipeline.recordings.commands import commanded_steps
from pipeline.recordings.joint_logs import find_takes
from pipeline.recordings.motion_capture import marker_rows
from pipeline.recordings.repetitions import align, in_phase, stretch

MOTION, TRACK = Path("data/ingest/motion"), Path("data/track")
# takes that were not fitted from which on they are the reference alone
ENOUGH = 20


@dataclass(frozen=True)
class OwnTakes:
    """The dataset's takes that a new one is held against: those that were not fitted where there
    are enough of them, else all.
    """

    names: Sequence[str]
    poses: np.ndarray  # (N, M+1, n) rad
    fitted: np.ndarray  # (N,) whether the model was fitted to it
    mean: np.ndarray  # (M+1, n) rad, of the takes that were fitted


def own_takes() -> OwnTakes:
    """As the stage track had them."""
    joints = contracts.read("joints", TRACK)
    names, q = contracts.stacked(joints, "q")
    fitted = (joints.drop_duplicates("take")["part"] == "training").to_numpy()
    chosen = ~fitted if np.sum(~fitted) >= ENOUGH else np.ones_like(fitted)
    kept = [name for name, keep in zip(names, chosen, strict=True) if keep]
    return OwnTakes(kept, q[chosen], fitted[chosen], q[fitted].mean(axis=0))


def commanded(model: ExportedModel, own: OwnTakes, rate: float) -> Commands:
    """What the ``model`` has the arm commanded over the motion, of ``rate`` steps a second."""
    path, share = MeanPath(model.chain, own.mean), model.record["closed_loop_share"]
    if share > 0:
        return path.commands(share)
    trajectory = contracts.read("trajectory", MOTION)
    return Commands(commanded_steps(trajectory, rate), path.path, 0.0)


def new_takes(file: Path, dataset: SimpleNamespace, mean: np.ndarray) -> dict[str, np.ndarray]:
    """By name the angles (M+1, n) in rad of each repetition in ``file``: one of a motion capture,
    of a joint log as many as it holds. ``mean`` (M+1, n) in rad is that of the dataset's takes,
    which a log is brought in phase with.

    Raises RecordingError for a file that the dataset's stages would refuse.
    """
    if not file.exists():
        raise RecordingError("there is no such file", file=file)
    if dataset.mocap is not None:
        rows, _ = marker_rows(file.stem, file, "test", dataset)
        return {file.stem: follower(dataset.robot, dataset.mocap)(rows, take=file.stem).q}
    options, steps = dataset.joint_log, dataset.motion.steps
    moving = steps - 2 * options.rest
    alone = replace(options, movements=file.name)
    single = SimpleNamespace(**vars(dataset) | {"joint_log": alone})
    takes, observed, _ = find_takes(file.resolve().parent, single, moving)
    if not takes:
        held = "; ".join(sorted(set(observed))) or "no motion"
        raise RecordingError(f"no repetition of the dataset's motion; it holds {held}", file=file)
    path = mean[options.rest : options.rest + moving + 1]
    place = align if options.rest else in_phase
    return {
        name: stretch(take.actual, place(take.actual, take.first, path) - options.rest, steps + 1)
        for name, take in takes.items()
    }
