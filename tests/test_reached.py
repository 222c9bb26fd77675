"""Every function, method and class of the pipeline is reached by another part of it.

A definition is reached when a name refers to it outside its own body, in code that is reached
itself. Python's own methods are called by Python. A function of a package for theorems may serve
tests alone where its docstring says so.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from source_code import MODULES, ROOT, package, tree

from pipeline.core.typed_yaml import read_yaml

TESTS_ALONE = "serves tests alone"  # what such a docstring says
Definition = ast.FunctionDef | ast.ClassDef


@dataclass(frozen=True)
class Reference:
    """A use of a name: by whom, and what it may mean."""

    user: tuple[str, ...]  # module and the definitions around the use
    target: str | None  # module.name where it is known, else None
    name: str


def definitions(module: str) -> Iterator[tuple[tuple[str, ...], Definition]]:
    """Functions, classes and their methods, each by module and names."""
    for node in tree(module).body:
        if isinstance(node, Definition):
            yield (module, node.name), node
            if isinstance(node, ast.ClassDef):
                for member in node.body:
                    if isinstance(member, ast.FunctionDef):
                        yield (module, node.name, member.name), member


def meanings(module: str) -> tuple[dict[str, str], set[str]]:
    """What the names of a module stand for, and which of them come from outside the pipeline."""
    meant = {node.name: f"{module}.{node.name}" for _, node in definitions(module)}
    foreign = set()
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            source = f"{node.module}." if isinstance(node, ast.ImportFrom) else ""
            for alias in node.names:
                name = alias.asname or alias.name
                meant[name] = source + alias.name
                if not meant[name].startswith("pipeline"):
                    foreign.add(name)
    return meant, foreign


def references(module: str) -> Iterator[Reference]:
    """Every name that is read in a module, and every attribute."""
    meant, foreign = meanings(module)
    finds = "import_module" in meant  # then any attribute and text may name what was found

    def walk(node: ast.AST, user: tuple[str, ...]) -> Iterator[Reference]:
        if isinstance(node, Definition) and len(user) < 3:
            user = (*user, node.name)
        if isinstance(node, ast.Name):
            yield Reference(user, meant.get(node.id), node.id)
        elif isinstance(node, ast.Attribute):
            base = ast.unparse(node.value)
            if base in meant and base not in foreign:
                yield Reference(user, f"{meant[base]}.{node.attr}", node.attr)
            elif base not in foreign:
                yield Reference(user, "*" if finds else None, node.attr)
        elif finds and isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield Reference(user, "*", node.value)
        for child in ast.iter_child_nodes(node):
            yield from walk(child, user)

    yield from walk(tree(module), (module,))


def template_references() -> Iterator[Reference]:
    """Every attribute in the templates of pages."""
    for file in (ROOT / "pipeline").rglob("templates/*"):
        for name in re.findall(r"\.(\w+)", file.read_text(encoding="utf-8")):
            yield Reference((str(file),), None, name)


def named_references() -> Iterator[Reference]:
    """Every key and every text of the studies' YAML files, by which a study finds functions."""
    for file in (ROOT / "pipeline/studies").glob("*/*.yaml"):
        waiting: list[object] = [read_yaml(file)]
        while waiting:
            match waiting.pop():
                case dict() as keys:
                    waiting += [*keys, *keys.values()]
                case list() as entries:
                    waiting += entries
                case str() as text:
                    name = text.rpartition(".")[2].replace(" ", "_")
                    yield Reference((str(file),), "*", name)


def unreached(modules: list[str]) -> list[str]:
    """The definitions of ``modules`` that none of their code reaches."""
    result = {place: node for module in modules for place, node in definitions(module)}
    called = {place for module in modules for place in called_by_libraries(module)}
    by_name = defaultdict(list)
    named = (*template_references(), *named_references())
    for reference in (*named, *(use for m in modules for use in references(m))):
        by_name[reference.name].append(reference)
    lost: set[tuple[str, ...]] = set()
    while True:
        more = {
            place
            for place, node in result.items()
            if place not in lost | called
            and not exempt(place, node)
            and not any(reaches(reference, place, lost) for reference in by_name[place[-1]])
        }
        if not more:
            return sorted(".".join(place) for place in lost)
        lost |= more


def reaches(reference: Reference, place: tuple[str, ...], lost: set[tuple[str, ...]]) -> bool:
    """Whether the reference, from code that is not lost, may mean the definition at ``place``."""
    if any(reference.user[: len(inner)] == inner for inner in (place, *lost)):
        return False
    if len(place) == 3 or reference.target == "*":
        return True
    return reference.target == ".".join(place)


def called_by_libraries(module: str) -> Iterator[tuple[str, ...]]:
    """The methods of classes that extend one of a library, which calls them, of protocols, and of
    the classes that such a class mixes in.
    """
    foreign = meanings(module)[1]
    classes = [node for node in tree(module).body if isinstance(node, ast.ClassDef)]
    bases = {node.name: [ast.unparse(base) for base in node.bases] for node in classes}
    extending = {
        name for name, named in bases.items() if foreign & {base.split(".")[0] for base in named}
    }
    extending |= {base for name in extending for base in bases[name]}
    for node in classes:
        for member in node.body:
            if node.name in extending and isinstance(member, ast.FunctionDef):
                yield module, node.name, member.name


def exempt(place: tuple[str, ...], node: Definition) -> bool:
    """Whether Python or pydantic calls it, or it serves tests and says so."""
    if place[-1].startswith("__") and place[-1].endswith("__"):
        return True
    if any("model_validator" in ast.unparse(one) for one in node.decorator_list):
        return True
    says = " ".join((ast.get_docstring(node) or "").split())
    return package(place[0]) == "randommatrix" and TESTS_ALONE in says


def test_every_function_is_reached():
    assert unreached(list(MODULES)) == []


def test_a_function_that_only_an_unreached_one_calls_is_unreached(monkeypatch):
    source = (
        "def used(): ...\ndef inner(): inner()\ndef outer(): inner()\nclass Kept:\n"
        "    def method(self): ...\n    def dead(self): self.dead()\nKept().method(used())\n"
    )
    monkeypatch.setitem(MODULES, "pipeline.arm.example", None)
    trees = {"pipeline.arm.example": ast.parse(source)}
    monkeypatch.setattr(f"{__name__}.tree", trees.get)
    assert unreached(list(trees)) == [
        f"pipeline.arm.example.{name}" for name in ("Kept.dead", "inner", "outer")
    ]
