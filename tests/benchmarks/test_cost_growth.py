"""What measures how cost grows: slopes, the memory of a call, and that every call that is measured
can still be made.
"""

from __future__ import annotations

import json
from pathlib import Path

import cost_growth
import numpy as np
import pandas as pd
import pytest
from growth_figure import draw
from project_copy import run
from scenario import many_joints, take

EVERY_SMALLEST_CALL = """
recording = cost_growth.in_a_process(depth_scenario.record, Path("."), 2)
costs = {
    over: cost_growth.in_a_process(cost_growth.cost, over, sizes[0], recording)
    for over, sizes in cost_growth.SIZES.items()
}
print(json.dumps(costs))
"""
# 8 MB a size, every page touched; the 80 MB that are there before are not the call's
ARRAYS = """
before = np.ones(10_000_000)
cost_growth.call_of = lambda over, size, recording: lambda: before[: size * 1_000_000].copy()
cost_growth.SIZES = {"arrays": (1, 4)}
costs = {size: cost_growth.in_a_process(cost_growth.cost, "arrays", size, None) for size in (4, 8)}
print(json.dumps(costs))
"""


def measured(script: str, folder: Path) -> dict[str, tuple[float, float]]:
    """What a script prints of its own process: it is forked for every measurement, which one of
    many threads, as here, must not be.
    """
    imports = (
        "import json, sys\nfrom pathlib import "
        f"Path\nsys.path.append({str(Path(__file__).parent)!r})\n"
    )
    done = run(
        "python",
        "-c",
        imports + "import cost_growth, depth_scenario\nimport numpy as np\n" + script,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_the_slope_is_the_power_of_the_larger_sizes():
    sizes = 2.0 ** np.arange(8)
    assert cost_growth.slope(sizes, 3 * sizes**1.5) == pytest.approx(1.5)
    # what every call costs, whatever its size, tells in the smaller half
    assert cost_growth.slope(sizes, sizes + np.where(sizes < 16, 5.0, 0.0)) == pytest.approx(1.0)


@pytest.mark.parametrize("joints", cost_growth.SIZES["joints"])
def test_an_arm_of_many_joints_keeps_clear_of_singular_poses(joints):
    motion = take(40, many_joints(joints))
    posterior = motion.filtered(500, np.random.default_rng(1))
    assert len(posterior.mean) == 41 and not posterior.outside.any()


@pytest.mark.slow
def test_every_call_that_is_measured_can_be_made(tmp_path):
    costs = measured(EVERY_SMALLEST_CALL, tmp_path)
    assert set(costs) == set(cost_growth.SIZES)
    assert all(seconds > 0 and megabytes >= 0 for seconds, megabytes in costs.values())


@pytest.mark.slow
def test_the_memory_is_that_of_the_call(tmp_path):
    for size, (_, megabytes) in measured(ARRAYS, tmp_path).items():
        assert megabytes == pytest.approx(8 * int(size), rel=0.1)


def test_a_memory_that_does_not_grow_is_not_drawn():
    table = pd.DataFrame(
        {
            "over": "takes",
            "size": [1, 2, 4],
            "seconds": [1.0, 2.0, 4.0],
            "megabytes": [0.1, 0.0, 0.2],
            "time_slope": 1.0,
        }
    )
    time, memory = draw(table.assign(memory_slope=np.nan)).axes
    labels = [
        [line.get_label() for line in axes.get_lines() if not line.get_label().startswith("_")]
        for axes in (time, memory)
    ]
    assert labels == [["takes: 1.00"], []]


def test_memory_that_cannot_be_told_has_no_place_on_its_axis():
    costs = {
        "seconds": [1.0, 2.0, 4.0],
        "megabytes": [0.0, 0.01, 2.0],
        "time_slope": 1.0,
        "memory_slope": -0.001,
    }
    time, memory = draw(pd.DataFrame({"over": "agents", "size": [1, 2, 4]} | costs)).axes
    (growth,) = [line for line in memory.get_lines() if line.get_label() == "agents: 0.00"]
    assert growth.get_xdata().tolist() == [4] and len(time.get_lines()[0].get_xdata()) == 3
