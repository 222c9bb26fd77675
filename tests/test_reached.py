"""Every function, method and class of the pipeline is used by another part of it.

A definition is used where its name occurs outside its own body, in code that is itself used.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from source_code import MODULES, ROOT, package, tree

TESTS_ALONE = "serves tests alone"  # in the docstring of a theorem of pipeline.randommatrix
Definition = ast.FunctionDef | ast.ClassDef


class Use(NamedTuple):
    """Occurrence of a name, and the module and definitions around it."""

    name: str
    user: tuple[str, ...]


def definitions(module: str) -> Iterator[tuple[tuple[str, ...], Definition, bool]]:
    """Functions, classes and methods of ``module``; True for a method that a base may call."""
    for node in tree(module).body:
        if isinstance(node, Definition):
            yield (module, node.name), node, False
            if isinstance(node, ast.ClassDef):
                for member in node.body:
                    if isinstance(member, ast.FunctionDef):
                        yield (module, node.name, member.name), member, bool(node.bases)


def uses(module: str) -> Iterator[Use]:
    """Every name and attribute that ``module`` reads; every text where it imports by name."""
    texts = "import_module" in ast.unparse(tree(module))

    def walk(node: ast.AST, user: tuple[str, ...]) -> Iterator[Use]:
        if isinstance(node, Definition) and len(user) < 3:
            user = (*user, node.name)
        if isinstance(node, ast.Name | ast.Attribute):
            yield Use(node.id if isinstance(node, ast.Name) else node.attr, user)
        elif texts and isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield Use(node.value, user)
        for child in ast.iter_child_nodes(node):
            yield from walk(child, user)

    return walk(tree(module), (module,))


def outside_python() -> Iterator[Use]:
    """Every word of the templates, and of the YAML files by which a study finds functions."""
    files = [
        *(ROOT / "pipeline").rglob("templates/*"),
        *(ROOT / "pipeline/studies").rglob("*.yaml"),
    ]
    for file in files:
        text = file.read_text(encoding="utf-8")
        for name in (*re.findall(r"\w+", text), *re.findall(r"\w+", text.replace(" ", "_"))):
            yield Use(name, (str(file),))


def unused(modules: Iterable[str], others: Iterable[Use] = ()) -> list[str]:
    """Definitions of ``modules`` whose name occurs in no other code that is used."""
    found = {place: node for m in modules for place, node, inherits in definitions(m)
             if not inherits and not exempt(place, node)}  # fmt: skip
    by_name: dict[str, list[tuple[str, ...]]] = {}
    for use in (*others, *(use for module in modules for use in uses(module))):
        by_name.setdefault(use.name, []).append(use.user)
    lost: set[tuple[str, ...]] = set()
    while True:
        more = {
            place
            for place in found.keys() - lost
            if all(
                any(user[: len(body)] == body for body in (place, *lost))
                for user in by_name.get(place[-1], [])
            )
        }
        if not more:
            return sorted(".".join(place) for place in lost)
        lost |= more


def exempt(place: tuple[str, ...], node: Definition) -> bool:
    """True where Python or pydantic calls the definition, or a theorem serves tests and says so."""
    decorators = " ".join(ast.unparse(one) for one in node.decorator_list)
    says = " ".join((ast.get_docstring(node) or "").split())
    return (
        place[-1].startswith("__")
        or "_validator" in decorators
        or (package(place[0]) == "randommatrix" and TESTS_ALONE in says)
    )


def test_every_function_is_used():
    assert unused(MODULES, outside_python()) == []


def test_a_function_that_only_an_unused_one_calls_is_unused(monkeypatch):
    source = (
        "def used(): ...\ndef inner(): inner()\ndef outer(): inner()\nclass Kept:\n"
        "    def method(self): ...\n    def dead(self): self.dead()\nKept().method(used())\n"
    )
    module = "pipeline.arm.example"
    monkeypatch.setattr(f"{__name__}.tree", {module: ast.parse(source)}.get)
    assert unused([module]) == [f"{module}.{name}" for name in ("Kept.dead", "inner", "outer")]
