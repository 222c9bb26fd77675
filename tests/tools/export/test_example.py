"""The worked example of the tool's README runs as it stands there."""

from __future__ import annotations

import re

import numpy as np
import pytest
from exported_models import write_model
from source_code import ROOT

pytest.importorskip("filterpy", reason="filterpy is missing; `make` installs requirements.lock")

PAGE = (ROOT / "pipeline/tools/export/README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.filterwarnings("ignore::pipeline.models.exported.OutsideRanges")
def test_filters_come_nearer_than_what_is_measured_and_the_planner_swings_out(
    tmp_path, chain, monkeypatch
):
    write_model(tmp_path / "model.json", "wishart", chain, speed=0.1)
    monkeypatch.chdir(tmp_path)
    known: dict = {}
    for block in BLOCKS:
        exec(block, known)
    errors = {
        name: np.sqrt(np.mean(np.subtract(known[name], known["path"]) ** 2))
        for name in ("measured", "by_ukf", "by_particles")
    }
    assert len(BLOCKS) == 4 and len(known["by_ukf"]) == 60
    assert 0.004 < errors["measured"] < 0.006
    assert max(errors["by_ukf"], errors["by_particles"]) < 0.7 * errors["measured"]
    # the swing is less uncertain than the straight way and than one to the other side
    best, cost = known["best"], known["variance"]
    assert abs(best) > 0.002 and cost(best) < min(cost(0.0), cost(-best))
