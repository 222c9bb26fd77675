"""Measurements reach the page with their verdicts."""

from __future__ import annotations

import json

import growth
import numpy as np
import pandas as pd
import pytest
from equal_bytes import CONTROL, SETTINGS
from scenario import many_joints, take
from summary import SECTIONS, contest_rows, report


def contest(name: str, role: str, seconds: list[float], **extra: object) -> dict:
    info = {"role": role, "items": 10, **extra}
    return {"group": "a", "name": name, "param": None, "extra_info": info, "least": seconds}


OURS = contest("test_ours", "ours", [1e-6, 2e-6], objective=1.0)


@pytest.mark.parametrize(
    "quality, target, verdict",
    [(1.0, 5, "met"), (1.0, 7, "**met in 1 of 2 runs**"), (0.9, 5, "**missed**")],
)
def test_a_ratio_is_met_in_every_run_and_not_at_the_cost_of_quality(quality, target, verdict):
    peer = contest("test_p", "peer", [1e-5, 1.2e-5], target=target, objective=quality)
    ((_, _, ratio, _, found, _),) = contest_rows([OURS, peer])
    assert found == verdict and ratio.startswith("8 (6 to 10) times as fast")


def test_the_slope_is_the_power_of_the_larger_sizes():
    sizes = 2.0 ** np.arange(8)
    costs = sizes**1.5 + np.where(sizes < 16, 5.0, 0.0)
    assert growth.slope(sizes, costs) == pytest.approx(1.5)


@pytest.mark.parametrize("joints", growth.SIZES["joints"])
def test_an_arm_of_many_joints_keeps_clear_of_singular_poses(joints):
    posterior = take(40, many_joints(joints)).filtered(500, np.random.default_rng(1))
    assert len(posterior.mean) == 41 and not posterior.outside.any()


def test_every_measurement_has_its_place_on_the_page(tmp_path):
    hashes = {one.name: {"fit": "a", "filter": "b"} for one in (*SETTINGS, CONTROL)}
    hashes[SETTINGS[2].name]["filter"] = "c"
    files = {
        "contests": {"machine_info": {"machine": "M", "versions": {}}, "benchmarks": [OURS]},
        "equal_bytes": {"machine": "M", "skipped": [], "hashes": hashes},
        "start": {
            "imports_seconds": 0.5,
            "cached_seconds": 0.1,
            "compiled_seconds": 20.0,
            "nanoseconds": {"youbot, QR of J": {"kernel": 31.4, "C library": 60.2, "scalar": 95.0}},
        },
    }
    for name, content in files.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    row = {"over": "joints", "from": 2, "to": 12, "seconds_at_most": 1.0, "time_slope": 2.5}
    pd.DataFrame([row | {"memory_slope": np.nan, "time_limit": 3.0}]).to_csv(
        tmp_path / "growth.csv", index=False
    )
    text = report(tmp_path)
    assert all(f"## {title}" in text for title in SECTIONS)
    assert "| filter | equal | **other** |" in text and "20 s | ≤ 15 s | **missed**" in text
    assert "| youbot, QR of J | 31 | 60 |" in text
    assert "| joints | 2 to 12 | 2.50 (≤ 3: met) | – |" in text and "make bench-scale" in text
