"""Logs written as a table read back as one."""

from __future__ import annotations

import numpy as np

from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import joint_labels, read_joint_table, write_joint_table


def test_a_written_log_reads_back_to_what_is_printed(tmp_path):
    rng, joints = np.random.default_rng(1), ["shoulder", "elbow"]
    signals = {"target": rng.normal(size=(50, 2)), "actual": rng.normal(size=(50, 2))}
    write_joint_table(tmp_path / "t.csv", np.arange(50) / 200, signals, joints)
    options = LogOptions(
        "time", joints=2, signals={name: joint_labels(name, joints) for name in signals}
    )
    log = read_joint_table(tmp_path / "t.csv", options)
    np.testing.assert_allclose(log.time, np.arange(50) / 200, atol=1e-9)
    for name, values in signals.items():
        np.testing.assert_allclose(log.signals[name], values, atol=0.51e-7)
