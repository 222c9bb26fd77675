"""Public recordings that DVC brings from their repositories, pinned by revision and hash."""

import hashlib
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from project_copy import ROOT

from pipeline.core.errors import RecordingError
from pipeline.recordings.inventory import listing, raw_folder

PULLED, BESIDE = ROOT / "data/recordings", ROOT.parent / "shared/recordings"
IMPORTS = sorted(PULLED.rglob("*.dvc"))
beside = pytest.mark.skipif(
    not BESIDE.is_dir(), reason="no recordings beside the project"
)


def content(file: Path) -> tuple[dict, dict]:
    """Dependency and output of an import."""
    stage = yaml.safe_load(file.read_text())
    return stage["deps"][0], stage["outs"][0]


def test_every_public_recording_is_pinned_by_revision_and_hash():
    imports = [file for file in IMPORTS if file.is_file()]
    assert {file.relative_to(PULLED).parts[0] for file in imports} == {
        "ur5",
        "lwr4",
        "kr300",
        "youbot_real",
    }
    for file in imports:
        source, out = content(file)
        assert len(source["repo"]["rev_lock"]) == 40 and out["path"] == file.stem
        if (recording := BESIDE / file.relative_to(PULLED).with_suffix("")).is_file():
            assert hashlib.md5(recording.read_bytes()).hexdigest() == out["md5"]


def test_a_dataset_finds_pulled_recordings_first_and_the_message_names_the_command(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    folder = Path("data/recordings/arm")
    folder.mkdir(parents=True)
    (folder / "log.csv.dvc").touch()
    assert raw_folder("../logs/arm") == Path("../logs/arm")
    with pytest.raises(
        RecordingError, match=r"`dvc --cd data/recordings pull -R arm` brings them"
    ):
        listing(Path("../logs/arm"))
    (folder / "log.csv").write_text("1\n")
    assert raw_folder("../logs/arm") == folder and raw_folder("logs/arm") == Path(
        "logs/arm"
    )
    assert list(listing(folder)["file"]) == ["log.csv"]


def test_copies_take_the_pulled_recordings_and_name_the_command_without_them(
    tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(ROOT / "tests/whole")
    copies = import_module("copies")
    monkeypatch.chdir(tmp_path)
    assert copies.recordings_of("youbot_sway") is None
    folder = Path("data/recordings/youbot_real")
    folder.mkdir(parents=True)
    with pytest.raises(RecordingError, match=r"pull -R youbot_real` brings them"):
        copies.recordings_of("youbot_real")
    (folder / "log.txt").write_text("1\n")
    assert copies.recordings_of("youbot_real") == folder
    pulled = Path("data/recordings/ur5")
    pulled.mkdir()
    (pulled / "log.csv").write_text("1\n")
    assert copies.recordings_of("ur5") == pulled


@pytest.mark.slow
@beside
def test_one_command_brings_the_recordings_from_a_copy_of_their_repository(tmp_path):
    origin, project = tmp_path / "origin", tmp_path / "project/data/recordings"
    imports = [file for file in IMPORTS if file.relative_to(PULLED).parts[0] == "kr300"]

    def git(folder: Path, *words: str) -> str:
        identity = ["-c", "user.name=a", "-c", "user.email=a@b.example"]
        return subprocess.check_output(
            ["git", *identity, *words], cwd=folder, text=True
        ).strip()

    for file in imports:
        copy = origin / content(file)[0]["path"]
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(
            (BESIDE / file.relative_to(PULLED).with_suffix("")).read_bytes()
        )
    git(tmp_path, "init", "-q", str(origin))
    git(origin, "add", "-A")
    git(origin, "commit", "-qm", "copy")
    copied = git(origin, "rev-parse", "HEAD")
    project.mkdir(parents=True)
    git(tmp_path, "init", "-q", str(tmp_path / "project"))
    (project / ".dvc").mkdir()
    (project / ".dvc/config").write_bytes((PULLED / ".dvc/config").read_bytes())
    for file in imports:
        source = content(file)[0]["repo"]
        (to := project / file.relative_to(PULLED)).parent.mkdir(exist_ok=True)
        to.write_text(file.read_text().replace(source["rev_lock"], copied))
    (tmp_path / ".gitconfig").write_text(
        f'[url "{origin.as_uri()}"]\n  insteadOf = {source["url"]}\n'
    )
    words = [
        sys.executable,
        "-m",
        "dvc",
        "--cd",
        "data/recordings",
        "pull",
        "-R",
        "kr300",
    ]
    environment = os.environ | {"HOME": str(tmp_path), "DVC_NO_ANALYTICS": "1"}
    subprocess.run(words, cwd=tmp_path / "project", env=environment, check=True)
    for file in imports:
        name = file.relative_to(PULLED).with_suffix("")
        assert (project / name).read_bytes() == (BESIDE / name).read_bytes()
