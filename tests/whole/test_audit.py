"""The audit of a project whose pipeline is cut down to the stages of the wrench, on the smoke
scale.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from project_copy import GIT, run

from pipeline.core.errors import PipelineError
from pipeline.tools.audit.command import clone_commit

STAGES = ("choose", "configure", "files", "ingest", "wrench")


def test_a_folder_without_a_commit_is_refused(tmp_path):
    with pytest.raises(PipelineError, match="needs a repository with a commit"):
        clone_commit(tmp_path, tmp_path / "audit")


def test_recordings_beside_the_project_lie_beside_the_clone(tmp_path):
    project = tmp_path / "project"
    sheet = project / "data/raw/arm/dataset.yaml"
    sheet.parent.mkdir(parents=True)
    sheet.write_text("recordings: ../logs/arm\n")
    (tmp_path / "logs/arm").mkdir(parents=True)
    run("git", "init", "-q", cwd=project)
    run(*GIT, "add", ".", cwd=project)
    assert run(*GIT, "commit", "-qm", "arm", cwd=project).returncode == 0
    with pytest.raises(PipelineError, match=r"dvc\.lock is not committed"):
        clone_commit(project, tmp_path / "audit")
    (project / "dvc.lock").write_text("schema: '2.0'\nstages: {}\n")
    run(*GIT, "add", ".", cwd=project)
    run(*GIT, "commit", "-qm", "lock", cwd=project)
    clone = clone_commit(project, tmp_path / "audit")
    assert (clone / "../logs/arm").is_dir()


@pytest.mark.slow
def test_a_constant_that_was_edited_without_a_run_is_found(reproduced, tmp_path):
    folder = Path(shutil.copytree(reproduced, tmp_path / "altered", symlinks=True))
    experiment = OmegaConf.to_container(OmegaConf.load(folder / "dvc.yaml"))
    stages = {name: experiment["stages"][name] for name in STAGES}
    stages["ingest"]["matrix"] = {"part": ["force"]}
    OmegaConf.save({"stages": stages}, folder / "dvc.yaml")
    lock = OmegaConf.to_container(OmegaConf.load(folder / "dvc.lock"))
    kept = {name: one for name, one in lock["stages"].items() if name.partition("@")[0] in STAGES}
    OmegaConf.save({"schema": lock["schema"], "stages": kept}, folder / "dvc.lock")
    for other in [*folder.glob("pipeline/**/dvc.yaml"), *folder.glob("data/raw/*/dvc.yaml")]:
        if other.parent.name != "youbot":
            other.unlink()

    def audit(name: str) -> tuple[int, str, str]:
        assert run(*GIT, "commit", "-qam", name, cwd=folder).returncode == 0
        done = run(sys.executable, "-m", "pipeline", "audit", str(tmp_path / name), cwd=folder)
        return done.returncode, done.stdout, done.stderr

    code, output, errors = audit("sound")
    assert code == 0 and "every file equal to the commit" in output, output + errors

    # draws of the model for every measured sample of the force
    file = folder / "pipeline/wrench/measured_force.py"
    assert file.read_text().count("\nDRAWS = 10 ") == 1
    file.write_text(file.read_text().replace("\nDRAWS = 10 ", "\nDRAWS = 9 "))
    code, output, errors = audit("edited")
    changed = {line[3:] for line in output.splitlines() if line.startswith(" M ")}
    assert code == 1 and changed == {"dvc.lock"}, output + errors
    assert "error: audit: 1 file from the commit" in errors
