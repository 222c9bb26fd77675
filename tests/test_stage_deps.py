"""Every stage of the paper, of a dataset and of a study names the code and the files that its
numbers come from, and no others.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
from omegaconf import OmegaConf
from source_code import MODULES, ROOT, covers, needed, package, tree

# Every stage depends on core as a whole. What core imports by exception, the types of options,
# changes no stage but configure: the others depend on the values that they declare.
HARMLESS = {module for module in MODULES if package(module) == "core"}


def stages() -> Iterator[tuple[str, str, dict]]:
    """dvc.yaml file, name and definition of every stage."""
    for file in (ROOT / "dvc.yaml", *sorted((ROOT / "data" / "raw").glob("*/dvc.yaml"))):
        for name, stage in OmegaConf.to_container(OmegaConf.load(file))["stages"].items():
            yield str(file.relative_to(ROOT)), name, stage


# what is always run depends on nothing
STAGES = {f"{file}:{name}": s for file, name, s in stages() if not s.get("always_changed")}


def plain(entries: list) -> list[str]:
    """Paths of deps, outs or metrics, with any item of a matrix and the chosen dataset in their
    places.
    """
    dataset = OmegaConf.load(ROOT / "params.yaml").dataset
    paths = [next(iter(entry)) if isinstance(entry, dict) else entry for entry in entries]
    return [re.sub(r"\$\{item\.\w+\}", "*", path).replace("${dataset}", dataset) for path in paths]


def stage_module(stage: dict) -> str:
    name = re.fullmatch(r"python -m pipeline (\w+).*", stage["cmd"])[1]
    module = f"pipeline.stages.{name}"
    return module if module in MODULES else f"pipeline.tools.{name}.command"


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_depends_on_the_code_that_it_runs(stage):
    module = stage_module(STAGES[stage])
    assert module in MODULES
    files = [MODULES[name] for name in needed(module, HARMLESS)]
    # the package itself holds one line of text
    read = {str(file.relative_to(ROOT)) for file in files if file.stat().st_size}
    read.discard("pipeline/__init__.py")
    code = [path for path in plain(STAGES[stage]["deps"]) if covers("pipeline", path)]
    assert any(covers(path, "pipeline/core") for path in code)
    assert sorted(file for file in read if not any(covers(path, file) for path in code)) == []
    # and on no other; options are found by their places, or read as texts
    result = {"pipeline/core"}
    if module.endswith((".choose", ".configure")):
        result |= {"pipeline/conf", "pipeline/conf/dataset"}
        result |= {"pipeline/laboratory/options.py", "pipeline/models"}
    if module.endswith(".predict"):
        result |= {"pipeline/conf/model"}  # of the plain models beside the run's
    if module.endswith(".report"):
        # the docstrings of all code of the paper say what implements what
        result |= {path for path in code if path not in ("pipeline/studies", "pipeline/tools")}
    idle = [path for path in code if not any(covers(path, file) for file in read)]
    assert set(idle) <= result


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_depends_on_the_robots_description_where_it_loads_a_robot(stage):
    if "pipeline.arm.model" in needed(stage_module(STAGES[stage]), HARMLESS):
        assert "pipeline/arm" in STAGES[stage]["deps"]
        assert any(
            "dataset.robot" in keys for entry in STAGES[stage]["params"] for keys in entry.values()
        )


@pytest.mark.parametrize("stage", STAGES)
def test_what_a_stage_depends_on_exists_or_is_written_by_another(stage):
    written = [
        path
        for other in STAGES.values()
        for path in plain([*other.get("outs", []), *other.get("metrics", [])])
    ]
    for path in plain(STAGES[stage]["deps"]):
        if path.startswith("${"):  # a folder that a dataset's option names, outside the project
            continue
        made = any(covers(path, out) or covers(out, path) for out in written)
        assert made or (ROOT / path).exists(), f"{stage} depends on {path}"


# folders from which configure removes results of models that are not chosen
CLEANED = {"dvc.yaml:configure": {"data/fit", "data/filter"}}


@pytest.mark.parametrize("stage", STAGES)
def test_the_folders_that_a_stage_names_are_its_deps_and_outs(stage):
    declared = plain(
        [entry for kind in ("deps", "outs", "metrics") for entry in STAGES[stage].get(kind, [])]
    )
    named = set()
    inside_texts = set()
    for node in ast.walk(tree(stage_module(STAGES[stage]))):
        if isinstance(node, ast.JoinedStr):
            named.add(
                "".join(
                    part.value if isinstance(part, ast.Constant) else "*" for part in node.values
                )
            )
            inside_texts |= {id(part) for part in node.values}
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in inside_texts
        ):
            named.add(node.value)
    for path in named - CLEANED.get(stage, set()):
        if re.fullmatch(r"(data|reports)/[\w*./]+", path) and not path.endswith("dvc.yaml"):
            assert any(covers(path, other) or covers(other, path) for other in declared), (
                f"{stage} opens {path}"
            )


STUDIES = sorted((ROOT / "pipeline/studies").glob("*/dvc.yaml"))


@pytest.mark.parametrize("file", STUDIES, ids=lambda file: file.parent.name)
def test_a_study_names_its_code_and_options_and_not_its_own_lock_file(file):
    place = str(file.parent.relative_to(ROOT))
    stage = OmegaConf.to_container(OmegaConf.load(file))["stages"][file.parent.name]
    read = {MODULES[name] for name in needed(f"{place.replace('/', '.')}.stage", HARMLESS)}
    read |= {other for other in file.parent.rglob("*.*") if other.suffix in (".py", ".yaml")}
    read = {str(path.relative_to(ROOT)) for path in read - {file} if path.stat().st_size}
    deps = [path for path in plain(stage["deps"]) if covers("pipeline", path)]
    missing = {path for path in read if not any(covers(dep, path) for dep in deps)}
    assert missing - {"pipeline/__init__.py"} == set()
    # DVC writes the lock after the stage: a stage that depends on it is never up to date
    assert not any(covers(dep, f"{place}/dvc.lock") for dep in deps)
