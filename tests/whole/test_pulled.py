"""Public recordings that DVC brings from their repositories, pinned by revision and hash."""

import hashlib
import shutil
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from project_copy import GIT, ROOT, succeeds

from pipeline.core.errors import RecordingError
from pipeline.recordings.inventory import listing, raw_folder

PULLED = ROOT / "data/recordings"
BESIDE = ROOT.parent / "shared/recordings"
IMPORTS = sorted(PULLED.rglob("*.dvc"))
beside = pytest.mark.skipif(
    not BESIDE.is_dir(),
    reason="no recordings beside the project",
)


def content(file: Path) -> tuple[dict, dict]:
    """Dependency and output of an import."""
    stage = yaml.safe_load(file.read_text())
    return stage["deps"][0], stage["outs"][0]


def recording_of(file: Path) -> Path:
    """The recording of an import, beside the project."""
    return BESIDE / file.relative_to(PULLED).with_suffix("")


def test_every_public_recording_is_pinned_by_revision_and_hash():
    imports = [file for file in IMPORTS if file.is_file()]
    arms = {file.relative_to(PULLED).parts[0] for file in imports}
    assert arms == {"ur5", "lwr4", "kr300", "youbot_real"}

    for file in imports:
        source, out = content(file)
        assert len(source["repo"]["rev_lock"]) == 40 and out["path"] == file.stem
        if recording_of(file).is_file():
            digest = hashlib.md5(recording_of(file).read_bytes()).hexdigest()
            assert digest == out["md5"]


def test_a_dataset_finds_pulled_recordings_first_and_the_message_names_the_command(
    tmp_path,
    monkeypatch,
):
    monkeypatch.chdir(tmp_path)
    folder = Path("data/recordings/arm")
    folder.mkdir(parents=True)
    (folder / "log.csv.dvc").touch()
    assert raw_folder("../logs/arm") == Path("../logs/arm")
    with pytest.raises(
        RecordingError,
        match=r"`dvc --cd data/recordings pull -R arm` brings them",
    ):
        listing(Path("../logs/arm"))

    (folder / "log.csv").write_text("1\n")
    assert raw_folder("../logs/arm") == folder and raw_folder("logs/arm") == Path(
        "logs/arm",
    )
    assert list(listing(folder)["file"]) == ["log.csv"]


def test_copies_take_the_pulled_recordings_and_name_the_command_without_them(
    tmp_path,
    monkeypatch,
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
    imports = [file for file in IMPORTS if file.relative_to(PULLED).parts[0] == "kr300"]
    origin = tmp_path / "origin"
    for file in imports:
        copy = origin / content(file)[0]["path"]
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(recording_of(file), copy)
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "copy"]):
        succeeds(*GIT, *words, cwd=origin)
    copied = succeeds(*GIT, "rev-parse", "HEAD", cwd=origin).strip()

    project = tmp_path / "project"
    recordings = project / "data/recordings"
    (project / ".dvc").mkdir(parents=True)
    shutil.copyfile(PULLED / ".dvc/config", project / ".dvc/config")
    succeeds(*GIT, "init", "-q", cwd=project)
    for file in imports:
        pinned = content(file)[0]["repo"]
        target = recordings / file.relative_to(PULLED)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(file.read_text().replace(pinned["rev_lock"], copied))
    url = f'[url "{origin.as_uri()}"]\n  insteadOf = {pinned["url"]}\n'
    (tmp_path / ".gitconfig").write_text(url)

    command = "dvc --cd data/recordings pull -R kr300".split()
    succeeds(*command, cwd=project, home=False, HOME=str(tmp_path))
    for file in imports:
        pulled = recordings / file.relative_to(PULLED).with_suffix("")
        assert pulled.read_bytes() == recording_of(file).read_bytes()
