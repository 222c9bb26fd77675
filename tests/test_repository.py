"""Imports run one way and a heavy library has one wrapper, as pipeline/IMPORTS.yaml says; every
definition is used; results depend on no global randomness and no date; committed files name no
place on one machine and no registry; the citation agrees with the package.
"""

import ast
import re
import subprocess
import tomllib
from collections.abc import Iterable, Iterator

import pytest
import yaml
from source_code import MODULES, ROOT, imports, package, pipeline_imports, tree

TABLE = yaml.safe_load((ROOT / "pipeline/IMPORTS.yaml").read_text(encoding="utf-8"))
PACKAGES = TABLE["packages"]
EXCEPTIONS = TABLE["exceptions"]
WRAPPERS = TABLE["wrappers"]
# the paper's packages import none of these
UPPER = {"stages", "studies", "tools", "__main__"}


def roots(module: str, top: bool = False) -> set[str]:
    """The libraries and packages that ``module`` imports."""
    return {name.split(".")[0] for name in imports(module, top)}


def within(module: str, entries: list[str]) -> bool:
    """True where a module of the pipeline is, or lies in, one of ``entries`` of the table."""
    return any(f"{module}.".startswith(f"pipeline.{entry}.") for entry in entries)


def allowed(module: str) -> list[str]:
    """The entries that ``module`` may import."""
    name = package(module)
    entries = [name, "core", *PACKAGES[name]["imports"]]
    if "packages" in entries:
        entries += [lower for lower in PACKAGES if lower not in UPPER]
    exceptions = EXCEPTIONS.get(module.removeprefix("pipeline."), [])
    return entries + exceptions


@pytest.mark.parametrize("package_name", sorted(PACKAGES))
def test_imports_run_one_way(package_name):
    modules = [name for name in MODULES if package(name) == package_name]
    for module in modules:
        imported = pipeline_imports(module)
        assert imported <= MODULES.keys(), module
        entries = allowed(module)
        against = [name for name in imported if not within(name, entries)]
        assert against == [], module


def test_the_table_has_every_package_and_no_other_and_no_circle():
    assert {package(module) for module in MODULES} == {*PACKAGES, "__init__"}

    below: set[str] = set()
    # the order of the table is the order of the layers
    for name, entry in PACKAGES.items():
        assert set(entry["imports"]) - {"packages"} <= below, name
        below.add(name)
    assert not any(
        UPPER & set(PACKAGES[name]["imports"]) for name in set(PACKAGES) - UPPER
    )
    # the control: the table does not allow an import against the order
    assert not within("pipeline.studies.recovery.stage", allowed("pipeline.arm.chain"))


def test_no_module_imports_itself_through_others():
    """Imports within functions and for annotations count."""
    below = {
        name: (pipeline_imports(name) & MODULES.keys()) - {name} for name in MODULES
    }
    while leaves := [name for name, names in below.items() if not names & below.keys()]:
        for name in leaves:
            del below[name]
    assert below == {}


def test_stages_import_neither_each_other_nor_the_laboratory_but_for_record():
    for module in (name for name in MODULES if package(name) == "stages"):
        imported = {package(name) for name in pipeline_imports(module)}
        assert "stages" not in imported, module
        if module != "pipeline.stages.record":
            assert "laboratory" not in imported, module
    # a recorded dataset needs nothing of the laboratory to be configured
    at_import = imports("pipeline.configuration.config", top=True)
    assert not any("laboratory" in name for name in at_import)


@pytest.mark.parametrize("library", WRAPPERS)
def test_a_library_enters_through_its_wrapper(library):
    users = [module for module in MODULES if library in roots(module)]
    assert users, f"nothing imports {library}: take it out of the table"
    assert [module for module in users if not within(module, WRAPPERS[library])] == []


@pytest.mark.parametrize("library", TABLE["late"])
def test_a_slow_library_is_imported_by_the_function_that_needs_it(library):
    packages = [
        module for module in MODULES if package(module) not in {"studies", "tools"}
    ]
    assert [module for module in packages if library in imports(module, top=True)] == []
    assert any(library in imports(module) for module in packages), (
        "nothing does: take it out"
    )


Definition = ast.FunctionDef | ast.ClassDef


def definitions(module: ast.Module) -> Iterator[Definition]:
    """Functions, classes, and methods of classes without a base, which could call them."""
    for node in module.body:
        if isinstance(node, Definition):
            yield node
        if isinstance(node, ast.ClassDef) and not node.bases:
            yield from (
                member for member in node.body if isinstance(member, ast.FunctionDef)
            )


def called_from_outside(node: Definition) -> bool:
    """True where Python or pydantic calls it."""
    decorators = " ".join(map(ast.unparse, node.decorator_list))
    return node.name.startswith("__") or "_validator" in decorators


def names_read(modules: dict[str, ast.Module]) -> Iterator[str]:
    """Every name and attribute; every word of a text where modules are imported by their names."""
    for module in modules.values():
        by_name = "import_module" in ast.unparse(module)
        for node in ast.walk(module):
            match node:
                case ast.Name(id=name) | ast.Attribute(attr=name):
                    yield name
                case ast.Constant(value=str(text)) if by_name:
                    yield from re.findall(r"\w+", text)


def words_outside_python() -> Iterator[str]:
    """Every word of the templates and of the YAML files of studies and figures."""
    for pattern in ("**/templates/*", "studies/**/*.yaml", "figures/**/*.yaml"):
        for file in (ROOT / "pipeline").glob(pattern):
            text = file.read_text(encoding="utf-8")
            yield from re.findall(r"\w+", text)
            yield from re.findall(r"\w+", text.replace(" ", "_"))


def unused(modules: dict[str, ast.Module], words: Iterable[str] = ()) -> list[str]:
    """Definitions whose name is read nowhere and is none of the ``words``."""
    used = {*words, *names_read(modules)}
    names = []
    for module, content in modules.items():
        for node in definitions(content):
            if node.name not in used and not called_from_outside(node):
                names.append(f"{module}.{node.name}")
    return names


def test_every_function_is_used():
    assert unused({name: tree(name) for name in MODULES}, words_outside_python()) == []
    source = (
        "def used(): ...\nclass Kept:\n    def dead(self): ...\n"
        "Kept(used())\ndef lost(): ...\n"
    )
    assert unused({"example": ast.parse(source)}) == ["example.dead", "example.lost"]


LINES = 500
# durations decide where trials run, and nothing else
TIMED = {"pipeline.core.compute.cluster", "pipeline.core.compute.trials"}
CLOCKS = {"random", "secrets", "uuid", "datetime", "time"}
GENERATORS = {"Generator", "PCG64", "SeedSequence"}
# the brackets keep this file from matching itself
PLACES = re.compile(
    rb"(?<![\w.])/(hom[e]|roo[t]|User[s]|wor[k]|tm[p]|op[t]|mn[t])/\w|[A-Z]:\\\\?User[s]",
)
REGISTRIES = re.compile(
    rb"pyp[i]\.org|pythonhoste[d]\.|anacond[a]\.org|artifactor[y]|"
    rb"index-ur[l]\s*=|extra-index-ur[l]",
)


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_modules_are_short_enough_to_be_read():
    too_long = {}
    for folder in ("pipeline", "tests"):
        for file in (ROOT / folder).rglob("*.py"):
            lines = file.read_text(encoding="utf-8").count("\n")
            if lines > LINES:
                too_long[file.name] = lines
    assert too_long == {}


def test_nothing_is_random_or_dated_but_by_its_arguments():
    for module in MODULES:
        clocks = roots(module) & CLOCKS
        assert clocks <= ({"time"} if module in TIMED else set()), module
        allowed_calls = GENERATORS if module == "pipeline.core.rng" else set()
        calls = random_calls(tree(module))
        assert calls <= allowed_calls, f"{module} makes a generator of its own"


def random_calls(module: ast.Module) -> set[str]:
    """Return the names of the functions of ``numpy.random`` that a module calls."""
    calls = [node for node in ast.walk(module) if isinstance(node, ast.Call)]
    names = {ast.unparse(call.func) for call in calls}
    matches = [re.match(r"(?:np|numpy)\.random\.(\w+)", name) for name in names]
    return {match[1] for match in matches if match}


@pytest.mark.parametrize("pattern", [PLACES, REGISTRIES], ids=["place", "registry"])
def test_no_committed_file_names_a_place_on_one_machine_or_a_package_registry(pattern):
    listed = subprocess.run(
        ["git", "ls-files", "-z"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if listed.returncode:
        pytest.skip("not a git repository")
    files = [ROOT / name for name in listed.stdout.split("\0")]
    files = [file for file in files if file.is_file()]

    assert [file for file in files if pattern.search(file.read_bytes())] == []


def test_the_citation_agrees_with_the_package_the_change_log_and_the_readme():
    citation = yaml.safe_load(read("CITATION.cff"))
    # required by the Citation File Format 1.2.0
    assert citation["cff-version"] == "1.2.0"
    assert citation.keys() >= {"authors", "message", "title"}
    project = tomllib.loads(read("pyproject.toml"))["project"]
    for key in ("version", "license"):
        assert citation[key] == project[key]

    headings = re.findall(r"^## (.*)$", read("CHANGELOG.md"), re.MULTILINE)
    released = [heading for heading in headings if heading != "[Unreleased]"]
    assert released[0] == f"[{citation['version']}] - {citation['date-released']}"
    readme = read("README.md")
    assert f"# {citation['title']}" == readme.splitlines()[0]

    (paper,) = citation["references"]
    authors = [(name["given-names"], name["family-names"]) for name in paper["authors"]]
    names = [f"{given_names[0]}. {family}" for given_names, family in authors]
    assert paper["title"] in " ".join(readme.split()) and ", ".join(names) in readme
