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
from numpy.random import default_rng
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
    computed = np.array([function(value) for value in x])
    error = np.abs(computed - exact(x.astype(np.longdouble)))
    unit = np.spacing(np.maximum(np.abs(computed), 1e-300))
    return float((error / unit).max())


def test_sine_and_cosine_are_right_to_two_units_in_the_last_place_of_one():
    both = from_python(sine_cosine)
    near = np.linspace(-7, 7, 20_001)
    octants = np.arange(-8, 9) * np.pi / 4
    far = default_rng(1).uniform(-6000, 6000, 20_000)
    angles = np.concatenate([near, far, octants])
    right = np.stack([np.sin(angles), np.cos(angles)], axis=1)

    computed = np.array([both(angle) for angle in angles])

    assert np.abs(computed - right).max() < 3e-16
    assert both(0.0) == (0.0, 1.0)
    # of a small angle to two of its own
    small = np.geomspace(1e-300, 1.5, 2000)
    assert units(lambda angle: both(angle)[0], np.sin, small) < 2


def test_the_exponential_is_right_to_two_units_in_the_last_place():
    compiled_exp = from_python(exponential)
    assert units(compiled_exp, np.exp, np.linspace(-707.9, 0, 20_001)) < 2

    ends = compiled_exp(0.0), compiled_exp(-709.0), compiled_exp(-np.inf)
    assert ends == (1.0, 0.0, 0.0)
    assert np.isnan(compiled_exp(np.nan))


def test_the_exponential_less_one_is_right_to_three_units_in_the_last_place():
    compiled_expm1 = from_python(expm1)
    assert units(compiled_expm1, np.expm1, np.geomspace(1e-290, 699, 20_000)) < 3
    assert units(compiled_expm1, np.expm1, np.linspace(0.3, 1.2, 5000)) < 3
    assert compiled_expm1(0.0) == 0.0


COUNTS = [0, 1, LANES - 1, LANES, LANES + 1, 10 * LANES + 3]


@pytest.mark.parametrize("count", COUNTS)
def test_sums_and_the_greatest_are_numpys(count):
    x, y = default_rng(count).standard_normal((2, count))
    gaps = np.append(x, np.nan)  # what is no number is not the greatest

    assert from_python(inner_product)(x, y) == pytest.approx(x @ y, abs=1e-13)
    assert from_python(total)(x) == pytest.approx(x.sum(), abs=1e-13)
    assert from_python(greatest)(gaps) == x.max(initial=-np.inf)


def sum_by_lanes(terms: np.ndarray) -> float:
    """The sum of terms in the order of the compiled code: whole lanes, the rest in the first lane,
    and the lanes joined half and half.
    """
    whole = len(terms) - len(terms) % LANES
    lanes = np.zeros(LANES)
    for row in terms[:whole].reshape(-1, LANES):
        lanes += row
    for term in terms[whole:]:
        lanes[0] += term

    while len(lanes) > 1:
        lanes = np.add(*np.split(lanes, 2))
    return lanes[0]


@pytest.mark.parametrize("count", COUNTS)
def test_sums_are_those_of_lanes_to_the_bit(count):
    x, y = default_rng(count).standard_normal((2, count))
    assert from_python(inner_product)(x, y) == sum_by_lanes(x * y)
    assert from_python(total)(x) == sum_by_lanes(x)


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

    value, loaded, place = run(package)
    assert (value, loaded) == (2.0, 0)
    assert place.startswith(str(base / "pipeline-"))
    assert run(package) == (2.0, 1, place)
    # folders of earlier sources are removed but for the newest
    left = sorted(folder.name for folder in base.glob("pipeline-?"))
    assert left == ["pipeline-3", "pipeline-4", "pipeline-5"]

    inner = package / "pipeline/inner.py"
    inner.write_text(INNER.format(constant=3.0))
    value, loaded, _ = run(package)
    assert (value, loaded) == (3.0, 0)

    inner.write_text(INNER.format(constant=2.0))
    # numba looks at the time of the function's own file alone, which is as it was
    assert run(package) == (2.0, 1, place)

    # a module without compiled code
    (package / "pipeline/drawing.py").write_text("from pipeline.outer import outer\n")
    assert run(package) == (2.0, 1, place)


def test_machine_code_depends_on_the_compiled_modules_and_their_imports_alone(
    tmp_path,
    monkeypatch,
):
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
        after = sources.sources_hash(compiled.compiled_sources())
        assert (after != before) == recompiled


def decorators_of(module: str) -> set[str]:
    """Names of the decorators of a module's functions."""
    names = set()
    for node in tree(module).body:
        for decorator in getattr(node, "decorator_list", []):
            names.add(getattr(decorator, "id", None))
    return names


def test_the_sources_of_machine_code_are_the_compiled_modules_and_their_imports():
    marks = {"compiled", "inner", "inlined"}
    waiting = [module for module in MODULES if decorators_of(module) & marks]
    assert len(waiting) > 10

    needed = set()
    while waiting:
        module = waiting.pop()
        needed.add(module)
        waiting += (imports(module, top=True) & MODULES.keys()) - needed
    assert set(compiled.compiled_sources()) == {MODULES[module] for module in needed}
