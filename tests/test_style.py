"""Modules are short, and results depend on no global randomness and on no date."""

from __future__ import annotations

import ast

from source_code import MODULES, ROOT, imports, tree

LINES = 350
# durations decide where trials run, and nothing else
TIMED = {
    "pipeline.core.compute.cluster",
    "pipeline.core.compute.trials",
}
GENERATORS = {"Generator", "PCG64", "SeedSequence"}


def test_modules_are_short_enough_to_be_read():
    files = [file for part in ("pipeline", "tests") for file in (ROOT / part).rglob("*.py")]
    lines = {file: file.read_text(encoding="utf-8").count("\n") for file in files}
    assert {file.name: count for file, count in lines.items() if count > LINES} == {}


def test_nothing_is_random_or_dated_but_by_its_arguments():
    for module in MODULES:
        roots = {name.split(".")[0] for name in imports(module)}
        clocks = set() if module in TIMED else {"time"}
        assert not roots & {"random", "secrets", "uuid", "datetime", *clocks}, module
        called = {
            node.func.attr
            for node in ast.walk(tree(module))
            if isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and ast.unparse(node.func.value) in ("np.random", "numpy.random")
        }
        known = GENERATORS if module == "pipeline.core.rng" else set()
        assert called <= known, f"{module} makes a generator of its own"
