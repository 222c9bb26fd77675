"""Each item of the paper has its row, functions that cite it and tests that use these functions;
errata and claims have the numbers of a run and name tests that exist.
"""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from case_tables import cases_beside

from pipeline.configuration import config
from pipeline.core.errors import ConfigError
from pipeline.core.validation import validated
from pipeline.verdicts import paper, scores
from pipeline.verdicts.claims import ClaimsFile, parse_claims
from pipeline.verdicts.decision import decide, decide_each
from pipeline.verdicts.run import Run, read_run

EQUATION = {
    "kind": "equation",
    "label": "NormStd",
    "place": "Sec. 3",
    "says": "A |norm|.",
}
EQUATION |= {"tests": ["tests/a/test_b.py::test_c"]}
THEOREM = {"kind": "theorem", "place": "Sec. 2", "says": "A mean."}
FIGURE = {"kind": "figure", "label": "Setup", "place": "Sec. 4", "says": "The room."}
FURTHER = [
    EQUATION | {"label": "cost"},
    THEOREM | {"tests": ["tests/a/test_b.py::test_d"]},
    EQUATION | {"label": "const1"},
    FIGURE | {"without_code": "a photograph"},
]
SMALL = paper.parse_items([EQUATION, *FURTHER])
cases = cases_beside(__file__)


@cases("citations")
def test_a_docstring_cites_labels_in_parentheses_and_theorems_by_number(
    docstring,
    names,
):
    assert paper.cited_items(docstring, SMALL) == {*names}


@pytest.mark.parametrize(
    "docstring",
    ["Eq. (NormStdd)", "Theorem 2", "Fig. (Room)", "Eqs. (cost)–(const7)"],
)
def test_a_citation_of_what_the_paper_does_not_have_is_refused_with_its_place(
    tmp_path,
    docstring,
):
    file = tmp_path / "step.py"
    file.write_text(f'class Step:\n    def sample(self):\n        """{docstring}."""\n')

    with pytest.raises(ConfigError, match="which the paper does not have") as refused:
        paper.citations(tmp_path, SMALL)
    assert refused.value.evidence["file"] == file
    assert refused.value.evidence["name"].endswith("step.Step.sample")


ROOT = Path(__file__).parents[2]
ITEMS = paper.parse_items(
    config.read_yaml(ROOT / "pipeline/verdicts/paper.yaml")["items"],
)
SOURCES = paper.citations(ROOT / "pipeline", ITEMS)
NUMBERED = {"equation": 42, "figure": 11, "theorem": 5, "definition": 2, "algorithm": 2}


def test_nothing_that_the_paper_numbers_is_forgotten():
    assert Counter(item.kind for item in ITEMS) == NUMBERED


@cache
def parsed(file: str) -> tuple[dict[str, ast.AST], dict[str, str]]:
    """Return by name what a test file defines at its top, and dotted paths of what it imports."""
    named = {}
    imported = {}
    for node in ast.parse((ROOT / file).read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            named[node.name] = node
        elif isinstance(node, ast.Assign):
            for name in names_in(node.targets):
                named[name] = node
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                imported[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    return named, imported


def names_in(targets: list[ast.expr]) -> set[str]:
    """Return the names to which a statement assigns."""
    names = set()
    for target in targets:
        nodes = ast.walk(target)
        names |= {node.id for node in nodes if isinstance(node, ast.Name)}
    return names


def helper_of(source: str) -> tuple[str, str] | None:
    """Return file and name of a helper of the tests by its dotted path, None for other code."""
    module, _, name = source.rpartition(".")
    folder = "" if module.startswith("tests.") else "tests/helpers/"
    helper = f"{folder}{module.replace('.', '/')}.py"
    return (helper, name) if (ROOT / helper).is_file() else None


def used(file: str, test: str) -> set[str]:
    """Return the dotted paths that a test names, itself or through its file or a helper of the
    tests.
    """
    names = set()
    waiting = [(file, test)]
    visited = set()

    while waiting:
        place, name = waiting.pop()
        definitions, imported = parsed(place)
        if (place, name) in visited or name not in definitions:
            continue
        visited.add((place, name))
        for node in ast.walk(definitions[name]):
            if isinstance(node, ast.Name | ast.Attribute):
                head, _, rest = ast.unparse(node).partition(".")
                source = imported.get(head, head)
                names.add(f"{source}.{rest}".rstrip("."))
                waiting.append(helper_of(source) or (place, head))
            elif isinstance(node, ast.arg):
                waiting.append((place, node.arg))  # a fixture
    return names


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.cited_as)
def test_every_item_has_a_function_or_needs_none_and_tests_that_exist_and_use_it(item):
    implementing = {source.name for source in SOURCES[item.cited_as]}
    assert (implementing == set()) == (item.without_code != "")

    # whoever makes an object of a class uses its methods
    owners = {name.rpartition(".")[0] for name in implementing}
    classes = {owner for owner in owners if owner.rpartition(".")[2][:1].isupper()}
    for test in item.tests:
        file, _, name = test.partition("::")
        definitions, _ = parsed(file)
        assert name in definitions, test
        assert used(file, name) & (implementing | classes), test


def test_a_test_that_does_not_use_what_implements_an_item_is_found_out():
    name = "test_theta_follows_the_papers_equation_for_any_size"
    by = used("tests/randommatrix/test_laws.py", name)

    assert "pipeline.randommatrix.wishart.maxent_theta" in by
    assert "pipeline.randommatrix.wishart.degrees_of_freedom" not in by


ENTRY = {
    "id": "bias",
    "title": "A biased estimator",
    "place": "Sec. 4",
    "paper": "It is.",
}
ENTRY |= {"fact": "It is {{ metric('fit', 'std_{joint 1}') }}."}
ENTRY |= {
    "done": "A sum of {{ claim('sigma', 'walk') }}, speed {{ claim('sigma', 'speed') }}.",
}
ENTRY |= {"tests": ["tests/models/test_noise.py::test_one"]}
CLAIM = {key: key for key in ("where", "statement", "quantity", "reason")} | {
    "id": "sigma",
}
CLAIM |= {
    "about": "method",
    "rule": "within_relative",
    "tolerance": 0.1,
    "published": 0.25,
}
CLAIM |= {"value": {"quantity": "sigma_b"}}


@pytest.mark.parametrize(
    ("fit", "ours"),
    [({"std_shoulder": 0.28765}, "0.2877"), ({}, paper.MISSING)],
)
def test_numbers_of_the_run_and_of_the_claims_stand_in_the_prose(fit, ours):
    arm = (["shoulder", "elbow", "wrist"], ["x", "z", "phi"])
    run = Run("lab", "paper", True, *arm, {}, {"fit": fit}, {})
    decided = decide_each(parse_claims([CLAIM]), [run], [])

    text = paper.errata_page(paper.parse_errata([ENTRY]), run, decided)

    assert f"**In fact**: It is {ours}." in text
    # of the published variance a step: standard deviation of the sum of the steps, and speed
    assert "A sum of 8.944, speed 50." in text
    for wrong in (
        "{{ metric('fit') }}",
        "{{ evidence('stdd') }}",
        "{{ value }}",
        "{{ level(",
    ):
        errata = paper.parse_errata([ENTRY | {"fact": wrong}])
        with pytest.raises(ConfigError, match=r"correct it \[erratum bias"):
            paper.errata_page(errata, run, decided)


@cases("wrong items")
def test_a_malformed_item_is_refused_with_its_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        paper.parse_items([EQUATION | changes, *FURTHER])
    assert refused.value.evidence["key"].startswith(key)


@cases("wrong errata")
def test_a_malformed_erratum_is_refused_with_its_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        paper.parse_errata([ENTRY | changes])
    assert refused.value.evidence["key"].startswith(key)


@pytest.fixture(scope="module")
def errata() -> list[paper.Erratum]:
    return paper.parse_errata(
        config.read_yaml(ROOT / "pipeline/verdicts/errata.yaml")["errata"],
    )


@pytest.fixture(scope="module")
def youbot() -> Run:
    """Return the run on the synthetic youBot, which has every instrument."""
    return read_run(ROOT / "reports/datasets/youbot.json")


CLAIMS = parse_claims(
    validated(
        ClaimsFile,
        config.read_yaml(ROOT / "pipeline/verdicts/claims.yaml"),
    ).claims,
)
TYPED = r"\d[.,]\d|\de-?\d"  # a measured number; they come from a run


def test_every_erratum_has_its_numbers_in_the_run_and_tests_that_exist(errata, youbot):
    page = paper.errata_page(errata, youbot, decide_each(CLAIMS, [youbot], []))
    assert paper.MISSING not in page
    assert len({erratum.id for erratum in errata}) == len(errata)

    for erratum in errata:
        for test in erratum.tests:
            file, _, name = test.partition("::")
            definitions, _ = parsed(file)
            assert name.startswith("test_") and name in definitions, test
        text = f"{erratum.title} {erratum.paper} {erratum.fact} {erratum.done}"
        assert not re.search(TYPED, text), erratum.id


def test_every_claim_has_evidence_that_a_stage_writes(youbot):
    missing = set()
    for verdict in decide(CLAIMS, youbot.evidence, "paper", youbot.arm):
        if any(case.value is None for case in verdict.cases):
            missing.add(verdict.claim.id)
    # a û without a bound and its α̂ have no number
    assert missing <= {"u", "alpha"}

    unless = [claim.unless for claim in CLAIMS if claim.unless]
    between = [rule for rule in unless if rule.value.quantity == scores.BETWEEN]
    assert {rule.limit for rule in between} == {scores.LIMIT}


def test_reasons_of_claims_name_datasets_and_errata_and_hold_no_number(errata):
    datasets = set()
    reasons = []
    for claim in CLAIMS:
        datasets |= {*claim.why}
        reasons += claim.why.values()
    assert datasets <= {*config.option_names("dataset")}

    text = "\n".join(reasons)
    linked = set(re.findall(r"\(errata\.md#(.*?)\)", text))
    assert linked <= {erratum.id for erratum in errata}
    assert not re.search(TYPED, text)
