"""What the pipeline makes of recordings, clean or faulty: the values it recovers, what it counted on the way, or its refusal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pipeline import schema
from pipeline.arm.model import Arm
from pipeline.errors import PipelineError
from pipeline.faults.fault import REFUSED, REPAIRED, UNHARMED, UNNOTICED, Fault, Files
from pipeline.perception.articulation import ArticulationOptions
from pipeline.perception.depth_angles import articulate_rows
from pipeline.perception.depth_sequence import DepthSequence
from pipeline.perception.markers import track_rows
from pipeline.recordings import depth_camera, motion_capture
from pipeline.recordings.force_transducer import force_rows

SAME = 1e-9  # rad or N: above what another order of summation leaves, below what any instrument resolves


@dataclass(frozen=True)
class Recovered:
    """``values`` (N, d) at ``time`` (N,) in s: joint angles in rad, or moments of force in N; ``counts`` as in the table ``quality``."""

    time: np.ndarray
    values: np.ndarray
    counts: dict[str, float]


@dataclass(frozen=True)
class Outcome:
    """What became of a fault: one of :data:`pipeline.faults.fault.OUTCOMES`, what was recovered, and what was said or counted of it."""

    kind: str
    recovered: Recovered | None
    found: str
    evidence: dict[str, object]


@dataclass(frozen=True, repr=False)
class Bench:
    """A valid recording: its ``files``, how values are recovered from their folder, those ``clean`` values, and the truth they stand for.

    ``truth`` (K, d) at ``time`` (K,) in s.
    """

    files: Files
    recover: Callable[[Path], Recovered]
    clean: Recovered
    time: np.ndarray
    truth: np.ndarray

    def error(self, recovered: Recovered) -> float:
        """Root mean square, over samples and columns, of recovered values minus the truth, which is linear between its samples."""
        expected = np.stack([np.interp(recovered.time, self.time, column) for column in self.truth.T], axis=-1)
        return float(np.sqrt(np.mean((recovered.values - expected) ** 2)))


def recovered_from(files: Files, recover: Callable[[Path], Recovered]) -> Recovered:
    """What is recovered from ``files``, written into a folder of their own."""
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            file = Path(folder) / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        return recover(Path(folder))


def suffer(bench: Bench, fault: Fault, severity: float, rng: np.random.Generator) -> Outcome:
    """What becomes of the recording with ``fault`` in it. Any exception but a refusal of the pipeline's own passes through."""
    faulty = fault.inflict(bench.files, severity, rng)
    try:
        found = recovered_from(faulty, bench.recover)
    except PipelineError as error:
        return Outcome(REFUSED, None, error.message, error.evidence)
    clean = bench.clean
    counted = {name: found.counts.get(name, 0.0) for name in fault.counted if _differs(name, found.counts, clean.counts)}
    said = ", ".join(f"{name.replace('_', ' ')} {value:.6g}" for name, value in counted.items())
    same = found.values.shape == clean.values.shape and np.allclose(found.values, clean.values, rtol=0, atol=SAME)
    return Outcome(REPAIRED if counted else UNHARMED if same else UNNOTICED, found, said, {})


def _differs(name: str, found: dict[str, float], clean: dict[str, float]) -> bool:
    """Whether a count is another, or an estimate is off the clean one by more than three of its standard errors."""
    margin = 3 * clean.get(f"{name}_standard_error", 0.0)
    return abs(found.get(name, 0.0) - clean.get(name, 0.0)) > margin


def joint_angles_of_markers(raw: Path, dataset: schema.Dataset, arm: Arm) -> Recovered:
    """Measured joint angles of the one training take below ``raw``: ingest and track."""
    (file, part), *_ = motion_capture.find_takes(raw, dataset.mocap)
    rows, quality = motion_capture.marker_rows(file, part, dataset)
    track = track_rows(rows, dataset.mocap, arm, take=file.stem)
    return Recovered(np.arange(len(track.q)) / dataset.motion.rate, track.q, _counts(quality) | track.counts)


def joint_angles_of_depth(
    raw: Path, dataset: schema.Dataset, arm: Arm, centroid: depth_camera.Signal, options: ArticulationOptions, start: np.ndarray
) -> Recovered:
    """Joint angles of the one depth take below ``raw``, its clock set by the ``centroid`` of its markers: ingest and articulate.

    Calibration and desired trajectory are read from ``raw`` too. ``start`` (3,) rad as of :func:`fit_sequence`.
    """
    trajectory = motion_capture.trajectory_rows(raw / dataset.trajectory, dataset.motion)
    path = next(iter(sorted(raw.glob(dataset.depth.takes))))
    rows, quality = depth_camera.frame_rows((path, centroid), dataset.depth, arm, raw)
    angles = articulate_rows(rows, DepthSequence(path, dataset.depth, arm, raw), arm, trajectory, options, start)
    counts = {"frames_without_fit": len(rows) - len(angles), "valid": float(rows["valid"].mean())}
    return Recovered(angles["t"].to_numpy(), angles[["q1", "q2", "q3"]].to_numpy(), _counts(quality) | counts)


def moments_of_force(raw: Path, name: str, force: schema.Force) -> Recovered:
    """Means and standard deviations, (1, 4) N, of the horizontal forces of the configuration ``name``: ingest."""
    rows, quality = force_rows(raw, name, force)
    forces = rows[["fx", "fy"]].to_numpy()
    return Recovered(np.zeros(1), np.hstack([forces.mean(axis=0), forces.std(axis=0)])[None], _counts(quality))


def _counts(quality: list[dict]) -> dict[str, float]:
    return {row["quantity"]: row["value"] for row in quality}
