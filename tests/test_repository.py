"""Imports run one way and a heavy library has one wrapper, as pipeline/IMPORTS.yaml says; every
definition is used; results depend on no global randomness and no date; committed files name no
place on one machine and no registry; the citation agrees with the package.
"""

from __future__ import annotations

import ast
import re
import subprocess
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import chain

import pytest
import yaml
from source_code import MODULES, ROOT, imports, package, pipeline_imports, tree

TABLE = yaml.safe_load((ROOT / "pipeline/IMPORTS.yaml").read_text(encoding="utf-8"))
PACKAGES, EXCEPTIONS, WRAPPERS = TABLE["packages"], TABLE["exceptions"], TABLE["wrappers"]
UPPER = {"stages", "studies", "tools", "__main__"}  # what the paper's packages never import


def roots(module: str, top: bool = False) -> set[str]:
    """The libraries and packages that ``module`` imports."""
    return {name.split(".")[0] for name in imports(module, top)}


def within(module: str, entries: list[str]) -> bool:
    """True where a module of the pipeline is, or lies in, one of ``entries`` of the table."""
    return any(f"{module}.".startswith(f"pipeline.{entry}.") for entry in entries)


def allowed(module: str) -> list[str]:
    """The entries that ``module`` may import."""
    own = package(module)
    entries = [own, "core", *PACKAGES[own]["imports"]]
    if "packages" in entries:
        entries += [name for name in PACKAGES if name not in UPPER]
    return entries + EXCEPTIONS.get(module.removeprefix("pipeline."), [])


@pytest.mark.parametrize("part", sorted(PACKAGES))
def test_imports_run_one_way(part):
    for module in (name for name in MODULES if package(name) == part):
        names = pipeline_imports(module)
        assert names <= MODULES.keys(), module
        assert {name for name in names if not within(name, allowed(module))} == set(), module


def test_the_table_has_every_package_and_no_other_and_no_circle():
    assert {package(module) for module in MODULES} == {*PACKAGES, "__init__"}
    below: set[str] = set()
    for name, entry in PACKAGES.items():  # the order of the table is the order of the layers
        assert set(entry["imports"]) - {"packages"} <= below, name
        below.add(name)
    assert not any(UPPER & set(PACKAGES[name]["imports"]) for name in set(PACKAGES) - UPPER)
    # the control: an import against the order is none that the table allows
    assert not within("pipeline.studies.filters.stage", allowed("pipeline.arm.chain"))


def test_stages_import_neither_each_other_nor_the_laboratory_but_for_record():
    for module in (name for name in MODULES if package(name) == "stages"):
        others = {package(name) for name in pipeline_imports(module)}
        assert "stages" not in others, module
        assert "laboratory" not in others or module == "pipeline.stages.record", module
    # a recorded dataset needs nothing of the laboratory to be configured
    assert not any("laboratory" in name for name in imports("pipeline.core.config", top=True))


@pytest.mark.parametrize("library", WRAPPERS)
def test_a_library_enters_through_its_wrapper(library):
    users = [module for module in MODULES if library in roots(module)]
    assert users, f"nothing imports {library}: take it out of the table"
    assert [module for module in users if not within(module, WRAPPERS[library])] == []


@pytest.mark.parametrize("library", TABLE["late"])
def test_what_takes_long_to_import_is_imported_by_the_function_that_needs_it(library):
    packages = [module for module in MODULES if package(module) not in {"studies", "tools"}]
    assert [module for module in packages if library in imports(module, top=True)] == []
    assert any(library in imports(module) for module in packages), "nothing does: take it out"


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
    """Every word of the templates, and of the YAML files by which studies and figures are found."""
    named = [(ROOT / "pipeline" / place).rglob("*.yaml") for place in ("studies", "figures")]
    for file in chain((ROOT / "pipeline").rglob("templates/*"), *named):
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


LINES = 350
# durations decide where trials run, and nothing else
TIMED = {"pipeline.core.compute.cluster", "pipeline.core.compute.trials"}
CLOCKS = {"random", "secrets", "uuid", "datetime", "time"}
GENERATORS = {"Generator", "PCG64", "SeedSequence"}
# the brackets keep this file from matching itself
PLACES = re.compile(
    rb"(?<![\w.])/(hom[e]|roo[t]|User[s]|wor[k]|tm[p]|op[t]|mn[t])/\w|[A-Z]:\\\\?User[s]"
)
REGISTRIES = re.compile(
    rb"pyp[i]\.org|pythonhoste[d]\.|anacond[a]\.org|artifactor[y]|index-ur[l]\s*=|extra-index-ur[l]"
)


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_modules_are_short_enough_to_be_read():
    files = [file for part in ("pipeline", "tests") for file in (ROOT / part).rglob("*.py")]
    lines = {file: file.read_text(encoding="utf-8").count("\n") for file in files}
    assert {file.name: count for file, count in lines.items() if count > LINES} == {}


def test_nothing_is_random_or_dated_but_by_its_arguments():
    for module in MODULES:
        roots = {name.split(".")[0] for name in imports(module)}
        assert roots & CLOCKS <= ({"time"} if module in TIMED else set()), module
        calls = {ast.unparse(node.func) for node in ast.walk(tree(module))
                 if isinstance(node, ast.Call)}  # fmt: skip
        made = {
            call.rpartition(".")[2] for call in calls if re.match(r"(np|numpy)\.random\.", call)
        }
        known = GENERATORS if module == "pipeline.core.rng" else set()
        assert made <= known, f"{module} makes a generator of its own"


@pytest.mark.parametrize("pattern", [PLACES, REGISTRIES], ids=["place", "registry"])
def test_no_committed_file_names_a_place_on_one_machine_or_a_package_registry(pattern):
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git repository")
    files = [ROOT / name for name in listed.stdout.split("\0") if name]
    matches = {file: pattern.findall(file.read_bytes()) for file in files if file.is_file()}
    assert {str(file): found for file, found in matches.items() if found} == {}


def test_the_citation_agrees_with_the_package_the_change_log_and_the_readme():
    citation = yaml.safe_load(read("CITATION.cff"))
    # required by the Citation File Format 1.2.0
    assert citation["cff-version"] == "1.2.0" and citation.keys() >= {"authors", "message", "title"}
    project = tomllib.loads(read("pyproject.toml"))["project"]
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    heading = re.search(r"^## (.*)$", read("CHANGELOG.md"), re.MULTILINE)[1]
    assert heading == f"{citation['version']} ({citation['date-released']})"
    readme = read("README.md")
    assert f"# {citation['title']}" == readme.splitlines()[0]
    (paper,) = citation["references"]
    names = [f"{one['given-names'][0]}. {one['family-names']}" for one in paper["authors"]]
    assert paper["title"] in " ".join(readme.split()) and ", ".join(names) in readme
