"""Kinds of joint logs and tables, as joint_kinds.yaml lists them: see :class:`kinds.FileKind`."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from kinds import FileKind, read_kinds
from numpy.random import default_rng
from scipy.io import savemat

RATE = 125.0  # Hz
ROWS = 400
HOME = np.array([0.9, -1.1, 0.35, -1.4, 0.3, 0.5])  # rad, of UR below
AWAY = HOME + np.array([0.45, 0.25, -0.5, 0.15, 0.2, -0.25])
UR = ["elbow", "shoulder_lift", "shoulder_pan", "wrist_1", "wrist_2", "wrist_3"]
HEAD = "time,actual_q_#,target_q_#"
Columns = Sequence[np.ndarray | Sequence[str]]  # numbers (N,) or (N, n), or words


def motion(rows: int = ROWS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,) s, measured and commanded angles (N, 6) rad of a motion out and back."""
    k = np.arange(rows)
    since_start = k - 60
    to_end = 340 - k
    moved = np.minimum(since_start, to_end) / 90
    phase = np.pi * np.clip(moved, 0, 1)
    share = (1 - np.cos(phase)) / 2
    target = HOME + share[:, None] * (AWAY - HOME)

    late = np.vstack([target[:1], target[:-1]])
    noise = default_rng(3).normal(0, 1e-5, late.shape)
    return k / RATE, late + noise, target


def cell_of(value: object) -> str:
    """A number with nine digits, an empty cell for NaN, or a word."""
    if isinstance(value, str):
        return value
    return "" if np.isnan(value) else f"{value:.9g}"


def write(file: Path, labels: Sequence[str], *columns: np.ndarray | list[str]) -> None:
    """Write a table of ``columns``, numbers (N,) or (N, n) or words, below the ``labels``."""
    parts = []
    for column in columns:
        cells = np.asarray(column, dtype=object)
        parts.append(cells.reshape(len(cells), -1))
    lines = np.hstack(parts).tolist()
    if len(labels):
        lines.insert(0, labels)
    text = [",".join(map(cell_of, line)) + "\n" for line in lines]
    file.write_text("".join(text))


def labels_of(head: str) -> list[str]:
    """The labels of a ``head``, in which * stands for the names of UR's joints in alphabetical
    order, # for the numbers of six joints from 0, and #1 from 1.
    """
    labels = []
    for label in head.split(",") if head else []:
        if "*" in label:
            labels += [label.replace("*", joint) for joint in UR]
        elif "#1" in label:
            labels += [label.replace("#1", str(j)) for j in range(1, 7)]
        elif "#" in label:
            labels += [label.replace("#", str(j)) for j in range(6)]
        else:
            labels.append(label)
    return labels


def write_log(
    folder: Path,
    head: str = HEAD,
    change: tuple[str, ...] | None = None,
    file: str = "log.csv",
) -> None:
    """Write a table of time, measured and commanded angles below ``head``, its columns changed by
    a function of CHANGES and its arguments.
    """
    columns: Columns = motion()
    if change is not None:
        name, *arguments = change
        columns = CHANGES[name](*columns, *arguments)
    write(folder / file, labels_of(head), *columns)


def with_words(time, actual, target, *words: str) -> Columns:
    """Columns of constant ``words`` behind the time."""
    return time, *([word] * ROWS for word in words), actual, target


def two_orders(time, actual, target) -> Columns:
    """Columns of the joints' names, in another order in the second half of the rows."""
    joints = [f"{joint}_joint" for joint in UR]
    half = ROWS // 2
    words = [[a] * half + [b] * half for a, b in zip(joints, joints[::-1], strict=True)]
    return time, *words, actual, target


def setpoints(time, *angles) -> Columns:
    """Columns of the number of a setpoint behind the time."""
    return time, np.floor(9 * time), *angles


def dated(time, actual, target, form: str, factor: float = 1.0) -> Columns:
    """Columns whose times have another form."""
    return [form.format(factor * t) for t in time], actual, target


def dated_twice(time, *angles) -> Columns:
    """Columns of a date and of milliseconds."""
    dates = [f"2023-05-06T07:08:{t:09.6f}Z" for t in time]
    return dates, 1e5 + 1e3 * time, *angles


def days(time, *angles) -> Columns:
    """Columns of days since an epoch, and of the angles."""
    return [f"{45356.4 + t / 86400:.10f}" for t in time], *angles


def counts(time, actual, target, turn: int, zero: int) -> Columns:
    """Columns of counts of an encoder, ``turn`` per turn and ``zero`` at 0 rad."""
    return time, *(np.rint(zero + q * turn / (2 * np.pi)) for q in (actual, target))


def counted_beside(time, *angles) -> Columns:
    """Columns of row numbers from 1, of the times and of the angles."""
    return np.arange(1.0, len(time) + 1), time, *angles


def added(
    time,
    actual,
    target,
    value: float,
    joint: int,
    first: int,
    end: int,
) -> Columns:
    """Columns with ``value`` added to one joint's measured angles in the rows from ``first``."""
    actual[first:end, joint] += value
    return time, actual, target


def scaled(*columns: np.ndarray | float) -> Columns:
    """Columns of time, measured and commanded angles, times a factor each."""
    return [columns[k] * columns[k + 3] for k in range(3)]


def far_command(time, actual, target) -> Columns:
    """Columns whose commanded angles are far away in one row."""
    target[200] += 1e10
    return time, actual, target


def zero_first(time, *angles) -> Columns:
    """Columns whose angles are 0 for 0.1 s."""
    return time, *(np.where(time[:, None] < 0.1, 0.0, q) for q in angles)


def repeated(time, actual, target, times: int) -> Columns:
    """Columns of a log at a higher rate, which repeats each row."""
    stamps = np.arange(len(time) * times) / RATE / times
    return stamps, *(np.repeat(q, times, axis=0) for q in (actual, target))


def every_second_degree(time, *angles) -> Columns:
    """Columns of angles in degrees and rad in turn."""
    return time, *(q * ([np.degrees(1), 1] * 3) for q in angles)


def without_rows(*columns) -> Columns:
    """Columns without 30 rows."""
    return [np.delete(column, range(200, 230), axis=0) for column in columns]


def seconds_and_nanoseconds(time, *angles) -> Columns:
    """Columns of whole seconds and of nanoseconds."""
    return time // 1, np.rint(time % 1 * 1e9), *angles


def received(time, *angles) -> Columns:
    """Columns of late times of reception beside the times."""
    return time + 4.9e-3 * (np.arange(ROWS) % 2), time, *angles


def in_turn(time, actual, target, reverse: bool = False) -> Columns:
    """Columns of two topics whose rows alternate."""
    if reverse:
        actual, target = target, actual
    stamps = np.repeat(time, 2)
    stamps[1::2] += 0.003
    first = np.full((2 * len(time), 6), np.nan)
    second = first.copy()
    first[::2] = actual
    second[1::2] = target
    return stamps, first, second


CHANGES: dict[str, Callable[..., Columns]] = {
    "reversed command": lambda t, q, target: (t, q, target[:, ::-1]),
    "five commands": lambda t, q, target: (t, q, target[:, :5]),
    "no command": lambda t, q, target: (t, q),
    "setpoints without command": lambda t, q, target: setpoints(t, q),
    "no time": lambda t, *angles: angles,
    "steps of time": lambda t, *angles: (np.floor(9 * t), *angles),
    "row numbers": lambda t, *angles: (np.arange(float(len(t))), *angles),
    "late jump": lambda t, *angles: (np.where(t > 2, t + 3600, t), *angles),
    "scaled": scaled,
    "added": added,
    "counted beside": counted_beside,
    "counts": counts,
    "dated": dated,
    "dated twice": dated_twice,
    "days": days,
    "every second degree": every_second_degree,
    "far command": far_command,
    "in turn": in_turn,
    "received": received,
    "repeated": repeated,
    "seconds and nanoseconds": seconds_and_nanoseconds,
    "setpoints": setpoints,
    "two orders": two_orders,
    "with words": with_words,
    "without rows": without_rows,
    "zero first": zero_first,
}


def write_beside(folder: Path, others: Sequence[str]) -> None:
    """Write files of measured and commanded angles beside files ``others`` of other quantities."""
    time, actual, target = motion()
    rng = default_rng(1)
    quantities = {"log_q_actual": actual, "log_q_target": target}
    for name in others:
        quantities[name] = rng.normal(5, 1, target.shape)
    for name, values in quantities.items():
        write(folder / f"{name}.csv", [], time, values)
    (folder / "start_time.csv").write_text("1386165279.27\n" * 300)


def write_arrays(
    folder: Path,
    file: str,
    others: dict[str, list] | None = None,
) -> None:
    """Write arrays of joints × samples beside the times, and ``others``."""
    time, actual, target = motion()
    arrays = {"time": time, "q": actual.T, "q_target": target.T}
    for name, values in (others or {}).items():
        arrays[name] = np.array(values)
    if file.endswith("mat"):
        savemat(folder / file, arrays)
    else:
        np.savez(folder / file, **arrays)


def write_on_its_side(folder: Path, head: str = "") -> None:
    """Write a table of one row per signal, behind its label if there is a ``head``."""
    labels = labels_of(head)
    lines = []
    for number, signal in enumerate(np.column_stack(motion()).T):
        cells = [f"{value:.6f}" for value in signal]
        if labels:
            cells.insert(0, labels[number])
        lines.append(",".join(cells) + "\n")
    (folder / "log.csv").write_text("".join(lines))


def write_thousands(folder: Path, point: str, decimal: str) -> None:
    """Write a table in ms with a mark for thousands, ``point``, in the times from 1 s on."""
    signs = str.maketrans(",.", point + decimal)
    lines = [";".join(labels_of("t [ms],q_#,q_cmd_#"))]
    for time, *angles in np.column_stack(motion()):
        cells = [f"{1000 * time:,.3f}"]
        cells += [f"{angle:.6f}" for angle in angles]
        lines.append(";".join(cells).translate(signs))
    (folder / "log.csv").write_text("\n".join(lines) + "\n")


def write_quoted(folder: Path) -> None:
    """Write a table of quoted cells with decimal commas."""
    lines = [",".join(f'"{label}"' for label in labels_of("t,q_#,q_cmd_#"))]
    for row in np.column_stack(motion()):
        lines.append(",".join(f'"{value:.6f}"' for value in row).replace(".", ","))
    (folder / "log.csv").write_text("\n".join(lines) + "\n")


def write_replaced(folder: Path, old: str = "", new: str = "", nulls: int = 0) -> None:
    """Write a log in which ``new`` stands for ``old``, and behind it null characters."""
    write_log(folder)
    file = folder / "log.csv"
    file.write_text(file.read_text().replace(old, new) + "\0" * nulls)


def write_lists_in_cells(folder: Path) -> None:
    """Write a table of the times and of lists of the measured and commanded angles."""
    time, actual, target = motion()
    rows = {
        "time": time,
        "q": map(str, actual.tolist()),
        "q_target": map(str, target.tolist()),
    }
    pd.DataFrame(rows).to_csv(folder / "log.csv", index=False)


def write_struct_array(folder: Path) -> None:
    """Write a MATLAB file of one struct of time and angles per row."""
    angles = (float, (6,))
    kind = np.dtype([("t", float), ("q", angles), ("q_target", angles)])
    rows = np.zeros(ROWS, kind)
    for name, values in zip(kind.names, motion(), strict=True):
        rows[name] = values
    savemat(folder / "log.mat", {"log": rows})


def write_vectors(folder: Path) -> None:
    """Write a MATLAB file of one vector per joint, and of the times in ms."""
    time, actual, target = motion()
    joints = np.column_stack([actual, target]).T
    vectors = dict(zip(labels_of("q_#,q_des_#"), joints, strict=True))
    savemat(folder / "log.mat", {"time_ms": 1e3 * time, **vectors})


def write_episode(folder: Path) -> None:
    """Write a Parquet file of an episode of LeRobot, with a list of angles in each cell."""
    time, actual, target = motion()
    columns = {"timestamp": time, "action": [*target], "observation.state": [*actual]}
    pd.DataFrame(columns).to_parquet(folder / "episode.parquet")


def write_text(folder: Path, content: str) -> None:
    """Write a file of ``content``."""
    (folder / "log.csv").write_text(content)


WRITERS: dict[str, Callable[..., None]] = {
    "log": write_log,
    "arrays": write_arrays,
    "beside": write_beside,
    "episode": write_episode,
    "lists in cells": write_lists_in_cells,
    "on its side": write_on_its_side,
    "quoted": write_quoted,
    "replaced": write_replaced,
    "struct array": write_struct_array,
    "text": write_text,
    "thousands": write_thousands,
    "vectors": write_vectors,
}


KINDS: list[FileKind] = read_kinds("joint_kinds.yaml", WRITERS)
