"""Every function, method and class of the pipeline is used by another part of it.

A definition is used where its name occurs outside its own body, in code that is itself used.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator

from source_code import MODULES, ROOT, package, tree

TESTS_ALONE = "serves tests alone"  # in the docstring of a theorem of pipeline.randommatrix
Definition = ast.FunctionDef | ast.ClassDef
Use = tuple[str, tuple[str, ...]]  # a name, and the module and definitions around it


def definitions(module: str) -> Iterator[tuple[tuple[str, ...], Definition]]:
    """Functions, classes, and methods of classes without a base, which could call them."""
    for node in tree(module).body:
        if isinstance(node, Definition):
            yield (module, node.name), node
        if isinstance(node, ast.ClassDef) and not node.bases:
            members = (member for member in node.body if isinstance(member, ast.FunctionDef))
            yield from (((module, node.name, member.name), member) for member in members)


def uses(module: str) -> Iterator[Use]:
    """Every name and attribute that ``module`` reads; every text where it imports by name."""
    texts = "import_module" in ast.unparse(tree(module))

    def walk(node: ast.AST, user: tuple[str, ...]) -> Iterator[Use]:
        if isinstance(node, Definition) and len(user) < 3:
            user = (*user, node.name)
        if isinstance(node, ast.Name | ast.Attribute):
            yield node.id if isinstance(node, ast.Name) else node.attr, user
        elif texts and isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value, user
        for child in ast.iter_child_nodes(node):
            yield from walk(child, user)

    return walk(tree(module), (module,))


def outside_python() -> Iterator[Use]:
    """Every word of the templates, and of the YAML files by which a study finds functions."""
    studies = (ROOT / "pipeline/studies").rglob("*.yaml")
    for file in (*(ROOT / "pipeline").rglob("templates/*"), *studies):
        text = file.read_text(encoding="utf-8")
        for name in (*re.findall(r"\w+", text), *re.findall(r"\w+", text.replace(" ", "_"))):
            yield name, (str(file),)


def unused(modules: Iterable[str], others: Iterable[Use] = ()) -> list[str]:
    """Definitions of ``modules`` whose name occurs in no other code that is used."""
    found = {place for module in modules for place, node in definitions(module)
             if not exempt(place, node)}  # fmt: skip
    users: dict[str, list[tuple[str, ...]]] = defaultdict(list)
    for name, user in (*others, *(use for module in modules for use in uses(module))):
        users[name].append(user)
    lost: set[tuple[str, ...]] = set()

    def in_unused_code(user: tuple[str, ...], place: tuple[str, ...]) -> bool:
        return any(user[: len(body)] == body for body in (place, *lost))

    while more := {
        place
        for place in found - lost
        if all(in_unused_code(user, place) for user in users[place[-1]])
    }:
        lost |= more
    return sorted(".".join(place) for place in lost)


def exempt(place: tuple[str, ...], node: Definition) -> bool:
    """True where Python or pydantic calls the definition, or a theorem serves tests and says so."""
    theorem = package(place[0]) == "randommatrix"
    return (
        place[-1].startswith("__")
        or any("_validator" in ast.unparse(one) for one in node.decorator_list)
        or (theorem and TESTS_ALONE in " ".join((ast.get_docstring(node) or "").split()))
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
