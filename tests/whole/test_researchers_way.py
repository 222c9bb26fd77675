"""From the folder of a real robot's logs to its model card: five commands and one line of
params.yaml, none of which is refused.
"""

from __future__ import annotations

import os
import time

import pytest
from omegaconf import OmegaConf
from project_copy import ROOT, SMOKE, copy_project, run, set_parameters

RECORDINGS = ROOT.parent / "shared/recordings"
pytestmark = pytest.mark.slow
# what nobody but the researcher knows
KNOWN = {
    "ur5": {"robot.urdf": "pipeline/arm/ur5.urdf", "robot.tool": "flange", "number": "5"},
    "lwr4": {"number": "1"},
}


@pytest.mark.parametrize("robot", sorted(KNOWN))
def test_logs_become_a_model_card(robot, tmp_path):
    if not (RECORDINGS / robot).is_dir():
        pytest.skip("the recordings of the real robots are not here")
    folder = tmp_path / "project"
    known = {"about.subject": "an arm", "about.source": "its logs"} | KNOWN[robot]
    number = known.pop("number")
    copy_project(folder)
    set_parameters(folder, **SMOKE | {"dataset": "lab", "models": "[additive, wishart]"})
    exports = os.path.relpath(RECORDINGS / robot, folder)
    given = [word for key, value in known.items() for word in ("--set", f"{key}={value}")]
    new_dataset = ["new-dataset", "lab", "--from", exports]
    commands = [
        ["python", "-m", "pipeline", "inspect", exports],
        # the table of motions, by which the number is chosen
        ["python", "-m", "pipeline", *new_dataset, *given, "--suggested"],
        ["python", "-m", "pipeline", "new-dataset", "lab", "--motion", number],
        ["python", "-m", "pipeline", "check"],
        ["dvc", "repro", "report"],
    ]
    for command in commands:
        begun = time.monotonic()
        done = run(*command, cwd=folder)
        print(f"{time.monotonic() - begun:.1f} s: {' '.join(command)}\n{done.stdout[-3000:]}")
        assert done.returncode == 0, done.stderr
    dataset = OmegaConf.load(folder / "data/config.yaml").dataset
    assert dataset.name == "lab" and len(dataset.joint_log.start) == len(dataset.robot.joints)
    card = (folder / "reports/lab/model_card.md").read_text()
    assert "lab" in card and "additive" in card
