"""What ran is what the lock files hold: of the chosen models and of stages that there are."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.tools.page.stages import StageRun, locked_runs, stages_in_order, touch

LOCK = """
schema: '2.0'
stages:
  track:
    cmd: python -m pipeline track
    deps:
    - path: data/ingest/motion
      md5: 1.dir
    params:
      data/config.yaml:
        seed: 7
    outs:
    - path: data/track
      md5: 2.dir
  ingest@motion:
    cmd: python -m pipeline ingest motion
    outs:
    - path: data/ingest/motion
      md5: 1.dir
  fit@additive: &fit
    cmd: python -m pipeline fit additive
    deps:
    - path: data/track
      md5: 2.dir
    - path: data/ingest/motion
      md5: 1.dir
    outs:
    - path: data/fit/additive
      md5: 3.dir
    - path: reports/metrics/fit_additive.json
      md5: '4'
  fit@dropped: *fit
  play:
    cmd: python -m pipeline play
    outs:
    - path: data/play
      md5: 5.dir
"""


@pytest.fixture
def runs(tmp_path, monkeypatch) -> list[StageRun]:
    monkeypatch.chdir(tmp_path)
    Path("pipeline/stages").mkdir(parents=True)
    for name in ("track", "ingest", "fit"):
        text = f'"""{name}: what {name}\ndoes.\n\nMore of it.\n"""\n'
        Path(f"pipeline/stages/{name}.py").write_text(text)
    Path("dvc.lock").write_text(LOCK)
    return locked_runs(Path("dvc.lock"), ["additive"])


def test_runs_of_other_models_and_of_stages_that_are_gone_are_passed_over(runs):
    assert [run.name for run in runs] == ["track", "ingest@motion", "fit@additive"]


def test_a_run_has_what_it_read_and_wrote_with_the_hashes(runs):
    track, _, fit = runs
    assert track == StageRun(
        "track",
        "track",
        "what track does.",
        "pipeline/stages/track.py",
        {"data/ingest/motion": "1.dir", "data/config.yaml": ""},
        {"data/track": "2.dir"},
    )
    assert fit.writes == {"data/fit/additive": "3.dir", "reports/metrics/fit_additive.json": "4"}


def test_stages_come_in_the_order_of_the_data_whatever_the_order_of_the_lock(runs):
    for known in (runs, runs[::-1]):
        stages = stages_in_order(known)
        assert [(stage.name, stage.after) for stage in stages] == [
            ("ingest", []),
            ("track", ["ingest"]),
            ("fit", ["track"]),  # and not ingest, which another way leads to
        ]
    assert stages[2].writes == ["data/fit/*", "reports/metrics/fit_*.json"]


def test_a_study_is_run_by_the_program_beside_its_lock_and_by_no_other(runs):
    folder = Path("pipeline/studies/play")
    folder.mkdir(parents=True)
    (folder / "stage.py").write_text('"""play: on."""')
    (folder / "dvc.lock").write_text(LOCK[: LOCK.index("  track:")] + LOCK[LOCK.index("  play:") :])
    (run,) = locked_runs(folder / "dvc.lock", ["additive"])
    assert (run.program, run.what) == ("pipeline/studies/play/stage.py", "on.")
    # what an old lock of the paper has under a study's name did not run there
    assert locked_runs(Path("dvc.lock"), ["additive"]) == runs


def test_there_is_nothing_where_nothing_has_run(tmp_path):
    assert locked_runs(tmp_path / "dvc.lock", ["additive"]) == []


def test_a_path_touches_itself_and_folders_around_and_files_inside():
    assert touch("data/fit", "data/fit") and touch("data/fit", "data/fit/a")
    assert touch("data/fit/a", "data/fit") and not touch("data/fit", "data/fitted")
