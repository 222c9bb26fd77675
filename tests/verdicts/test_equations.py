"""What a docstring cites is found, what it cites in vain is refused, and each item has its row."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.core.errors import ConfigError
from pipeline.verdicts.equations import Source, citations, cited, equations_page, parse_items

EQUATION = {"kind": "equation", "label": "NormStd", "place": "Sec. 3", "says": "A |norm|."}
EQUATION |= {"tests": ["tests/a/test_b.py::test_c"]}
THEOREM = {"kind": "theorem", "place": "Sec. 2", "says": "A mean."}
FIGURE = {"kind": "figure", "label": "Setup", "place": "Sec. 4", "says": "The room."}
FURTHER = [
    EQUATION | {"label": "cost"},
    THEOREM | {"tests": ["tests/a/test_b.py::test_d"]},
    EQUATION | {"label": "const1"},
    FIGURE | {"without_code": "a photograph"},
]
SMALL = parse_items([EQUATION, *FURTHER])


@pytest.mark.parametrize(
    ("docstring", "names"),
    [
        ("σ of Eq. (NormStd) over the first axis", {"NormStd"}),
        ("the problem (cost)–(const1), by Theorem 1", {"cost", "const1", "Theorem 1"}),
        ("Eqs. (NormStd) and (const1)", {"NormStd", "const1"}),
        ("Fig. (Setup) in our words", {"Setup"}),
        ("the norm (Frobenius), cost without parentheses, Eq. (22) of another paper", set()),
    ],
)
def test_a_docstring_cites_labels_in_parentheses_and_theorems_by_number(docstring, names):
    assert cited(docstring, SMALL) == names


def test_what_stands_between_two_labels_is_cited_too():
    items = parse_items([EQUATION, EQUATION | {"label": "between"}, EQUATION | {"label": "last"}])
    assert cited("(NormStd)–(last)", items) == {"NormStd", "between", "last"}


@pytest.mark.parametrize(
    "docstring", ["Eq. (NormStdd)", "Theorem 2", "Fig. (Room)", "Eqs. (cost)–(const7)"]
)
def test_a_citation_of_what_the_paper_does_not_have_is_refused_with_its_place(tmp_path, docstring):
    (tmp_path / "code").mkdir()
    file = tmp_path / "code/step.py"
    file.write_text(f'class Step:\n    def sample(self):\n        """{docstring}."""\n')
    with pytest.raises(ConfigError, match="which the paper does not have") as refused:
        citations(tmp_path / "code", SMALL)
    assert refused.value.evidence["file"] == file
    assert refused.value.evidence["name"] == "code.step.Step.sample"


def test_functions_classes_and_methods_count_and_what_is_private_does_not(tmp_path):
    folder = tmp_path / "code/room"
    folder.mkdir(parents=True)
    texts = [
        '"""Module (cost)."""',
        'class A:\n    """(NormStd)"""\n    def b(self):\n        """(NormStd)"""',
        'def _c():\n    """(cost)"""',
        'def g():\n    """(const1); it serves\n    tests alone."""',
    ]
    (folder / "d.py").write_text(
        "\n".join([*texts, 'def e():\n    """Theorem 1"""\n', "def f(): pass\n"])
    )
    sources = citations(tmp_path / "code", SMALL)
    names = {item: [source.name for source in by] for item, by in sources.items()}
    assert [source.tests_alone for source in sources["const1"]] == [True]
    expected = {
        "const1": ["code.room.d.g"],
        "NormStd": ["code.room.d.A", "code.room.d.A.b"],
        "Theorem 1": ["code.room.d.e"],
    }
    assert names == {"cost": [], "const1": [], "Setup": []} | expected


def test_each_item_has_its_row_with_links_to_what_implements_and_shows_it():
    sources = {item.cited_as: [] for item in SMALL}
    sources["NormStd"] = [Source("pipeline.a.b", Path("pipeline/a.py"))]
    sources["cost"] = [Source("pipeline.c", Path("pipeline/c.py"), tests_alone=True)]
    rows = equations_page(SMALL, sources).splitlines()
    shown = "| [`pipeline.a.b`](../pipeline/a.py) | [`test_c`](../tests/a/test_b.py) |"
    assert rows[-5] == f"| Eq. 1 (NormStd) | Sec. 3 | A \\|norm\\|. {shown}"
    titles = [row.split(" | ")[0].removeprefix("| ") for row in rows[-5:]]
    assert titles[:3] == ["Eq. 1 (NormStd)", "Eq. 2 (cost)", "Theorem 1"]
    assert titles[3:] == ["Eq. 3 (const1)", "Fig. 1 (Setup)"]
    assert "[`pipeline.c`](../pipeline/c.py) (serves tests alone)" in rows[-4]
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
    assert refused.value.evidence["key"].startswith(key)
