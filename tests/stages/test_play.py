"""Where there is nothing to play the stage says so and leaves an empty folder."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from pipeline import config
from pipeline.stages import play


@pytest.mark.parametrize(("depth", "filtered"), [(None, True), ("a camera", False)])
def test_a_dataset_without_camera_or_filter_is_not_played(tmp_path, monkeypatch, capsys, depth, filtered):
    monkeypatch.chdir(tmp_path)
    if filtered:
        Path("data/filter/additive").mkdir(parents=True)
        Path("data/filter/additive/posterior.parquet").touch()
    settings = SimpleNamespace(dataset=SimpleNamespace(depth=depth), models={"additive": None})
    monkeypatch.setattr(config, "sections", lambda stage: settings)
    play.run()
    assert "nothing to do" in capsys.readouterr().out
    assert list(Path("data/play").iterdir()) == []
