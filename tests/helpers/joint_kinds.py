"""Kinds of joint logs and tables: see :class:`kinds.FileKind`."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from kinds import FileKind

RATE = 125.0  # Hz
HOME = np.array([0.9, -1.1, 0.35, -1.4, 0.3, 0.5])  # rad, of UR below
AWAY = HOME + np.array([0.45, 0.25, -0.5, 0.15, 0.2, -0.25])
UR = ["elbow", "shoulder_lift", "shoulder_pan", "wrist_1", "wrist_2", "wrist_3"]
TRACKED = "command tracking error 0.0"  # of the motion


def motion(rows: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,) s, measured and commanded angles (N, 6) rad of a motion out and back."""
    k = np.arange(rows)
    share = (1 - np.cos(np.pi * np.clip(np.minimum(k - 60, 340 - k) / 90, 0, 1))) / 2
    target = HOME + share[:, None] * (AWAY - HOME)
    actual = np.vstack([target[:1], target[:-1]])
    return k / RATE, actual + np.random.default_rng(3).normal(0, 1e-5, actual.shape), target


def write(file: Path, labels: Sequence[str], *columns: np.ndarray | Sequence[str]) -> None:
    """Write a table of ``columns``, numbers (N,) or (N, n) or words, below the ``labels``."""
    cells = []
    for column in columns:
        rows = column if isinstance(column, np.ndarray) else np.array(column, object)
        cells += rows.reshape(len(rows), -1).T.tolist()
    lines = [labels, *zip(*cells, strict=True)] if len(labels) else [*zip(*cells, strict=True)]
    text = (",".join(f"{c:.9g}" if isinstance(c, float) else str(c) for c in li) for li in lines)
    file.write_text("\n".join(text) + "\n")


def numbered(*words: str, first: int = 0, count: int = 6) -> list[str]:
    """Labels ``word_number`` of all joints, one word after the other."""
    return [f"{word}_{j}" for word in words for j in range(first, first + count)]


def target_moments(*others: str) -> Callable[[Path], None]:
    """Files of measured and commanded angles beside files ``others`` of other quantities."""

    def make(folder: Path) -> None:
        time, actual, target = motion()
        rng = np.random.default_rng(1)
        write(folder / "log_q_actual.csv", [], time, actual)
        write(folder / "log_q_target.csv", [], time, target)
        for name in others:
            write(folder / f"{name}.csv", [], time, rng.normal(5, 1, target.shape))
        (folder / "start_time.csv").write_text("1386165279.27\n" * 300)

    return make


PAIRED = ("log_q_actual.csv: table of numbers", TRACKED)
KINDS = [
    FileKind("40", target_moments("log_i_target", "log_m_target"), PAIRED),
    FileKind("40", target_moments("log_f_target", "log_tcp_speed"), PAIRED, public=False),
    FileKind("40", target_moments("log_v_target", "log_qdd_target"), PAIRED, public=False),
]
