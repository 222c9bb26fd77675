"""Measurements reach the page with their verdicts."""

import json

import growth
import numpy as np
import pandas as pd
import pytest
from contests import RESULTS, ROOT
from equal_bytes import SETTINGS
from scenario import take
from summary import contest_rows, measured_times, page, times_table, with_times
from times import stage_seconds


@pytest.mark.parametrize(
    ("quality", "target", "verdict"),
    [(1.0, 5, "met"), (1.0, 7, "**met in 1 of 2 runs**"), (0.9, 5, "**missed**")],
)
def test_a_ratio_is_met_in_every_run_and_not_at_the_cost_of_quality(
    quality,
    target,
    verdict,
):
    ours = {"role": "ours", "items": 10, "objective": 1.0}
    peer = ours | {"role": "peer", "objective": quality}
    peer |= {"target": target, "against": "P"}
    benchmarks = [
        {"group": "a", "extra_info": ours, "least": [1e-6, 2e-6]},
        {"group": "a", "extra_info": peer, "least": [1e-5, 1.2e-5]},
    ]
    ((_, name, ratio, _, result, _),) = contest_rows(benchmarks)
    assert (name, result) == ("P", verdict)
    assert ratio.startswith("8 (6 to 10) times as fast")


def test_the_slope_is_the_power_of_the_larger_sizes():
    sizes = 2.0 ** np.arange(8)
    costs = sizes**1.5 + np.where(sizes < 16, 5.0, 0.0)
    assert growth.slope(sizes, costs) == pytest.approx(1.5)


@pytest.mark.parametrize("joints", growth.SIZES["joints"])
def test_an_arm_of_many_joints_keeps_clear_of_singular_poses(joints):
    posterior = take(40, joints).filtered(500, np.random.default_rng(1))
    assert len(posterior.mean) == 41 and not posterior.outside.any()


def test_every_measurement_has_its_place_on_the_page_and_a_missed_limit_is_seen(
    tmp_path,
):
    measured = {name: json.loads((RESULTS / f"{name}.json").read_text())
                for name in ("contests", "equal_bytes", "start")}  # fmt: skip
    measured["equal_bytes"]["hashes"][[*SETTINGS][2]]["density"] = "another"
    measured["start"]["compiled_seconds"] = 20.0
    for name, content in measured.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    rows = pd.read_csv(RESULTS / "growth.csv")
    rows.loc[rows["over"] == "joints", "time_slope"] = 3.5
    rows.to_csv(tmp_path / "growth.csv", index=False)
    text = page(tmp_path)
    assert "| density | equal | **other** | equal |" in text
    assert "20 s | ≤ 15 s | **missed**" in text and "make bench-scale" in text
    assert "| joints | 2 to 12 | 3.50 (≤ 3: **missed**) |" in text
    assert page(RESULTS) == RESULTS.with_suffix(".md").read_text()


def test_a_stage_takes_the_time_until_the_next_one_starts():
    clock = iter([0.0, 2.0, 5.0, 9.0])
    lines = ["", "Running stage 'track':", "> python", "Running stage 'fit@wishart':"]
    seconds = stage_seconds(lines, lambda: next(clock))
    assert seconds == {"start": 2.0, "track": 3.0, "fit@wishart": 4.0}


def test_times_reach_the_page_and_the_readme():
    spent = {"seconds": 250.4, "processor_seconds": 391.0}
    times = {"machine": "A 1", "environment": spent, "smoke": {"ur5": spent}}
    times["repro"] = spent | {"stages": {"track": 19.24}}
    text = times_table(times)
    assert "| `make repro` | 250 | 391 |" in text and "| track | 19.2 |" in text
    readme = (ROOT / "README.md").read_text()
    changed = with_times(readme, times)
    assert "`make repro` 250 s" in changed and "391 s on ur5" in changed
    assert with_times(changed, measured_times(RESULTS)) == readme
