"""The command lock: what a killed DVC leaves is mended, and entries have the order of dvc.yaml."""

import pytest
from dvc.schema import COMPILED_LOCKFILE_SCHEMA

from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.lock import command

ENTRY = """  {0}:
    cmd: python -m pipeline {0}
    deps:
    - path: pipeline/{0}
      hash: md5
      md5: 0123456789abcdef0123456789abcdef.dir
      size: 10
    outs:
    - path: data/{0}
      hash: md5
      md5: 0123456789abcdef0123456789abcdef
      size: 10
"""
LOCK = "schema: '2.0'\nstages:\n" + "".join(
    map(ENTRY.format, ("files", "track", "fit")),
)


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project of three stages; the folder of DVC's cache has nothing to mend."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "_mend", lambda: iter(()))
    stages = "".join(f"  {name}: {{cmd: x}}\n" for name in ("files", "track", "fit"))
    (tmp_path / "dvc.yaml").write_text("stages:\n" + stages)
    return tmp_path


def test_a_lock_file_cut_off_at_any_byte_is_one_that_dvc_reads_and_keeps_what_is_whole(
    project,
):
    lock = project / "dvc.lock"
    for length in range(len(LOCK)):
        lock.write_text(LOCK[:length])
        command.run()
        kept = read_yaml(lock)["stages"] if lock.is_file() else {}
        assert not kept or COMPILED_LOCKFILE_SCHEMA(read_yaml(lock))
        # entries begun to their outputs
        whole = LOCK[:length].count("    outs:\n    - path")
        assert whole - 1 <= len(kept) <= 3


def test_the_entries_of_a_lock_are_sorted_as_its_pipeline(project, capsys):
    (project / "params.yaml").write_text("models: [a, b]\n")
    text = "stages:\n  track: {cmd: r}\n  fit: {cmd: f, matrix: {model: '${models}'}}\n"
    (project / "dvc.yaml").write_text(text)
    head = LOCK[: LOCK.index("  files:")]
    lock = project / "dvc.lock"
    track, a, b, gone = map(ENTRY.format, ("track", "fit@a", "fit@b", "gone"))
    lock.write_text(head + b + gone + track + a)

    for printed in (
        "lock: dvc.lock put in order\n",
        "lock: every dvc.lock is in order\n",
    ):
        command.run()
        assert capsys.readouterr().out == printed
        assert lock.read_text() == head + track + a + b


def test_a_lock_file_with_a_conflict_is_left_to_the_user(project):
    text = LOCK.replace("  track:", "<<<<<<< ours\n  track:").replace(
        "  fit:",
        "=======\n  fit:",
    )
    (project / "dvc.lock").write_text(text)
    command.run()

    assert (project / "dvc.lock").read_text() == text
