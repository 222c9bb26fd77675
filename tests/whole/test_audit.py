"""The audit of a project whose pipeline is cut down to the stages of the wrench, on the smoke
scale.
"""

from __future__ import annotations

import re

import pytest
from omegaconf import OmegaConf
from project_copy import GIT, copy_reproduced, error_line, run, succeeds

from pipeline.core.errors import PipelineError
from pipeline.tools.audit.command import clone_commit

STAGES = ("choose", "configure", "files", "ingest", "wrench")


def test_recordings_beside_the_project_lie_beside_the_clone(tmp_path):
    with pytest.raises(PipelineError, match="needs a repository with a commit"):
        clone_commit(tmp_path, tmp_path / "audit")
    project = tmp_path / "project"
    sheet = project / "data/raw/arm/dataset.yaml"
    sheet.parent.mkdir(parents=True)
    sheet.write_text("recordings: ../logs/arm\n")
    (tmp_path / "logs/arm").mkdir(parents=True)
    succeeds(*GIT, "init", "-q", cwd=project)
    succeeds(*GIT, "add", ".", cwd=project)
    succeeds(*GIT, "commit", "-qm", "arm", cwd=project)
    with pytest.raises(PipelineError, match=r"dvc\.lock is not committed"):
        clone_commit(project, tmp_path / "audit")
    (project / "dvc.lock").write_text("schema: '2.0'\nstages: {}\n")
    succeeds(*GIT, "add", ".", cwd=project)
    succeeds(*GIT, "commit", "-qm", "lock", cwd=project)
    assert (clone_commit(project, tmp_path / "audit") / "../logs/arm").is_dir()


@pytest.mark.slow
def test_a_constant_that_was_edited_without_a_run_is_found(reproduced, tmp_path):
    folder = copy_reproduced(reproduced, tmp_path / "altered")
    stages = OmegaConf.to_container(OmegaConf.load(folder / "dvc.yaml"))["stages"]
    stages = {name: stages[name] for name in STAGES}
    stages["ingest"]["matrix"] = {"part": ["force"]}
    OmegaConf.save({"stages": stages}, folder / "dvc.yaml")
    for other in [*folder.glob("pipeline/**/dvc.yaml"), *folder.glob("data/raw/*/dvc.yaml")]:
        if other.parent.name != "youbot":
            other.unlink()

    def audit(name: str):
        succeeds(*GIT, "commit", "-qam", name, cwd=folder)
        return run("python", "-m", "pipeline", "audit", str(tmp_path / name), cwd=folder)

    done = audit("sound")
    assert done.returncode == 0 and "every file equal to the commit" in done.stdout, done.stderr
    # draws of the model for every measured sample of the force
    file = folder / "pipeline/wrench/measured_force.py"
    edited, found = re.subn(r"(?m)^DRAWS = 10\b", "DRAWS = 9", file.read_text())
    assert found == 1
    file.write_text(edited)
    done = audit("edited")
    changed = {line[3:] for line in done.stdout.splitlines() if line.startswith(" M ")}
    assert changed == {"dvc.lock"}, done.stderr
    assert "differ from the commit" in error_line(done)
