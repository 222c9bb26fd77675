"""ingest: raw logs → typed tables in SI units on the motion clock, with a quality record per take."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline import config, contracts, schema
from pipeline.arm.model import Arm, load_arm
from pipeline.arm.trajectory import trajectory_table
from pipeline.compute import run_trials
from pipeline.errors import RecordingError
from pipeline.instruments.ati import read_daqft
from pipeline.instruments.joint_log import read_movement
from pipeline.instruments.motive import read_motive
from pipeline.instruments.trajectory import read_trajectory
from pipeline.perception.depth_sequence import DepthSequence
from pipeline.perception.repetitions import align, excursions, find_repetitions, lag
from pipeline.perception.sync import find_offset
from pipeline.wrench.tare import remove_bias

OUT = Path("data/ingest")


def run() -> None:
    """Read what the dataset has; say of every instrument it lacks that its part of the analysis falls away."""
    settings = config.sections("ingest")
    dataset = settings.dataset
    raw = Path(dataset.recordings)
    if not raw.is_dir():
        raise RecordingError("the folder of the recordings does not exist; see its datasheet for how to get them", file=raw)
    arm = load_arm(dataset.robot.urdf, dataset.robot.joints, dataset.robot.tool, dataset.robot.locked)
    with contracts.replacing(OUT) as folder:
        quality = []
        if dataset.joint_log is not None:
            trajectory, joints, rows = _joint_logs(raw, dataset, arm)
            contracts.write(trajectory, "trajectory", folder)
            contracts.write(joints, "joint_log", folder)
            quality += rows
        if dataset.trajectory is not None:
            contracts.write(_trajectory(raw / dataset.trajectory, dataset.motion), "trajectory", folder)
        if dataset.mocap is not None:
            markers = [_markers(*take, dataset) for take in _takes(raw, dataset.mocap)]
            table = pd.concat([rows for rows, _ in markers], ignore_index=True)
            contracts.write(table, "markers", folder)
            quality += [row for _, rows in markers for row in rows]
        if dataset.depth is not None:
            takes = sorted(path for path in raw.glob(dataset.depth.takes) if path.is_dir())
            if not takes:
                raise RecordingError(f"no folder of depth frames matches {dataset.depth.takes!r}", file=raw)
            seen = table[table["take"].isin([take.name for take in takes])]
            centroids = {take: _marker_centroid(rows, arm) for take, rows in seen.groupby("take")}
            read = partial(_depth_take, dataset=dataset, arm=arm, raw=raw, centroids=centroids)
            frames = run_trials(read, takes, workers=settings.compute.workers, label="ingest: depth takes")
            contracts.write(pd.concat([rows for rows, _ in frames], ignore_index=True), "frames", folder)
            quality += [row for _, rows in frames for row in rows]
        if dataset.force is not None:
            forces = [_force(raw, name, configuration, dataset.force) for name, configuration in dataset.force.configurations.items()]
            contracts.write(pd.concat([rows for rows, _ in forces], ignore_index=True), "force", folder)
            quality += [row for _, rows in forces for row in rows]
        for instrument in ("mocap", "depth", "force"):
            if getattr(dataset, instrument) is None:
                print(f"ingest: the dataset {dataset.name} has no {instrument}; what needs it is left out")
        contracts.write(pd.DataFrame(quality), "quality", folder)


def _row(take: str, part: str, instrument: str, quantity: str, value: float, unit: str = "1") -> dict[str, object]:
    return {"take": take, "part": part, "instrument": instrument, "quantity": quantity, "value": float(value), "unit": unit}


def _trajectory(file: Path, motion: schema.Motion) -> pd.DataFrame:
    table = read_trajectory(file)
    if len(table) != motion.steps + 1 or not np.isclose(table.t.iloc[1] - table.t.iloc[0], 1 / motion.rate, rtol=1e-6):
        raise RecordingError(
            f"the trajectory has {len(table)} rows; dataset.motion asks for {motion.steps + 1} at {motion.rate} per second", file=file
        )
    return table.assign(k=np.arange(len(table)))


def _joint_logs(raw: Path, dataset: schema.Dataset, arm: Arm) -> tuple[pd.DataFrame, pd.DataFrame, list[dict]]:
    """Desired trajectory and measured angles of every repetition of the motion that the dataset asks for.

    The desired pose is that of the mean command over the repetitions. Before and after the motion it is held: a controller at rest
    logs the measured angle for the commanded one.
    """
    options, motion = dataset.joint_log, dataset.motion
    steps = motion.steps - 2 * options.rest
    takes, seen, quality = _repetitions(raw, options, motion.rate, steps)
    if len(takes) < 2:
        raise RecordingError(
            f"{len(takes)} repetition(s) of a motion of {steps} steps from {list(options.start)} to {list(options.end)} rad between "
            f"{options.rest} at rest, where the fits need two; the movements hold {'; '.join(sorted(set(seen))) or 'no motion'}",
            file=raw, key="dataset.joint_log",
        )  # fmt: skip
    _, target, first = next(iter(takes.values()))
    reference = target[first : first + steps + 1]
    starts = [align(target, first, reference) - options.rest for _, target, first in takes.values()]
    rows = [slice(start, start + motion.steps + 1) for start in starts]
    measured = np.stack([actual[window] for (actual, _, _), window in zip(takes.values(), rows, strict=True)])
    commanded = np.stack([target[window] for (_, target, _), window in zip(takes.values(), rows, strict=True)])
    command = commanded.mean(axis=0)
    moving = slice(options.rest, options.rest + steps + 1)
    deviations = np.abs(commanded - command)[:, moving].max(axis=(1, 2))
    if np.any(deviations > options.tolerance):
        raise RecordingError(
            f"the command is {deviations.max():.2g} rad off its mean over the takes, more than {options.tolerance:g}: another motion?",
            file=raw, take=list(takes)[int(deviations.argmax())], key="dataset.joint_log.tolerance",
        )  # fmt: skip
    for take, q, deviation in zip(takes, measured, deviations, strict=True):
        behind = lag(command[moving], q[moving], motion.rate)
        quality.append(_row(take, "training", "joint log", "command_deviation", deviation, "rad"))
        quality.append(_row(take, "training", "joint log", "lag_behind_command", behind, "s"))
    # the commanded angle takes its first step one sample before the commanded speed is first logged
    held = command[np.clip(np.arange(motion.steps + 1), options.rest - 1, options.rest + steps)]
    k = np.tile(np.arange(motion.steps + 1), len(takes))
    joints = pd.DataFrame({"take": np.repeat(list(takes), motion.steps + 1), "part": "training", "k": k, "t": k / motion.rate})
    joints = joints.assign(**{f"q{j + 1}": measured[..., j].ravel() for j in range(3)})
    return trajectory_table(arm.chain, held, motion.rate), joints, quality


def _repetitions(
    raw: Path, options: schema.JointLog, rate: float, steps: int
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray, int]], list[str], list[dict]]:
    """By take: the chain's measured and commanded angles in its movement, and its first row; all motions in words; quality."""
    takes, seen, quality = {}, [], []
    chain = [column - 1 for column in options.columns]
    folders = sorted(path for path in raw.glob(options.movements) if path.is_dir())
    if not folders:
        raise RecordingError(f"no folder of a movement matches {options.movements!r}", file=raw)
    for folder in folders:
        files = (options.actual, options.target, options.speed)
        (actual, target, speed), counts = read_movement(folder, files, joints=options.joints, rate=rate)
        runs = find_repetitions(target, speed, chain, options.start, options.end, steps=steps, rest=options.rest)
        takes |= {f"{folder.name}_{number}": (actual[:, chain], target[:, chain], run.first) for number, run in enumerate(runs.found, 1)}
        seen += [run.describe(target[:, chain]) for run in excursions(target, speed) if run.whole]
        counts |= {"repetitions": len(runs.found)} | {f"excursions_{reason}": len(rows) for reason, rows in runs.left_out.items()}
        quality += [_row(folder.name, "training", "joint log", key, value) for key, value in counts.items()]
        left_out = [f"{len(rows)} {reason.replace('_', ' ')} (rows {rows})" for reason, rows in runs.left_out.items() if rows]
        found = f"{len(runs.found)} repetitions (rows {[run.first for run in runs.found]})"
        print(f"ingest: {folder.name}: {found}; left out: {', '.join(left_out) or 'nothing'}")
    return takes, seen, quality


def _takes(raw: Path, mocap: schema.Mocap) -> list[tuple[Path, str]]:
    found = []
    for part, pattern in (("training", mocap.training), ("test", mocap.test)):
        files = sorted(raw.glob(pattern)) if pattern else []
        if pattern and not files:
            raise RecordingError(f"no {part} take matches {pattern!r}", file=raw)
        found += [(file, part) for file in files]
    return found


def _markers(file: Path, part: str, dataset: schema.Dataset) -> tuple[pd.DataFrame, list[dict]]:
    """The markers of one take in the arm's base frame: those of the template by link, all others as unlabelled."""
    take, frames = read_motive(file), dataset.motion.steps + 1
    if not np.isclose(take.rate, dataset.motion.rate):
        raise RecordingError(f"the take is exported at {take.rate} Hz; dataset.motion asks for {dataset.motion.rate}", file=file)
    if len(take.frame) != frames or np.any(np.diff(take.frame) != 1):
        raise RecordingError(f"the take has {len(take.frame)} frames; the motion has {frames} without a gap: export it whole", file=file)
    rotation = Rotation.from_euler("xyz", dataset.mocap.base.rpy).as_matrix()
    template = {name: (j, i) for j, link in enumerate(dataset.mocap.markers.values(), 1) for i, name in enumerate(link, 1)}
    # Motive prefixes the marker's name by that of its asset
    columns = {name.rsplit(":", 1)[-1]: positions for name, positions in take.markers.items()}
    if absent := sorted(set(template) - set(columns)):
        raise RecordingError(f"no marker named {', '.join(absent)} in the take; it has {', '.join(sorted(columns))}", file=file)
    stray = [name for name in columns if name not in template]
    places = template | {name: (0, i) for i, name in enumerate(stray, 1)}
    k = np.arange(frames)
    rows = []
    for name, (link, marker) in places.items():
        xyz = (columns[name] - np.array(dataset.mocap.base.position)) @ rotation
        identity = {"take": file.stem, "part": part, "k": k, "t": k / dataset.motion.rate, "link": link, "marker": marker}
        rows.append(pd.DataFrame(identity | dict(zip("xyz", xyz.T, strict=True))))
    missing = sum(int(np.isnan(columns[name][:, 0]).sum()) for name in template)
    counts = take.counts | {"missing_samples": missing, "unlabelled_markers": len(stray)}
    return pd.concat(rows, ignore_index=True), [_row(file.stem, part, "motion capture", key, value) for key, value in counts.items()]


def _marker_centroid(rows: pd.DataFrame, arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Times (K,) s and centroid (K, 2) m in the plane of the labelled markers, at the frames that show all of them."""
    labelled = rows[rows.link > 0]
    plane = pd.DataFrame(arm.to_plane(labelled[["x", "y", "z"]].to_numpy())[:, [0, 2]], index=labelled["t"].to_numpy())
    centroid = plane.groupby(level=0).agg(lambda values: values.mean(skipna=False)).dropna()
    return centroid.index.to_numpy(), centroid.to_numpy()


def _depth_take(path: Path, dataset: schema.Dataset, arm: Arm, raw: Path, centroids: dict) -> tuple[pd.DataFrame, list[dict]]:
    """Frames of one take on the motion clock; the clocks' offset is where the seen arm moves as its markers do."""
    take = path.name
    if take not in centroids:
        raise RecordingError("no motion-capture take of this name to set the clock by", file=path, take=take)
    sequence = DepthSequence(path, dataset.depth, arm, raw)
    seen = [sequence.points(frame) for frame in range(len(sequence.time))]
    usable = np.array([len(points) > 0 for points, _ in seen])
    centroid = np.array([points.mean(axis=0) for points, _ in seen if len(points)])
    offset = find_offset(sequence.time[usable], centroid, *centroids[take], search=(-dataset.depth.search, dataset.depth.search), take=take)
    rows = pd.DataFrame(
        {"take": take, "part": "test", "frame": np.arange(len(seen)), "t": sequence.time + offset.value}
        | {"file": [str(file.relative_to(raw)) for file in sequence.files], "valid": [valid for _, valid in seen]}
    )
    dropped = int(np.sum(np.rint(np.diff(sequence.time) * dataset.depth.rate) - 1))
    quality = [
        _row(take, "test", "depth camera", "dropped_frames", dropped),
        _row(take, "test", "depth camera", "clock_offset", offset.value, "s"),
        _row(take, "test", "depth camera", "clock_offset_standard_error", offset.standard_error, "s"),
        _row(take, "test", "depth camera", "clock_correlation", offset.correlation),
        *(_row(take, "test", "depth camera", key, value) for key, value in sequence.counts.items()),
    ]
    return rows, quality


def _force(raw: Path, name: str, configuration: schema.Configuration, force: schema.Force) -> tuple[pd.DataFrame, list[dict]]:
    record = read_daqft(raw / configuration.file)
    tared = remove_bias(record.time, record.force, force.tare)
    rows = pd.DataFrame({"configuration": name, "t": tared.time, "fx": tared.force[:, 0], "fy": tared.force[:, 1]})
    quality = [_row(name, "test", "force transducer", key, value) for key, value in record.counts.items()]
    quality += [_row(name, "test", "force transducer", f"bias_f{axis}", tared.bias[i], "N") for i, axis in enumerate("xyz")]
    return rows, quality
