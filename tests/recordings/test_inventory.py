"""Which raw files each part of the analysis reads: what a pattern of the datasheet names is its
part's alone, and what none names belongs to all.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from params_file import parameters

from pipeline.core import config
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.recordings.inventory import PARTS, by_part, listing
from pipeline.stages import files

FILES = {
    "motion": ("trajectory.csv", "optitrack/train_001.csv", "optitrack/test_001.csv"),
    "depth": ("kinect/intrinsics.yaml", "kinect/test_001/depth.txt", "kinect/test_001/depth/0.png"),
    "force": ("force/C1.csv", "force/C2.csv", "force/C3.csv"),
}
UNCLAIMED = "notes/setup.txt"


@pytest.fixture
def recordings(tmp_path, monkeypatch) -> Path:
    """The raw files of a youBot session, and a note that no pattern of its datasheet names."""
    dataset = config.compose_config(parameters(tmp_path)).dataset
    monkeypatch.chdir(tmp_path)
    folder = Path(dataset.recordings)
    for name in (*(name for named in FILES.values() for name in named), UNCLAIMED):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    return folder


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return config.compose_config(parameters(tmp_path)).dataset


def test_each_part_has_the_files_that_its_patterns_name_and_what_none_names(recordings, dataset):
    parts = by_part(listing(recordings), dataset)
    assert tuple(parts) == PARTS
    for part, named in FILES.items():
        assert set(parts[part]["file"]) == {*named, UNCLAIMED}


def test_without_an_instrument_its_files_might_be_read_with_any(recordings, dataset):
    dataset.force = None
    parts = by_part(listing(recordings), dataset)
    for part in ("motion", "depth"):
        assert set(parts[part]["file"]) == {*FILES[part], *FILES["force"], UNCLAIMED}


def test_an_edit_of_a_force_log_changes_the_list_of_the_force_alone(recordings, tmp_path):
    (tmp_path / "data/config.yaml").parent.mkdir(exist_ok=True)
    config.write_config(parameters(tmp_path))
    stages = {"files": {"params": [{str(config.COMPOSED): ["dataset"]}]}}
    (tmp_path / "dvc.yaml").write_text(f"stages: {stages}\n".replace("'", ""))

    def written() -> dict[str, bytes]:
        files.run()
        return {file.stem: file.read_bytes() for file in files.OUT.iterdir()}

    before = written()
    assert {*before} == {*PARTS} and written() == before
    for name, changed in (
        ("force/C2.csv", {"force"}),
        ("kinect/test_001/depth/0.png", {"depth"}),
        ("optitrack/train_001.csv", {"motion"}),
        (UNCLAIMED, {*PARTS}),  # the control
    ):
        (recordings / name).write_text("edited")
        after = written()
        assert {part for part in PARTS if after[part] != before[part]} == changed
        before = after


def test_a_listing_tells_a_change_that_keeps_the_size(recordings):
    before = listing(recordings).set_index("file")
    (recordings / UNCLAIMED).write_text(UNCLAIMED[::-1])
    after = listing(recordings).set_index("file")
    assert list(before.index[(before != after).any(axis=1)]) == [UNCLAIMED]
    assert list(before.index) == [path.as_posix() for path in sorted(map(Path, before.index))]
    assert (before["bytes"] == after["bytes"]).all()


def test_a_folder_without_files_is_refused_by_its_name(tmp_path):
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(RecordingError, match="no recordings") as refused:
            listing(folder)
        assert refused.value.evidence["file"] == folder


def test_a_pattern_that_is_none_is_refused_by_its_key(recordings, dataset):
    dataset.depth.takes = "/absolute/*"
    with pytest.raises(ConfigError) as refused:
        by_part(listing(recordings), dataset)
    assert refused.value.evidence["key"] == "dataset.depth.takes"
