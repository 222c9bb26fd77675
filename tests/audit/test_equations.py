"""The table of the paper's items: no item is forgotten, each has a function that cites it, and tests that exist and use that function."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from pipeline import config
from pipeline.audit.equations import Source, citations, cited, equations_page, parse_items
from pipeline.errors import ConfigError

ROOT = Path(__file__).parents[2]
PAPER = ROOT.parent / "shared/paper"

EQUATION = {"kind": "equation", "label": "NormStd", "place": "Sec. 3", "says": "A |norm|.", "tests": ["tests/a/test_b.py::test_c"]}
FURTHER = [
    EQUATION | {"label": "cost"},
    {"kind": "theorem", "place": "Sec. 2", "says": "A mean.", "tests": ["tests/a/test_b.py::test_d"]},
    EQUATION | {"label": "const1"},
    {"kind": "figure", "label": "Setup", "place": "Sec. 4", "says": "The room.", "without_code": "a photograph"},
]
SMALL = parse_items([EQUATION, *FURTHER])


@pytest.mark.parametrize(
    ("docstring", "names"),
    [
        ("σ of Eq. (NormStd) over the first axis", {"NormStd"}),
        ("the problem (cost)–(const1), by Theorem 1", {"cost", "const1", "Theorem 1"}),
        ("Eqs. (NormStd) and (const1)", {"NormStd", "const1"}),
        ("Fig. (Setup) in our words", {"Setup"}),
        ("the norm (Frobenius), cost and NormStd without parentheses, and Eq. (22) of another paper", set()),
    ],
)
def test_a_docstring_cites_labels_in_parentheses_and_theorems_by_number(docstring, names):
    assert cited(docstring, SMALL) == names


def test_what_stands_between_two_labels_is_cited_too():
    items = parse_items([EQUATION, EQUATION | {"label": "between"}, EQUATION | {"label": "last"}])
    assert cited("(NormStd)–(last)", items) == {"NormStd", "between", "last"}


@pytest.mark.parametrize("docstring", ["Eq. (NormStdd)", "Theorem 2", "Fig. (Room)", "Eqs. (cost)–(const7)"])
def test_a_citation_of_what_the_paper_does_not_have_is_refused_with_its_place(tmp_path, docstring):
    (tmp_path / "code").mkdir()
    file = tmp_path / "code/step.py"
    file.write_text(f'class Step:\n    def sample(self):\n        """{docstring}."""\n')
    with pytest.raises(ConfigError, match="which the paper does not have") as refused:
        citations(tmp_path / "code", SMALL)
    assert refused.value.evidence["file"] == file and refused.value.evidence["name"] == "code.step.Step.sample"


def test_functions_classes_and_methods_count_and_what_is_private_does_not(tmp_path):
    folder = tmp_path / "code/room"
    folder.mkdir(parents=True)
    texts = [
        '"""Module (cost)."""',
        'class A:\n    """(NormStd)"""\n    def b(self):\n        """(NormStd)"""',
        'def _c():\n    """(cost)"""',
    ]
    (folder / "d.py").write_text("\n".join([*texts, 'def e():\n    """Theorem 1"""\n', "def f(): pass\n"]))
    found = citations(tmp_path / "code", SMALL)
    names = {item: [source.name for source in sources] for item, sources in found.items()}
    expected = {"NormStd": ["code.room.d.A", "code.room.d.A.b"], "Theorem 1": ["code.room.d.e"]}
    assert names == {"cost": [], "const1": [], "Setup": []} | expected


def test_each_item_has_its_row_with_links_to_what_implements_and_shows_it():
    sources = {item.cited_as: [] for item in SMALL} | {"NormStd": [Source("pipeline.a.b", Path("pipeline/a.py"))]}
    rows = equations_page(SMALL, sources).splitlines()
    shown = "| [`pipeline.a.b`](../pipeline/a.py) | [`test_c`](../tests/a/test_b.py) |"
    assert rows[-5] == f"| Eq. 1 (NormStd) | Sec. 3 | A \\|norm\\|. {shown}"
    assert [row.split(" | ")[0] for row in rows[-5:]] == [
        "| Eq. 1 (NormStd)",
        "| Eq. 2 (cost)",
        "| Theorem 1",
        "| Eq. 3 (const1)",
        "| Fig. 1 (Setup)",
    ]
    assert "no code: a photograph" in rows[-1]


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"kind": "lemma"}, "kind"),
        ({"label": ""}, "label"),
        ({"kind": "theorem"}, "label"),
        ({"tests": ["test_b.py"]}, "tests"),
        ({"tests": []}, "tests"),
        ({"without_code": "a sketch"}, "tests"),
        ({"says": 3}, "says"),
        ({"function": "pipeline.a"}, "function"),
        ({"label": "cost"}, "label"),
    ],
)
def test_a_malformed_item_is_refused_with_its_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        parse_items([EQUATION | changes, *FURTHER])
    assert refused.value.evidence["key"] == key


ITEMS = parse_items(config.read_yaml(ROOT / "pipeline/audit/paper.yaml")["items"])
SOURCES = citations(ROOT / "pipeline", ITEMS)


def printed(text: str) -> list[tuple[str, str]]:
    """Kind and label of everything that LaTeX numbers in the paper's source, in its order."""
    text = re.sub(r"(?<!\\)%.*", "", text)
    found = []
    display = r"\\begin\{(equation|align|eqnarray|empheq)\}(.*?)\\end\{\1\}"
    figure = r"\\begin\{(figure\*?)\}.*?\\label\{(\w+)\}"
    named = r"\\textbf\{(Definition|Theorem) \d\}|\\begin\{(algorithm)\}"
    for match in re.finditer(f"{display}|{figure}|{named}", text, re.DOTALL):
        if match[1]:
            for row in rows_of(match[2]):
                label = re.search(r"\\label\{(\w+)\}", row)
                found.append(("equation", label[1] if label else ""))
        else:
            found.append(("figure", match[4]) if match[3] else ((match[5] or match[6]).lower(), ""))
    return found


def rows_of(display: str) -> list[str]:
    """The numbered rows of a display, those of matrices within it not told apart."""
    inner = r"\\begin\{(bmatrix|matrix)\}.*?\\end\{\1\}"
    rows = re.split(r"\\\\", re.sub(inner, "", display, flags=re.DOTALL))
    return [row for row in rows if row.strip() and "\\nonumber" not in row]


def test_rows_of_a_display_are_numbered_but_for_those_that_say_not():
    text = r"\begin{align} a &= b \label{One}\\ & \begin{bmatrix} 1 \\ 2 \end{bmatrix} \nonumber \\ c \end{align} \textbf{Theorem 1}: x"
    figure = r"\begin{figure*} \caption{c} \label{Fig} \end{figure*} % \begin{equation} no \end{equation}"
    assert printed(text + figure) == [("equation", "One"), ("equation", ""), ("theorem", ""), ("figure", "Fig")]


def test_nothing_that_the_paper_numbers_is_forgotten():
    if not PAPER.is_dir():
        pytest.skip("the paper's source is not beside the project")
    (file,) = PAPER.glob("*.txt")
    held = [(item.kind, item.label) for item in ITEMS]
    found = printed(file.read_text(encoding="utf-8"))
    for kind in {kind for kind, _ in found}:
        labels, ours = ([label for of, label in rows if of == kind] for rows in (found, held))
        # a label of ours stands where the paper has none, and there alone
        assert labels == ["" if "-" in label else label for label in ours]
    assert {kind for kind, _ in held} == {kind for kind, _ in found}


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.cited_as)
def test_every_item_has_a_function_unless_it_needs_no_code(item):
    assert bool(SOURCES[item.cited_as]) != bool(item.without_code)


@cache
def definitions(file: str) -> dict[str, ast.AST]:
    """What a test file defines at its top, by name."""
    tree = ast.parse((ROOT / file).read_text())
    named = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    assigned = [node for node in tree.body if isinstance(node, ast.Assign)]
    return {target.id: node for node in assigned for target in node.targets if isinstance(target, ast.Name)} | named


@cache
def imported(file: str) -> dict[str, str]:
    """Name → dotted path of what a test file imports of the pipeline."""
    nodes = [node for node in ast.walk(ast.parse((ROOT / file).read_text())) if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name: f"{node.module}.{alias.name}" for node in nodes for alias in node.names}


def used(file: str, test: str) -> set[str]:
    """Dotted paths that a test names, itself or through what its file defines."""
    found, waiting, seen = set(), [test], set()
    while waiting:
        name = waiting.pop()
        if name in seen or name not in definitions(file):
            continue
        seen.add(name)
        for node in ast.walk(definitions(file)[name]):
            if isinstance(node, ast.Name | ast.Attribute):
                head, _, rest = ast.unparse(node).partition(".")
                found.add(f"{imported(file).get(head, head)}.{rest}".rstrip("."))
                waiting.append(head)
            elif isinstance(node, ast.arg):
                waiting.append(node.arg)  # a fixture
    return found


@pytest.mark.parametrize("item", [item for item in ITEMS if item.tests], ids=lambda item: item.cited_as)
def test_every_test_that_an_item_names_exists_and_uses_what_implements_it(item):
    implementing = {source.name for source in SOURCES[item.cited_as]}
    # whoever makes an object of a class uses its methods
    classes = {owner for owner in (name.rpartition(".")[0] for name in implementing) if owner.rpartition(".")[2][:1].isupper()}
    for test in item.tests:
        file, _, name = test.partition("::")
        assert name in definitions(file), test
        assert used(file, name) & (implementing | classes), test


def test_a_test_that_does_not_use_what_implements_an_item_is_found_out():
    by = used("tests/randommatrix/test_wishart.py", "test_theta_follows_the_papers_equation_for_any_size")
    assert "pipeline.randommatrix.wishart.maxent_theta" in by and "pipeline.randommatrix.wishart.sample" not in by
