"""Modules are short, print nothing and take randomness and time as arguments."""

from __future__ import annotations

import ast

import pytest
from source_code import MODULES, ROOT, imports, tree

LINES, COLUMNS = 350, 100
FILES = {
    str(file.relative_to(ROOT)): file
    for folder in ("pipeline", "tests")
    for file in sorted((ROOT / folder).rglob("*.py"))
}


@pytest.mark.parametrize("name", FILES)
def test_a_module_is_short_enough_to_be_read(name):
    lines = FILES[name].read_text(encoding="utf-8").splitlines()
    assert len(lines) <= LINES
    assert [number for number, line in enumerate(lines, 1) if len(line) > COLUMNS] == []


@pytest.mark.parametrize("module", MODULES)
def test_only_the_command_line_stages_tools_and_the_progress_of_trials_print(module):
    printing = ("stages", "studies", "tools", "__main__", "core.compute", "figures.drawing")
    if not any(f"{module}.".startswith(f"pipeline.{part}.") for part in printing):
        assert not [
            node
            for node in ast.walk(tree(module))
            if isinstance(node, ast.Call) and getattr(node.func, "id", None) == "print"
        ]


@pytest.mark.parametrize("module", MODULES)
def test_nothing_is_random_or_dated_but_by_its_arguments(module):
    roots = {name.split(".")[0] for name in imports(module)}
    # how long trials take decides where they run, and nothing else; what a condition of a survey
    # costs is measured
    timed = (
        {"time"}
        if module in ("pipeline.core.compute.block", "pipeline.studies.survey.points")
        else set()
    )
    assert not roots & ({"random", "secrets", "uuid", "time", "datetime"} - timed)
    attributes = [node for node in ast.walk(tree(module)) if isinstance(node, ast.Attribute)]
    drawn = {
        node.attr for node in attributes if ast.unparse(node.value) in ("np.random", "numpy.random")
    }
    # which generator there is: made in core.rng, read by the compiled draws
    known = {
        "pipeline.core.rng": {"PCG64", "SeedSequence"},
        "pipeline.randommatrix.words": {"PCG64"},
    }
    assert drawn <= {"Generator"} | known.get(module, set())
