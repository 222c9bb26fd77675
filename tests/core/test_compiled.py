"""Cached machine code is loaded again, and never after an edit of a source that it was made of."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from project_copy import ROOT

INNER = """
from pipeline.core.compiled import inner
CONSTANT = {constant}
@inner
def scaled(x):
    return x * CONSTANT
"""
OUTER = """
from pipeline.core.compiled import compiled
from pipeline.inner import scaled
@compiled
def outer(x):
    return scaled(x)
"""
PROGRAM = (
    "from pipeline.outer import outer; value = outer(1.0); print(value, "
    "sum(outer.stats.cache_hits.values()), outer.stats.cache_path)"
)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package with the project's decorators, and an outer function that calls an inner one in
    another file.
    """
    (tmp_path / "pipeline/core").mkdir(parents=True)
    for name in ("__init__", "core/__init__", "core/compiled"):
        (tmp_path / f"pipeline/{name}.py").write_text("")
    shutil.copy(ROOT / "pipeline/core/compiled.py", tmp_path / "pipeline/core/compiled.py")
    (tmp_path / "pipeline/outer.py").write_text(OUTER)
    (tmp_path / "pipeline/inner.py").write_text(INNER.format(constant=2.0))
    return tmp_path


def run(package: Path, **environment: str) -> tuple[float, int, str]:
    """The outer function's value in a new process, whether its code was loaded from the cache, and
    the folder of the cache.
    """
    kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=package,
        env=kept | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    value, hits, place = done.stdout.split(maxsplit=2)
    return float(value), int(hits), place.strip()


@pytest.mark.slow
def test_compiled_code_is_loaded_until_a_constant_in_another_file_is_edited(package):
    place = str(package / "pipeline/__pycache__/pipeline-")
    first, again = run(package), run(package)
    assert first[:2] == (2.0, 0) and again[:2] == (2.0, 1)
    assert first[2].startswith(place)
    (package / "pipeline/inner.py").write_text(INNER.format(constant=3.0))
    assert run(package)[:2] == (3.0, 0)
    (package / "pipeline/inner.py").write_text(INNER.format(constant=2.0))
    # numba looks at the time of the function's own file alone, which is as it was
    assert run(package)[:2] == (2.0, 1)


@pytest.mark.slow
def test_folders_of_earlier_sources_are_removed_but_for_the_newest(package):
    base = package / "pipeline/__pycache__"
    for number in range(6):
        folder = base / f"pipeline-{number}"
        folder.mkdir(parents=True)
        os.utime(folder, (number, number))
    run(package)
    left = sorted(folder.name for folder in base.glob("pipeline-?"))
    assert left == ["pipeline-3", "pipeline-4", "pipeline-5"]


@pytest.mark.slow
def test_a_users_folder_holds_the_cache_and_a_child_process_uses_the_same(package, tmp_path):
    given = tmp_path / "given"
    *first, place = run(package, NUMBA_CACHE_DIR=str(given))
    assert first == [2.0, 0] and place.startswith(f"{given}/pipeline-")
    folder = place.removeprefix(f"{given}/").split("/")[0]
    inherited = run(package, NUMBA_CACHE_DIR=str(given / folder))
    assert inherited == (2.0, 1, place)


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only for root")
def test_a_read_only_project_is_cached_in_the_users_folder(package, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    (package / "pipeline").chmod(0o555)
    try:
        assert run(package, HOME=str(home))[2].startswith(str(home / ".cache/pipeline"))
        assert run(package, HOME="/nowhere")[:2] == (2.0, 0)
    finally:
        (package / "pipeline").chmod(0o755)
