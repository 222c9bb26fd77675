"""Recordings of a robot that repeats its motions, as tests of several stages read them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline import contracts

ROOT = Path(__file__).parents[1]
FILES = ("log_q_actual.csv", "log_q_target.csv", "log_qd_target.csv")


def quality(name: str, take: str) -> float:
    """Sum of a measure of quality over the takes whose names hold ``take``, as ingest wrote it."""
    table = contracts.read("quality", Path("data/ingest"))
    return table.loc[(table["quantity"] == name) & table["take"].str.contains(take), "value"].sum()


def ingested() -> tuple[list[str], np.ndarray]:
    """Takes and joint angles (N, K, 3) in rad that ingest wrote."""
    return contracts.stacked(contracts.read("joint_log", Path("data/ingest")), ["q1", "q2", "q3"])
