"""Compiled code that is cached is taken up again, and never after an edit of what it was made
of.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from project_copy import ROOT

from pipeline.core.compiled import _read, sources_stamp

INNER = """
from pipeline.core.compiled import compiled, inlined
from pipeline.core.compiled import inner as closed
CONSTANT = {constant}
@{decorator}
def inner(x):
    return x * CONSTANT + {added}
"""
OUTER = (
    "from pipeline.core.compiled import compiled\nfrom pipeline.inner import "
    "inner\n@compiled()\ndef outer(x):\n    return inner(x)\n"
)
COMPILING = ("compiled", "machine_code")  # the modules of core that compile
PROGRAM = (
    "from pipeline.outer import outer; value = outer(1.0); print(value, "
    "sum(outer.stats.cache_hits.values()), outer.stats.cache_path)"
)


@pytest.fixture
def package(tmp_path) -> Path:
    """A copy of the compiling part of the package, with an outer function that calls an inner one
    in another file.
    """
    (tmp_path / "pipeline/core").mkdir(parents=True)
    for name in ("__init__.py", *(f"core/{file}.py" for file in ("__init__", *COMPILING))):
        shutil.copy(ROOT / "pipeline" / name, tmp_path / "pipeline" / name)
    (tmp_path / "pipeline/outer.py").write_text(OUTER)
    write_inner(tmp_path)
    return tmp_path


def write_inner(
    package: Path, decorator: str = "compiled()", constant: float = 2.0, added: float = 0.0
) -> None:
    """Write the inner module; a rewritten one is two seconds newer than before, since Python takes
    bytecode for current by the whole second and the size of the source.
    """
    file = package / "pipeline/inner.py"
    newer = file.stat().st_mtime + 2 if file.exists() else None
    file.write_text(INNER.format(constant=constant, decorator=decorator, added=added))
    if newer is not None:
        os.utime(file, (newer, newer))


def run(package: Path, **environment: str) -> tuple[float, int, str]:
    """The outer function's value in a new process, whether it was taken from the cache, and where
    that lies.
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
def test_compiled_code_is_taken_from_the_cache_until_an_inner_function_or_its_constant_is_edited(
    package,
):
    place = str(package / "pipeline/__pycache__")
    assert run(package) == (2.0, 0, place)
    assert run(package) == (2.0, 1, place)
    write_inner(package, added=1.0)
    assert run(package) == (3.0, 0, place)
    for decorator, constant in (("inlined", 7.0), ("closed", 9.0)):
        write_inner(package, decorator, constant=constant)
        assert run(package) == (constant, 0, place)
        assert run(package) == (constant, 1, place)
        write_inner(package, decorator, constant=constant, added=1.0)
        assert run(package) == (constant + 1.0, 0, place)


@pytest.mark.slow
@pytest.mark.parametrize("decorator", ["inlined", "closed"])
def test_an_inner_function_is_taken_from_the_cache_by_one_that_has_to_be_compiled(
    package, decorator
):
    write_inner(package, decorator)
    run(package)
    other = OUTER.replace("return inner(x)", "return inner(x) + 1.0")
    (package / "pipeline/other.py").write_text(other)
    program = (
        "from pipeline.other import outer; from pipeline.inner import inner; "
        "print(outer(1.0), sum(inner.stats.cache_hits.values()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=package, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["3.0", "1"]


@pytest.mark.slow
def test_code_is_not_stale_where_numba_has_read_its_environment_anew(package):
    outer = package / "pipeline/outer.py"
    first, rest = OUTER.split("\n", 1)
    outer.write_text(f"{first}\nimport numba\nnumba.config.reload_config()\n{rest}")
    assert run(package)[0] == 2.0
    write_inner(package, added=1.0)
    assert run(package)[:2] == (3.0, 0)


def test_numbas_own_cache_would_have_been_stale(package):
    source = package / "pipeline/core/compiled.py"
    text = source.read_text()
    source.write_text(text[: text.index("Kept._locator_classes")])
    assert run(package)[0] == 2.0
    write_inner(package, added=1.0)
    assert run(package)[:2] == (2.0, 1)


@pytest.mark.slow
def test_what_cannot_be_written_beside_the_source_goes_to_the_user_and_else_nowhere_that_stays(
    package,
):
    # a file where the folder should be stops even a user who may write anywhere
    (package / "pipeline/__pycache__").write_text("")
    cache = package / "cache"
    value, _, place = run(package, XDG_CACHE_HOME=str(cache))
    assert value == 2.0 and place.startswith(str(cache))
    assert run(package, XDG_CACHE_HOME=str(cache)) == (2.0, 1, place)
    write_inner(package, added=1.0)
    assert run(package, XDG_CACHE_HOME=str(cache))[:2] == (3.0, 0)

    (package / "file").write_text("")
    value, hits, place = run(
        package, XDG_CACHE_HOME=str(package / "file"), HOME=str(package / "file")
    )
    assert (value, hits) == (3.0, 0) and not Path(place).exists()


def test_the_stamp_changes_with_every_module_that_is_imported_and_with_no_other(
    package, monkeypatch
):
    monkeypatch.setattr("pipeline.core.compiled.PROJECT", package)

    def stamp() -> str:
        _read.cache_clear()
        return sources_stamp.__wrapped__(str(package / "pipeline/outer.py"))

    stamps = [stamp()]
    for name in ("inner.py", "outer.py", "core/compiled.py"):
        file = package / "pipeline" / name
        file.write_text(file.read_text() + "\n# a word\n")
        stamps.append(stamp())
    assert len(set(stamps)) == 4
    (package / "pipeline/unrelated.py").write_text("x = 1\n")
    assert stamp() == stamps[-1]
