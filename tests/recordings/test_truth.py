"""A filter is held against the truth where it weighs by the cameras that measured the joints."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from made_options import made

from pipeline.core import contracts
from pipeline.core.options.dataset import Dataset
from pipeline.recordings.truth import held_against, truth_of

TRUE = pd.DataFrame({"take": ["a"], "part": ["test"], "k": [0], "t": [0.0], "q:arm": [0.5]})


@pytest.mark.parametrize(
    ("measurement", "synthetic", "true"),
    [("tip", True, True), ("tip", False, False), ("encoders", True, False), ("depth", True, False)],
)
def test_only_by_the_tip_and_only_where_there_is_a_truth(
    tmp_path, monkeypatch, measurement, synthetic, true
):
    monkeypatch.chdir(tmp_path)
    dataset = made(Dataset, recordings="raw/t/recordings", measurement=measurement)
    assert truth_of(dataset) == Path("raw/t/truth")
    if synthetic:
        Path("raw/t/truth").mkdir(parents=True)
        contracts.write(TRUE, "true_joints", truth_of(dataset))
    measured = TRUE.assign(**{"q:arm": 0.4})
    table, is_true = held_against(measured, dataset)
    assert is_true == true and table["q:arm"].tolist() == [0.5 if true else 0.4]
