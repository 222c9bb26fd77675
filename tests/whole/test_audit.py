"""The audit of the experiment itself, on the smoke scale, cut down to the stages that the wrench
needs.
"""

from __future__ import annotations

import json
import shutil
import sys
from hashlib import md5
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf
from project_copy import GIT, run

pytestmark = pytest.mark.slow

STAGES = ("choose", "configure", "files", "ingest", "wrench")
NUMBERS = "reports/metrics/wrench.json"


def test_a_constant_altered_without_a_run_is_caught_and_another_rounding_is_not(
    reproduced, tmp_path
):
    folder = Path(shutil.copytree(reproduced, tmp_path / "altered", symlinks=True))
    experiment = OmegaConf.to_container(OmegaConf.load(folder / "dvc.yaml"))
    stages = {name: experiment["stages"][name] for name in STAGES}
    stages["ingest"]["matrix"] = {"part": ["force"]}
    OmegaConf.save({"stages": stages}, folder / "dvc.yaml")
    # how many draws of the model are tested for every measured sample of the force
    code = folder / "pipeline/wrench/measured_force.py"
    assert code.read_text().count("\nDRAWS = 10\n") == 1
    code.write_text(code.read_text().replace("\nDRAWS = 10\n", "\nDRAWS = 9\n"))
    # and as if the committed run had rounded the last bit of a number of the study otherwise
    numbers, lock = folder / NUMBERS, folder / "dvc.lock"
    old = numbers.read_bytes()
    values = json.loads(old)
    numbers.unlink()
    numbers.write_text(
        json.dumps(
            values | {"study_m3_mean_error": float(np.nextafter(values["study_m3_mean_error"], 1))},
            indent=2,
        )
        + "\n"
    )
    lock.write_text(
        lock.read_text().replace(md5(old).hexdigest(), md5(numbers.read_bytes()).hexdigest())
    )
    assert run(*GIT, "commit", "-qam", "altered", cwd=folder).returncode == 0

    done = run(
        sys.executable,
        "-m",
        "pipeline",
        "audit",
        str(tmp_path / "audit"),
        "--json",
        str(tmp_path / "audit.json"),
        cwd=folder,
    )
    assert (
        done.returncode == 1
        and "error: audit: what is committed is not what its code gives" in done.stderr
    ), done.stderr
    result = json.loads((tmp_path / "audit.json").read_text())
    outputs = {
        output["path"]: output for output in result["outputs"] if output["verdict"] != "not run"
    }
    assert {path: output["verdict"] for path, output in outputs.items()} == {
        "data/dataset.txt": "identical",
        "data/config.yaml": "identical",
        "data/raw/youbot/recordings": "identical",
        "data/raw/youbot/truth": "identical",
        "data/files": "identical",
        "data/ingest/force": "identical",
        "data/wrench": "different",
        NUMBERS: "different",
    }
    assert (
        result["outdated"] == {"wrench": ["pipeline/wrench"]}
        and result["locks"]["data/raw/youbot/dvc.lock"]
    )
    differences = {
        difference["where"]: difference for difference in outputs[NUMBERS]["differences"]
    }
    rounded = differences.pop("study_m3_mean_error")
    assert rounded["within"] and 0 < rounded["relative"] < 3e-16
    assert differences and all(
        name.startswith(("C1_", "C2_", "C3_")) and not difference["within"]
        for name, difference in differences.items()
    )
    assert all(
        difference["where"].startswith("force_test.parquet")
        for difference in outputs["data/wrench"]["differences"]
    )
