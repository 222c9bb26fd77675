"""Modules are short, results depend on no global randomness and on no date, committed files name no
place on one machine and no registry, and the citation agrees with the package.
"""

from __future__ import annotations

import ast
import re
import subprocess
import tomllib

import pytest
import yaml
from source_code import MODULES, ROOT, imports, tree

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
