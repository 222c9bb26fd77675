"""faults: what every kind of fault does to the recordings' results: repaired and counted, or refused, and how far off the truth then."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng
from pipeline.arm.model import Arm, load_arm
from pipeline.compute.trials import run_trials
from pipeline.faults import recovery
from pipeline.faults.fault import OUTCOMES
from pipeline.faults.recovery import Bench, recovered_from, suffer
from pipeline.faults.registry import DEPTH_CAMERA, FAULTS, FORCE_TRANSDUCER, MOTION_CAPTURE
from pipeline.perception.articulation import ArticulationOptions
from pipeline.recordings.depth_camera import marker_centroid

INGEST, TRACK, OUT = Path("data/ingest"), Path("data/track"), Path("data/faults")
JOINTS = ["q1", "q2", "q3"]
DEPTH_SHARE = 0.5  # of the frames of a depth take, from its start on, is used: the motion out, without the one back


def run() -> None:
    """Inflict every fault at each level of severity on a few test takes and one force record."""
    settings = config.sections("faults")
    dataset = settings.dataset
    with contracts.replacing(OUT) as folder:
        if dataset.twin is None:
            print("faults: the dataset has no synthetic laboratory, and so no truth to hold recovered values against; nothing to do")
            return
        arm = load_arm(dataset.robot.urdf, dataset.robot.joints, dataset.robot.tool, dataset.robot.locked)
        raw = Path(dataset.recordings)
        takes = sorted(file.stem for file in raw.glob(dataset.mocap.test))[: settings.scale.fault_takes]
        truth = contracts.read("true_joints", raw.parent / "truth")
        benches = {take: _marker_bench(take, dataset, arm, truth) for take in takes}
        benches["depth"] = _depth_bench(takes[0], dataset, settings.articulation, arm, truth)
        benches["force"] = _force_bench(dataset)
        faults = {**dict.fromkeys(takes, MOTION_CAPTURE), "depth": DEPTH_CAMERA, "force": FORCE_TRANSDUCER}
        trials = [(bench, fault.name, level) for bench in benches for fault in faults[bench] for level in range(len(fault.levels))]
        inflict = partial(_trial, benches=benches, seed=settings.seed)
        rows = pd.DataFrame(run_trials(inflict, trials, compute=settings.compute, label="faults: trials"))
        contracts.write(_summary(rows), "faults", folder)


def _trial(trial: tuple[str, str, int], benches: dict[str, Bench], seed: int) -> dict[str, object]:
    name, fault, level = trial
    bench, kind = benches[name], FAULTS[fault]
    outcome = suffer(bench, kind, kind.levels[level], rng.stream(seed, f"faults.{fault}", level, list(benches).index(name)))
    error = np.nan if outcome.recovered is None else bench.error(outcome.recovered)
    return {
        "fault": fault,
        "level": level,
        "outcome": outcome.kind,
        "found": outcome.found,
        "error": error,
        "clean": bench.error(bench.clean),
    }


def _summary(trials: pd.DataFrame) -> pd.DataFrame:
    """One row per fault and severity, over the trials."""
    rows = []
    for (name, level), of in trials.groupby(["fault", "level"], sort=False):
        fault, ends = FAULTS[name], of["outcome"].value_counts()
        row = {"fault": name, "instrument": fault.instrument, "severity": float(fault.levels[level]), "severity_unit": fault.severity}
        row["outcome"] = ends.index[0] if len(ends) == 1 else ", ".join(f"{kind} {ends[kind]}" for kind in OUTCOMES if kind in ends)
        row |= {"as_expected": set(ends.index) <= set(fault.expected), "rule": fault.rule, "found": of["found"].iloc[0]}
        kept = of.dropna(subset="error")
        row |= {"error": _rms(kept["error"]), "clean_error": _rms((of if kept.empty else kept)["clean"])}
        rows.append(row | {"error_unit": "N" if fault in FORCE_TRANSDUCER else "rad"})
        if not row["as_expected"]:
            print(f"faults: {name} of {row['severity']:g} {fault.severity} ended {row['outcome']}, where it should be {fault.expected}")
    return pd.DataFrame(rows)


def _rms(errors: pd.Series) -> float:
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else np.nan


def _read(folder: Path, names: list[str]) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in names}


def _marker_bench(take: str, dataset, arm: Arm, truth: pd.DataFrame) -> Bench:
    one = SimpleNamespace(**vars(dataset) | {"mocap": replace(dataset.mocap, training="optitrack/*.csv", test=None)})
    files = _read(Path(dataset.recordings), [f"optitrack/{take}.csv"])
    recover = partial(recovery.joint_angles_of_markers, dataset=one, arm=arm)
    return _bench(files, recover, truth[truth["take"] == take])


def _depth_bench(take: str, dataset, options, arm: Arm, truth: pd.DataFrame) -> Bench:
    raw, depth = Path(dataset.recordings), dataset.depth
    folder = next(path.relative_to(raw) for path in raw.glob(depth.takes) if path.name == take)
    index = (raw / folder / depth.index).read_text().splitlines(keepends=True)
    comments, frames = [line for line in index if line.startswith("#")], [line for line in index if not line.startswith("#")]
    frames = frames[: round(DEPTH_SHARE * len(frames))]
    files = _read(raw, [dataset.trajectory, depth.intrinsics, *(f"{folder}/{line.split()[1]}" for line in frames)])
    files[f"{folder}/{depth.index}"] = "".join(comments + frames).encode()
    joints, markers = contracts.read("joints", TRACK), contracts.read("markers", INGEST)
    start = joints[(joints.part == "training") & (joints.k == 0)][JOINTS].mean().to_numpy()
    centroid = marker_centroid(markers[markers["take"] == take], arm)
    recover = partial(
        recovery.joint_angles_of_depth, dataset=dataset, arm=arm, centroid=centroid, start=start,
        options=ArticulationOptions(options.gamma1, options.gamma2, options.length_range, options.minimum_points, options.max_gap),
    )  # fmt: skip
    return _bench(files, recover, truth[truth["take"] == take])


def _bench(files: dict[str, bytes], recover, truth: pd.DataFrame) -> Bench:
    return Bench(files, recover, recovered_from(files, recover), truth["t"].to_numpy(), truth[JOINTS].to_numpy())


def _force_bench(dataset) -> Bench:
    """Of a force record no truth is known: what a fault changes is measured against the record without it."""
    name, configuration = next(iter(dataset.force.configurations.items()))
    files = _read(Path(dataset.recordings), [configuration.file])
    recover = partial(recovery.moments_of_force, name=name, force=dataset.force)
    clean = recovered_from(files, recover)
    return Bench(files, recover, clean, clean.time, clean.values)
