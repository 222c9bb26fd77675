"""Compiled code: elementary functions and sums right to a few units in the last place; cached
machine code loaded again, and never after an edit of a source that it was made of.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from compiled_calls import from_python
from project_copy import ROOT
from source_code import MODULES, imports, tree

from pipeline.core import compiled, sources
from pipeline.core.elementary import (
    LANES,
    expm1,
    exponential,
    greatest,
    inner_product,
    sine_cosine,
    total,
)


def units(function, exact, x: np.ndarray) -> float:
    """Greatest error in units in the last place, against the library's in extended precision."""
    result = np.array([function(value) for value in x])
    right = exact(x.astype(np.longdouble))
    return float(
        np.max(np.abs(result - right) / np.spacing(np.maximum(np.abs(result), 1e-300))),
    )


def test_sine_and_cosine_are_right_to_two_units_in_the_last_place_of_one():
    rng, both = np.random.default_rng(1), from_python(sine_cosine)
    near, far = np.linspace(-7, 7, 20_001), rng.uniform(-6000, 6000, 20_000)
    angles = np.concatenate([near, far, np.arange(-8, 9) * np.pi / 4])
    right = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    assert np.abs(np.array([both(angle) for angle in angles]) - right).max() < 3e-16
    assert both(0.0) == (0.0, 1.0)
    # of a small angle to two of its own
    assert units(lambda x: both(x)[0], np.sin, np.geomspace(1e-300, 1.5, 2000)) < 2


def test_the_exponential_is_right_to_two_units_in_the_last_place_and_less_one_to_three():
    run = from_python(exponential)
    assert units(run, np.exp, np.linspace(-707.9, 0, 20_001)) < 2
    assert (run(0.0), run(-709.0), run(-np.inf)) == (1.0, 0.0, 0.0)
    assert np.isnan(run(np.nan))
    x = np.concatenate([np.geomspace(1e-290, 699, 20_000), np.linspace(0.3, 1.2, 5000)])
    assert units(from_python(expm1), np.expm1, x) < 3
    assert from_python(expm1)(0.0) == 0.0


@pytest.mark.parametrize("count", [0, 1, LANES - 1, LANES, LANES + 1, 10 * LANES + 3])
def test_sums_and_the_greatest_are_numpys(count):
    rng = np.random.default_rng(count)
    x, y = rng.standard_normal((2, count))
    assert from_python(inner_product)(x, y) == pytest.approx(x @ y, abs=1e-13)
    assert from_python(total)(x) == pytest.approx(x.sum(), abs=1e-13)
    gaps = np.append(x, np.nan)  # what is no number is not the greatest
    assert from_python(greatest)(gaps) == x.max(initial=-np.inf)
    # to the bit: a lane each, joined half and half
    lanes = np.zeros((2, LANES))
    for k in range(0, count - count % LANES, LANES):
        lanes += np.stack([x * y, x])[:, k : k + LANES]
    for k in range(count - count % LANES, count):
        lanes[:, 0] += [x[k] * y[k], x[k]]
    while lanes.shape[1] > 1:
        lanes = np.add(*np.split(lanes, 2, axis=1))
    assert [from_python(inner_product)(x, y), from_python(total)(x)] == lanes[
        :,
        0,
    ].tolist()


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
    for name in ("__init__", "core/__init__"):
        (tmp_path / f"pipeline/{name}.py").write_text("")
    for name in ("compiled", "sources"):
        shutil.copy(ROOT / f"pipeline/core/{name}.py", tmp_path / "pipeline/core")
    (tmp_path / "pipeline/outer.py").write_text(OUTER)
    (tmp_path / "pipeline/inner.py").write_text(INNER.format(constant=2.0))
    return tmp_path


def run(package: Path, **environment: str) -> tuple[float, int, str]:
    """The outer function's value in a new process, whether its code was loaded from the cache, and
    the folder of the cache.
    """
    paths = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=package,
        env=paths | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    value, hits, place = done.stdout.split(maxsplit=2)
    return float(value), int(hits), place.strip()


@pytest.mark.slow
def test_compiled_code_is_loaded_until_a_constant_in_another_file_is_edited(package):
    base = package / "pipeline/__pycache__"
    for number in range(6):
        folder = base / f"pipeline-{number}"
        folder.mkdir(parents=True)
        os.utime(folder, (number, number))
    first, again = run(package), run(package)
    assert first[:2] == (2.0, 0) and again[:2] == (2.0, 1)
    assert first[2].startswith(str(base / "pipeline-"))
    # folders of earlier sources are removed but for the newest
    left = sorted(folder.name for folder in base.glob("pipeline-?"))
    assert left == ["pipeline-3", "pipeline-4", "pipeline-5"]
    (package / "pipeline/inner.py").write_text(INNER.format(constant=3.0))
    assert run(package)[:2] == (3.0, 0)
    (package / "pipeline/inner.py").write_text(INNER.format(constant=2.0))
    # numba looks at the time of the function's own file alone, which is as it was
    assert run(package)[:2] == (2.0, 1)
    (package / "pipeline/drawing.py").write_text("from pipeline.outer import outer\n")
    assert run(package)[:2] == (2.0, 1)


def test_machine_code_depends_on_the_compiled_modules_and_their_imports_alone(
    tmp_path,
    monkeypatch,
):
    needed, waiting = set(), []
    for module in MODULES:
        every = (
            decorator
            for node in tree(module).body
            for decorator in getattr(node, "decorator_list", [])
        )
        if {"compiled", "inner", "inlined"} & {
            getattr(decorator, "id", None) for decorator in every
        }:
            waiting.append(module)
    assert len(waiting) > 10
    while waiting:
        needed.add(module := waiting.pop())
        waiting += (imports(module, top=True) & MODULES.keys()) - needed
    assert set(compiled.compiled_sources()) == {MODULES[module] for module in needed}
    folder = shutil.copytree(ROOT / "pipeline", tmp_path / "pipeline")
    monkeypatch.setattr(sources, "SOURCES", folder)
    for file, recompiled in (
        ("figures/style.py", False),
        ("filtering/sampling.py", True),
        ("models/model.py", True),  # constants that the kernel imports
        ("arm/interface.py", True),
    ):
        before = sources.sources_hash(compiled.compiled_sources())
        with (folder / file).open("a") as text:
            text.write("# comment\n")
        assert (
            sources.sources_hash(compiled.compiled_sources()) != before
        ) == recompiled
