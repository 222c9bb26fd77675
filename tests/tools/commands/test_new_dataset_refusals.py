"""What new-dataset refuses, what it leaves as it is, and where it puts an inventory."""

from __future__ import annotations

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from pipeline.core.errors import ConfigError, PipelineError
from pipeline.tools.new_dataset.command import run


def written(root: Path, name: str) -> tuple[dict, dict]:
    """Datasheet and option file, as plain data."""
    files = (root / f"data/raw/{name}/dataset.yaml", root / f"conf/dataset/{name}.yaml")
    return tuple(OmegaConf.to_container(OmegaConf.load(file)) for file in files)


def test_recordings_in_the_datasets_own_folder_need_no_inventory(root, exports):
    place = root / "data/raw/lab/recordings"
    place.parent.mkdir(parents=True)
    exports.rename(place)
    run(["lab", "--from", "data/raw/lab/recordings"])
    assert written(root, "lab")[0]["recordings"] == "data/raw/lab/recordings"
    assert not (place.parent / "dvc.yaml").exists()


def test_recordings_that_are_read_in_place_have_one(root, exports):
    run(["lab", "--from", str(exports)])
    stage = OmegaConf.to_container(OmegaConf.load(root / "data/raw/lab/dvc.yaml"))["stages"][
        "inventory"
    ]
    assert stage["outs"] == [{"data/raw/lab/inventory.csv": {"cache": False, "persist": True}}]


@pytest.mark.parametrize(
    "there", ["data/raw/lab/dataset.yaml", "conf/dataset/lab.yaml", "data/raw/lab/dvc.yaml"]
)
def test_nothing_is_overwritten(root, exports, there):
    (root / there).parent.mkdir(parents=True, exist_ok=True)
    (root / there).write_text("mine\n")
    with pytest.raises(ConfigError, match="nothing is overwritten") as refused:
        run(["lab", "--from", str(exports)])
    assert refused.value.evidence["file"] == root / there
    files = [file for file in root.rglob("*") if file.is_file()]
    assert (root / there).read_text() == "mine\n" and sorted(files) == sorted(
        [root / there, root / "params.yaml"]
    )


@pytest.mark.parametrize("name", ["", "1st", "a/b", "../up", "a b", "ü"])
def test_a_name_that_is_none_is_refused(root, exports, name):
    with pytest.raises(ConfigError, match="cannot name a dataset"):
        run([name, "--from", str(exports)])


def test_a_folder_that_is_none_and_a_place_that_is_no_project_are_refused(
    root, exports, tmp_path, monkeypatch
):
    with pytest.raises(PipelineError, match="no such folder"):
        run(["lab", "--from", str(tmp_path / "nothing")])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="project's root"):
        run(["lab", "--from", str(exports)])
