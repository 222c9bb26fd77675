"""The audit of the experiment itself, on the smoke scale, cut down to the stages that the wrench needs."""

from __future__ import annotations

import json
import shutil
import sys
from hashlib import md5
from pathlib import Path

import numpy as np
import pytest
from conftest import GIT, run
from omegaconf import OmegaConf

pytestmark = pytest.mark.slow

STAGES = ("choose", "configure", "ingest", "wrench")
NUMBERS = "reports/metrics/wrench.json"


def test_a_constant_altered_without_a_run_is_caught_and_another_rounding_is_not(reproduced, tmp_path):
    folder = Path(shutil.copytree(reproduced, tmp_path / "altered", symlinks=True))
    experiment = OmegaConf.to_container(OmegaConf.load(folder / "dvc.yaml"))
    OmegaConf.save({"stages": {name: experiment["stages"][name] for name in STAGES}}, folder / "dvc.yaml")
    # how many draws of the model are tested for every measured sample of the force
    code = folder / "pipeline/wrench/comparison.py"
    assert code.read_text().count("\nDRAWS = 10 ") == 1
    code.write_text(code.read_text().replace("\nDRAWS = 10 ", "\nDRAWS = 9 "))
    # and as if the committed run had rounded the last bit of a number of the study otherwise
    numbers, lock = folder / NUMBERS, folder / "dvc.lock"
    old = numbers.read_bytes()
    values = json.loads(old)
    numbers.unlink()
    numbers.write_text(json.dumps(values | {"study_m3_mean_error": float(np.nextafter(values["study_m3_mean_error"], 1))}, indent=2) + "\n")
    lock.write_text(lock.read_text().replace(md5(old).hexdigest(), md5(numbers.read_bytes()).hexdigest()))
    assert run(*GIT, "commit", "-qam", "altered", cwd=folder).returncode == 0

    done = run(sys.executable, "-m", "pipeline", "audit", str(tmp_path / "audit"), "--json", str(tmp_path / "audit.json"), cwd=folder)
    assert done.returncode == 1 and "error: audit: what is committed is not what its code gives" in done.stderr, done.stderr
    found = json.loads((tmp_path / "audit.json").read_text())
    outputs = {output["path"]: output for output in found["outputs"] if output["verdict"] != "not run"}
    assert {path: output["verdict"] for path, output in outputs.items()} == {
        "data/dataset.txt": "identical",
        "data/config.yaml": "identical",
        "data/raw/youbot/recordings": "identical",
        "data/raw/youbot/truth": "identical",
        "data/ingest": "identical",
        "data/wrench": "different",
        NUMBERS: "different",
    }
    assert found["outdated"] == {"wrench": ["pipeline/wrench"]} and found["locks"]["data/raw/youbot/dvc.lock"]
    differences = {of["where"]: of for of in outputs[NUMBERS]["differences"]}
    rounded = differences.pop("study_m3_mean_error")
    assert rounded["within"] and 0 < rounded["relative"] < 3e-16
    assert differences and all(name.startswith(("C1_", "C2_", "C3_")) and not of["within"] for name, of in differences.items())
    assert all(of["where"].startswith("force_test.parquet") for of in outputs["data/wrench"]["differences"])
