"""The study of the filters as a stage."""

from __future__ import annotations

from pathlib import Path

from pipeline.studies.filters import stage


def test_without_a_depth_camera_there_is_a_page_that_says_so(project, capsys):
    stage.run()
    assert "or no depth camera" in Path("reports/studies/filters.md").read_text()
    assert "filters left out" in capsys.readouterr().out
    assert list(stage.OUT.iterdir()) == []
