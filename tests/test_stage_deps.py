"""Every stage of the paper, of a dataset and of a study names the code and the files that its
numbers come from, and no others.
"""

import ast
import re
from itertools import product

import pytest
import yaml
from source_code import MODULES, ROOT, covers, needed, package, tree

from pipeline.configuration import config
from pipeline.evidence.case import KINDS

# What composes the configuration changes no stage but choose and configure: the others depend on
# the values that they declare.
HARMLESS = {module for module in MODULES if package(module) == "configuration"}
DATASET = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))["dataset"]
# folders from which configure removes results of models that are not selected
CLEANED = {"dvc.yaml:configure": {"data/fit", "data/filter"}}
# only compared: as deps they would have every dataset's files listed again by each `dvc repro`
COMPARED = {"dvc.yaml:report": {"data/raw/*/inventory.csv"}}


def stages(*patterns: str) -> dict[str, dict]:
    """Definition of every stage of the dvc.yaml files, by file and name."""
    definitions = {}
    for pattern in patterns:
        for file in sorted(ROOT.glob(pattern)):
            place = file.relative_to(ROOT)
            content = yaml.safe_load(file.read_text(encoding="utf-8"))
            for name, stage in content["stages"].items():
                definitions[f"{place}:{name}"] = stage
    return definitions


PAPER = stages("dvc.yaml", "data/raw/*/dvc.yaml")
# a stage that always runs has no dependencies
STAGES = {
    name: stage for name, stage in PAPER.items() if not stage.get("always_changed")
}
STUDIES = stages("pipeline/studies/*/dvc.yaml")
every_stage = pytest.mark.parametrize("stage", STAGES)


def paths(stage: dict, *kinds: str) -> list[str]:
    """Paths of deps, outs or metrics, with any item of a matrix and the chosen dataset in their
    places.
    """
    result = []
    for kind in kinds:
        for entry in stage.get(kind, []):
            name = next(iter(entry)) if isinstance(entry, dict) else entry
            name = re.sub(r"\$\{item\.\w+\}", "*", name)
            result.append(name.replace("${dataset}", DATASET))
    return result


def code(stage: dict) -> list[str]:
    return [path for path in paths(stage, "deps") if covers("pipeline", path)]


def tables_of(stage: dict) -> list[str]:
    """The tables that a stage says it writes."""
    files = [entry for entry in stage.get("params", []) if isinstance(entry, dict)]
    return [name for entry in files for name in entry.get("pipeline/tables.yaml", [])]


def stage_module(stage: dict) -> str:
    name = re.fullmatch(r"python -m pipeline (\w+).*", stage["cmd"])[1]
    module = f"pipeline.stages.{name}"
    return module if module in MODULES else f"pipeline.tools.{name}.command"


def sources(module: str) -> set[str]:
    """The files that a stage runs on; the package itself holds one line of text."""
    harmless = HARMLESS
    if module.endswith(".configure"):  # uses only the types of the models' options
        unused = {name for name in MODULES if package(name) in ("arm", "statistics")}
        harmless = HARMLESS | unused
    names = needed(module, harmless)
    if "pipeline.evidence.outcomes" in names and not module.endswith(".score"):
        # a case builds and fits the models of the paper's kinds, which are found by their place
        for kind, place in product(KINDS, ("law", "fit")):
            names |= needed(f"pipeline.models.{kind}.{place}", harmless)

    files = {MODULES[name] for name in names}
    # a module reads the YAML file of its name beside it
    beside = {file.with_suffix(".yaml") for file in files}
    files |= {file for file in beside if file.is_file()}

    names = {str(file.relative_to(ROOT)) for file in files if file.stat().st_size}
    return names - {"pipeline/__init__.py"}


def uncovered(files: set[str], deps: list[str]) -> set[str]:
    return {file for file in files if not any(covers(path, file) for path in deps)}


@every_stage
def test_a_stage_depends_on_the_code_that_it_runs_and_on_no_other(stage):
    definition = STAGES[stage]
    module = stage_module(definition)
    deps = code(definition)
    read = sources(module)
    assert any(covers(path, "pipeline/core") for path in deps)
    assert uncovered(read, deps) == set()

    # options are found by their places, or read as texts
    result = set()
    if module.endswith((".choose", ".configure")):
        assert "pipeline/configuration" in deps
        result |= {"pipeline/configuration", "pipeline/conf", "pipeline/conf/dataset"}
        result |= {"pipeline/laboratory/options.py", "pipeline/laboratory/causes"}
        result |= {"pipeline/models"}
    if module.endswith(".predict"):
        result |= {"pipeline/conf/model"}  # of the plain models beside the run's
    if module.endswith(".report"):
        # the docstrings of all code of the paper say what implements what
        result |= {
            path for path in deps if path not in ("pipeline/studies", "pipeline/tools")
        }
    unread = {path for path in deps if not any(covers(path, file) for file in read)}
    assert unread <= result
    if "pipeline/arm/model.py" in read:
        assert "pipeline/arm" in deps
        params = [keys for entry in definition["params"] for keys in entry.values()]
        assert any("dataset.robot" in keys for keys in params)


@every_stage
def test_the_folders_that_a_stage_names_are_its_deps_and_outs(stage):
    declared = paths(STAGES[stage], "deps", "outs", "metrics")
    texts = texts_of(tree(stage_module(STAGES[stage])))
    opened = texts - CLEANED.get(stage, set()) - COMPARED.get(stage, set())

    for path in opened:
        is_place = re.fullmatch(r"(data|reports)/[\w*./]+", path)
        if is_place and not path.endswith("dvc.yaml"):
            overlaps = [covers(path, d) or covers(d, path) for d in declared]
            assert any(overlaps), f"{stage} opens {path}"


def texts_of(module: ast.Module) -> set[str]:
    """Return every text of a module, with * for what an f-string fills in."""
    texts = set()
    inside = set()
    for node in ast.walk(module):
        if isinstance(node, ast.JoinedStr):
            inside |= {id(value) for value in node.values}
            texts.add("".join(literal(value) for value in node.values))
        elif isinstance(node, ast.Constant) and id(node) not in inside:
            texts.add(str(node.value))
    return texts


def literal(node: ast.expr) -> str:
    """Return the text of a literal piece of an f-string, * for a piece that is filled in."""
    text = getattr(node, "value", None)
    return text if isinstance(text, str) else "*"


def test_a_further_model_changes_no_parameter_of_the_readings(tmp_path):
    params = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    composed = []
    for further in ([], ["joint_step"]):
        file = tmp_path / "params.yaml"
        file.write_text(yaml.safe_dump(params | {"models": params["models"] + further}))
        config.write_config(file, tmp_path / "config.yaml")
        composed.append(yaml.safe_load((tmp_path / "config.yaml").read_text()))
    (entry,) = [
        keys["data/config.yaml"]
        for keys in STAGES["dvc.yaml:readings"]["params"]
        if "data/config.yaml" in keys
    ]
    changed = {key for key in composed[0] if composed[0][key] != composed[1][key]}

    assert changed == {"models"}
    assert changed.isdisjoint(entry)


def test_every_table_is_named_by_the_stages_that_write_it():
    """The whole reproduction compares the names with the files."""
    declared = yaml.safe_load(
        (ROOT / "pipeline/tables.yaml").read_text(encoding="utf-8"),
    )
    named = {name for stage in PAPER.values() for name in tables_of(stage)}
    assert named == {name for name in declared if name[0] != "."}


@pytest.mark.parametrize("stage", STUDIES)
def test_a_study_names_its_code_and_options_and_not_its_own_lock_file(stage):
    place = stage.partition("/dvc.yaml:")[0]
    read = sources(f"{place.replace('/', '.')}.stage")
    for pattern in ("*.py", "*.yaml"):
        files = [file for file in (ROOT / place).rglob(pattern) if file.stat().st_size]
        read |= {str(file.relative_to(ROOT)) for file in files}
    deps = code(STUDIES[stage])

    assert uncovered(read, deps) <= {f"{place}/dvc.yaml"}
    # DVC writes the lock after the stage: a stage that depends on it is never up to date
    assert not any(covers(path, f"{place}/dvc.lock") for path in deps)
