"""The table of the paper's items: no item is forgotten, each has a function that cites it, and
tests that exist and use that function.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from pipeline.core import config
from pipeline.verdicts.equations import citations, parse_items

ROOT = Path(__file__).parents[2]
PAPER = ROOT.parent / "shared/paper"
ITEMS = parse_items(config.read_yaml(ROOT / "pipeline/verdicts/paper.yaml")["items"])
SOURCES = citations(ROOT / "pipeline", ITEMS)
DISPLAY = r"\\begin\{(equation|align|eqnarray|empheq)\}(.*?)\\end\{\1\}"
FIGURE = r"\\begin\{(figure\*?)\}.*?\\label\{(\w+)\}"
NAMED = r"\\textbf\{(Definition|Theorem) \d\}|\\begin\{(algorithm)\}"
INNER = r"\\begin\{(bmatrix|matrix)\}.*?\\end\{\1\}"


def printed(text: str) -> list[tuple[str, str]]:
    """Kind and label of everything that LaTeX numbers in the paper's source, in its order."""
    numbered = []
    for match in re.finditer(
        f"{DISPLAY}|{FIGURE}|{NAMED}", re.sub(r"(?<!\\)%.*", "", text), re.DOTALL
    ):
        if match[1]:
            # the rows of matrices within a display are not numbered
            rows = re.split(r"\\\\", re.sub(INNER, "", match[2], flags=re.DOTALL))
            rows = [row for row in rows if row.strip() and "\\nonumber" not in row]
            labels = [re.search(r"\\label\{(\w+)\}", row) for row in rows]
            numbered += [("equation", label[1] if label else "") for label in labels]
        elif match[3]:
            numbered.append(("figure", match[4]))
        else:
            numbered.append(((match[5] or match[6]).lower(), ""))
    return numbered


def test_rows_of_a_display_are_numbered_but_for_those_that_say_not():
    text = (
        r"\begin{align} a &= b \label{One}\\ & \begin{bmatrix} 1 \\ 2 \end{bmatrix} "
        r"\nonumber \\ c \end{align} \textbf{Theorem 1}: x \begin{figure*} \caption{c} "
        r"\label{Fig} \end{figure*} % \begin{equation} no \end{equation}"
    )
    expected = [("equation", "One"), ("equation", ""), ("theorem", ""), ("figure", "Fig")]
    assert printed(text) == expected


def test_nothing_that_the_paper_numbers_is_forgotten():
    if not PAPER.is_dir():
        pytest.skip("the paper's source is not beside the project")
    (file,) = PAPER.glob("*.txt")
    held = [(item.kind, item.label) for item in ITEMS]
    numbered = printed(file.read_text(encoding="utf-8"))
    assert {kind for kind, _ in held} == {kind for kind, _ in numbered}
    for kind in {kind for kind, _ in numbered}:
        theirs, ours = ([n for name, n in rows if name == kind] for rows in (numbered, held))
        # a label of ours stands where the paper has none, and there alone
        assert theirs == ["" if "-" in label else label for label in ours]


@cache
def definitions(file: str) -> dict[str, ast.AST]:
    """What a test file defines at its top, by name."""
    named = {}
    for node in ast.parse((ROOT / file).read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            named[node.name] = node
        elif isinstance(node, ast.Assign):
            named |= {target.id: node for target in node.targets if isinstance(target, ast.Name)}
    return named


@cache
def imported(file: str) -> dict[str, str]:
    """Name → dotted path of what a test file imports of the pipeline."""
    nodes = ast.walk(ast.parse((ROOT / file).read_text()))
    return {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def used(file: str, test: str) -> set[str]:
    """Dotted paths that a test names, itself or through what its file or a helper of the tests
    defines.
    """
    names, waiting, visited = set(), [(file, test)], set()
    while waiting:
        place, name = waiting.pop()
        if (place, name) in visited or name not in definitions(place):
            continue
        visited.add((place, name))
        for node in ast.walk(definitions(place)[name]):
            if isinstance(node, ast.Name | ast.Attribute):
                head, _, rest = ast.unparse(node).partition(".")
                source = imported(place).get(head, head)
                names.add(f"{source}.{rest}".rstrip("."))
                module, _, own = source.rpartition(".")
                helper = f"tests/{module.removeprefix('tests.').replace('.', '/')}.py"
                waiting.append((helper, own) if (ROOT / helper).is_file() else (place, head))
            elif isinstance(node, ast.arg):
                waiting.append((place, node.arg))  # a fixture
    return names


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.cited_as)
def test_every_item_has_a_function_or_needs_none_and_tests_that_exist_and_use_it(item):
    implementing = {source.name for source in SOURCES[item.cited_as]}
    assert bool(implementing) != bool(item.without_code)
    # whoever makes an object of a class uses its methods
    owners = {name.rpartition(".")[0] for name in implementing}
    classes = {owner for owner in owners if owner.rpartition(".")[2][:1].isupper()}
    for test in item.tests:
        file, _, name = test.partition("::")
        assert name in definitions(file), test
        assert used(file, name) & (implementing | classes), test


def test_a_test_that_does_not_use_what_implements_an_item_is_found_out():
    name = "test_theta_follows_the_papers_equation_for_any_size"
    by = used("tests/randommatrix/test_wishart.py", name)
    assert "pipeline.randommatrix.wishart.maxent_theta" in by
    assert "pipeline.randommatrix.wishart.sample" not in by
