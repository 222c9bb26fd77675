"""What a run leaves is read again as it was: every digit, every gap, every infinity."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.errors import ContractError
from pipeline.verdicts.run import Run, read_run, read_runs

TABLE = pd.DataFrame(
    {"steps": ["all", "moving, ‖J⁻¹‖: 1, 2"], "mean": [0.1 + 0.2, -np.inf], "low": [np.nan, 1e-300]}
)
RUN = Run(
    "lab",
    "paper",
    False,
    ["base", "elbow"],
    ["x", "z"],
    {"a": "additive", "g": "gaussian", "gf": "gaussian"},
    {"motion": {"x": 1 / 3}},
    {"scores": TABLE},
)


def test_a_run_comes_back_from_its_file(tmp_path):
    file = tmp_path / "lab.json"
    file.write_text(RUN.to_json(), encoding="utf-8")
    again = read_run(file)
    assert (
        again.metrics == RUN.metrics
        and again.arm == RUN.arm == (("base", "elbow"), ("x", "z"))
        and again.models == RUN.models
        and again.matrix_models == ["g", "gf"]
    )
    pd.testing.assert_frame_equal(again.tables["scores"], TABLE, check_exact=True)
    assert again.evidence.keys() == {"metrics/motion", "tables/scores"}
    assert again.to_json() == RUN.to_json()


def test_a_row_of_a_table_is_a_line_of_the_file():
    lines = RUN.to_json().splitlines()
    assert (
        sum("0.30000000000000004" in line for line in lines)
        == 1
        == sum("1e-300" in line for line in lines)
    )


def test_the_run_at_hand_comes_first_and_the_others_by_name(tmp_path):
    for name in ("b", "a", "c"):
        (tmp_path / f"{name}.json").write_text(
            RUN.to_json().replace('"lab"', f'"{name}"'), encoding="utf-8"
        )
    assert [run.dataset for run in read_runs(tmp_path, first="c")] == ["c", "a", "b"]
    with pytest.raises(ContractError, match="no evidence of the dataset d"):
        read_runs(tmp_path, first="d")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"tables": 3}',
        '{"dataset": "lab", "tables": {}}',
        RUN.to_json().replace("scale", "size"),
    ],
)
def test_a_file_that_is_no_run_is_refused_by_name(tmp_path, text):
    (tmp_path / "lab.json").write_text(text, encoding="utf-8")
    with pytest.raises(ContractError, match=r"lab\.json"):
        read_run(tmp_path / "lab.json")
