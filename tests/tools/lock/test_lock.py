"""Lock files in the order of their pipelines."""

from __future__ import annotations

from pipeline.tools.lock.command import in_order

LOCK = """schema: '2.0'
stages:
  fit@b:
    cmd: fit b
  gone:
    cmd: gone
  record:
    cmd: record
    outs:
    - path: x
  fit@a:
    cmd: fit a
"""

STAGES = ["record", "fit@a", "fit@b"]


def test_stages_stand_as_in_the_pipeline_and_those_that_are_gone_do_not():
    assert in_order(LOCK, STAGES) == (
        "schema: '2.0'\nstages:\n  record:\n    cmd: record\n    outs:\n    - path: x\n"
        "  fit@a:\n    cmd: fit a\n  fit@b:\n    cmd: fit b\n"
    )


def test_what_is_in_order_stays_as_it_is():
    ordered = in_order(LOCK, STAGES)
    assert in_order(ordered, STAGES) == ordered


def test_the_command_sorts_the_lock_beside_each_pipeline(tmp_path, monkeypatch, capsys):
    from pipeline.tools.lock.command import run

    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text("models: [a, b]\n")
    text = "stages:\n  record: {cmd: r}\n  fit: {cmd: f, matrix: {model: '${models}'}}\n"
    (tmp_path / "dvc.yaml").write_text(text)
    (tmp_path / "dvc.lock").write_text(LOCK)
    run([])
    assert capsys.readouterr().out == "lock: dvc.lock put in order\n"
    assert (tmp_path / "dvc.lock").read_text() == in_order(LOCK, STAGES)
