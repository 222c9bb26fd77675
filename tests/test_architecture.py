"""The house: imports run one way, heavy libraries have one door each, and every stage names the code that its numbers come from."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from omegaconf import OmegaConf

ROOT = Path(__file__).parents[1]

# room or base module → what of the pipeline it may import; stages may import everything but each other and, save for record, twin
MAY_IMPORT = {
    "__init__": set(),
    "__main__": {"errors", "stages", "commands"},
    "commands": {"errors", "config", "datasheet", "inspection", "rerun", "contracts", "arm", "recordings", "sensitivity", "wrench"}
    | {"audit", "survey", "figures"},
    "inspection": {"errors", "datasheet", "instruments", "arm"},
    "errors": set(),
    "rng": set(),
    "compiled": set(),
    "compute": {"errors", "schema_compute"},
    "tables": set(),
    "contracts": {"errors", "tables"},
    "schema": {"errors", "schema_compute", "schema_limits", "schema_logs"},
    "schema_compute": {"errors"},
    "schema_limits": {"errors"},
    "schema_logs": {"errors"},
    "schema_datasheet": set(),
    "typed_yaml": {"errors"},
    "datasheet": {"errors", "schema_datasheet", "typed_yaml"},
    "config": {"errors", "schema", "datasheet", "typed_yaml", "twin"},  # of twin the types of its options, see below
    "arm": {"errors"},
    "instruments": {"compiled", "errors"},
    "randommatrix": {"compiled", "errors"},
    "statistics": {"compiled", "errors"},
    "perception": {"compiled", "errors", "schema", "arm", "instruments"},
    "motion": {"compiled", "errors", "schema", "arm", "randommatrix", "statistics"},
    "filtering": {"compiled", "errors", "arm", "randommatrix", "motion"},
    "sensitivity": {"errors", "schema", "arm", "perception", "motion", "filtering", "statistics"},
    "survey": {"errors", "schema", "typed_yaml", "rng", "compute", "contracts", "tables"}
    | {"arm", "perception", "motion", "filtering", "sensitivity", "wrench", "twin", "audit"},
    "wrench": {"errors", "randommatrix", "statistics"},
    "recordings": {"errors", "schema", "arm", "instruments", "perception", "wrench", "contracts", "motion"},
    "faults": {"errors", "schema", "arm", "instruments", "perception", "recordings"},
    "twin": {"errors", "arm"},
    "figures": {"errors"},
    "audit": {"errors"},
    "report": {"errors", "audit", "figures"},
    "rerun": {"errors", "typed_yaml"},
}

# library → the modules or rooms through which alone it enters
DOORS = {
    "pinocchio": ["pipeline.arm.model"],
    "cvxpy": ["pipeline.motion.convex"],
    # beside the decorators, what functions passed to others and those that take them need: the types of their arguments
    "numba": [
        *("pipeline.compiled", "pipeline.motion.compiled.law", "pipeline.filtering.sampling", "pipeline.filtering.resampling"),
        *("pipeline.perception.articulation_objective", "pipeline.perception.articulation_search"),
    ],
    "open3d": ["pipeline.twin.scene"],
    "cv2": ["pipeline.instruments", "pipeline.perception", "pipeline.twin"],
    "ezc3d": ["pipeline.instruments.c3d_library"],
    "matplotlib": ["pipeline.figures"],
    "jinja2": ["pipeline.report.page", "pipeline.report.datasheet"],
    "plotly": ["pipeline.report.player"],
    "hydra": ["pipeline.config"],
    "omegaconf": [f"pipeline.{name}" for name in ("config", "datasheet", "typed_yaml", "schema", "schema_datasheet", "schema_logs")],
    "yaml": ["pipeline.typed_yaml", "pipeline.instruments.depth_intrinsics"],
    "PIL": ["pipeline.instruments.depth", "pipeline.rerun.contents"],
    "rocrate": ["pipeline.report.crate"],
    "rosbags": ["pipeline.instruments.rosbag"],
    "pandera": ["pipeline.contracts", "pipeline.tables", "pipeline.survey.table"],
    "multiprocessing": ["pipeline.compute"],
    "concurrent": ["pipeline.compute"],
    "importlib": ["pipeline.config", "pipeline.__main__", "pipeline.compute.circumstances"],
    "dask": ["pipeline.compute.cluster"],
    "distributed": ["pipeline.compute.cluster"],
}

# Base modules that cannot change what a stage writes: errors say why nothing is written, trials give the same results wherever
# they are computed, and of the configuration a stage depends on the values it declares, not on how they are read.
SCHEMAS = ("schema", "schema_compute", "schema_datasheet", "schema_limits", "schema_logs")
CONFIGURING = {f"pipeline.{name}" for name in ("config", "datasheet", "typed_yaml", *SCHEMAS)}
COMPUTING = {f"pipeline.{name}" for name in ("compute", *(f"compute.{part}" for part in ("block", "circumstances", "cluster", "trials")))}
HARMLESS = {"pipeline.errors", *COMPUTING, *CONFIGURING}


def name_of(file: Path) -> str:
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 2 else parts)


MODULES = {name_of(file): file for file in sorted((ROOT / "pipeline").rglob("*.py"))}


def room_of(module: str) -> str:
    return module.split(".")[1]


@cache
def tree_of(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text())


@cache
def imports_of(module: str) -> frozenset[str]:
    """Every module that is imported anywhere in the module, by a statement or by its name in a call of import_module."""
    found = set()
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relative to itself"
            members = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {member if member in MODULES else node.module for member in members}
        elif isinstance(node, ast.Call) and getattr(node.func, "id", None) == "import_module" and isinstance(node.args[0], ast.Constant):
            found.add(node.args[0].value)
    return frozenset(found)


def of_pipeline(module: str) -> set[str]:
    return {name for name in imports_of(module) if name.split(".")[0] == "pipeline"} - {"pipeline"}


def needed_by(module: str, harmless: set[str]) -> set[str]:
    """The modules that ``module`` runs on, itself and the packages they lie in included, without the harmless ones and theirs."""
    needed, waiting = set(), [module]
    while waiting:
        current = waiting.pop()
        if current in needed or current in harmless:
            continue
        needed.add(current)
        packages = {".".join(current.split(".")[:depth]) for depth in range(2, current.count(".") + 1)}
        waiting += [*of_pipeline(current), *(packages & set(MODULES))]
    return needed | {"pipeline.__init__"}


def stages() -> Iterator[tuple[str, str, dict]]:
    """dvc.yaml file, name and definition of every stage."""
    for file in (ROOT / "dvc.yaml", *sorted((ROOT / "data" / "raw").glob("*/dvc.yaml"))):
        for name, stage in OmegaConf.to_container(OmegaConf.load(file))["stages"].items():
            yield str(file.relative_to(ROOT)), name, stage


STAGES = {f"{file}:{name}": stage for file, name, stage in stages()}


def plain(entries: list) -> list[str]:
    """Paths of deps, outs or metrics, with any model for the item of a matrix and the chosen dataset in its place."""
    dataset = OmegaConf.load(ROOT / "params.yaml").dataset
    paths = [next(iter(entry)) if isinstance(entry, dict) else entry for entry in entries]
    return [path.replace("${item.model}", "*").replace("${dataset}", dataset) for path in paths]


def module_of(stage: dict) -> str:
    return re.sub(r"python -m pipeline (\w+).*", r"pipeline.stages.\1", stage["cmd"])


def covers(path: str, other: str) -> bool:
    """Whether ``path``, in which * stands for any one name, is ``other`` or a folder it lies in."""
    return re.match(re.escape(path).replace(r"\*", r"[^/]+") + "(/|$)", other) is not None


@pytest.mark.parametrize("module", MODULES)
def test_imports_run_one_way(module):
    room = room_of(module)
    for name in of_pipeline(module):
        assert name in MODULES, f"{module} imports {name}, which does not exist"
        target = room_of(name)
        if room == "stages":
            assert target != "stages"
            assert target != "twin" or module == "pipeline.stages.record"
        else:
            assert target == room or target in MAY_IMPORT[room], f"{module} imports {name}"


def test_the_configuration_knows_of_the_laboratory_only_the_types_of_its_options():
    assert {name for name in of_pipeline("pipeline.config") if room_of(name) == "twin"} == {"pipeline.twin.options"}
    # and those not when it is imported, for a recorded dataset has none
    at_the_top = [node for node in tree_of("pipeline.config").body if isinstance(node, ast.Import | ast.ImportFrom)]
    assert not any("twin" in ast.unparse(node) for node in at_the_top)


def test_every_room_is_in_the_plan():
    assert {room_of(module) for module in MODULES} == {*MAY_IMPORT, "stages"}


@pytest.mark.parametrize("library", DOORS)
def test_a_library_enters_through_its_door(library):
    users = {module for module in MODULES if any(name.split(".")[0] == library for name in imports_of(module))}
    assert users
    for module in users:
        assert any(covers(door.replace(".", "/"), module.replace(".", "/")) for door in DOORS[library]), f"{module} imports {library}"


def test_every_module_is_used_by_a_stage():
    used = set().union(*(needed_by(module, set()) for module in MODULES if room_of(module) in ("stages", "commands", "__main__")))
    assert set(MODULES) - used <= {"pipeline.__init__"}


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_depends_on_the_code_that_it_runs(stage):
    module = module_of(STAGES[stage])
    assert module in MODULES
    # what the configuration is made of is what these two read
    configuring = module in ("pipeline.stages.choose", "pipeline.stages.configure")
    harmless = HARMLESS - CONFIGURING if configuring else HARMLESS
    files = [MODULES[name] for name in needed_by(module, harmless)]
    needed = {str(file.relative_to(ROOT)) for file in files if file.stat().st_size}
    code = [path for path in plain(STAGES[stage]["deps"]) if covers("pipeline", path)]
    assert sorted(file for file in needed if not any(covers(path, file) for path in code)) == []
    # and on no other; options and what is said of them are read as texts
    texts = ("pipeline/conf", "pipeline/conf/dataset", "pipeline/twin/options.py")
    assert [path for path in code if path not in texts and not any(covers(path, file) for file in needed)] == []


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_depends_on_the_robots_description_where_it_loads_a_robot(stage):
    if "pipeline.arm.model" in needed_by(module_of(STAGES[stage]), HARMLESS):
        assert "pipeline/arm" in STAGES[stage]["deps"]
        assert any("dataset.robot" in keys for entry in STAGES[stage]["params"] for keys in entry.values())


@pytest.mark.parametrize("stage", STAGES)
def test_what_a_stage_depends_on_exists_or_is_written_by_another(stage):
    written = [path for other in STAGES.values() for path in plain([*other.get("outs", []), *other.get("metrics", [])])]
    for path in plain(STAGES[stage]["deps"]):
        if path.startswith("${"):  # a folder that a dataset's option names, outside the project
            continue
        made = any(covers(path, out) or covers(out, path) for out in written)
        assert made or (ROOT / path).exists(), f"{stage} depends on {path}"


@pytest.mark.parametrize(("stage", "later"), [("page", {"page"}), ("crate", {"crate", "page"})])
def test_a_stage_follows_every_stage_whose_hashes_it_states(stage, later):
    read = plain(STAGES[f"dvc.yaml:{stage}"]["deps"])
    others = [of for name, of in STAGES.items() if name.startswith("dvc.yaml:") and name.partition(":")[2] not in later]
    written = [path for stage in others for path in plain([*stage["outs"], *stage.get("metrics", [])])]
    assert [path for path in written if not any(covers(dep, path) for dep in read)] == ["data/config.yaml"]


@pytest.mark.parametrize("stage", STAGES)
def test_the_folders_that_a_stage_names_are_its_deps_and_outs(stage):
    declared = plain([entry for kind in ("deps", "outs", "metrics") for entry in STAGES[stage].get(kind, [])])
    named = set()
    inside_texts = set()
    for node in ast.walk(tree_of(module_of(STAGES[stage]))):
        if isinstance(node, ast.JoinedStr):
            named.add("".join(part.value if isinstance(part, ast.Constant) else "*" for part in node.values))
            inside_texts |= {id(part) for part in node.values}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside_texts:
            named.add(node.value)
    for path in named:
        if re.fullmatch(r"(data|reports)/[\w*./]+", path) and not path.endswith("dvc.yaml"):
            assert any(covers(path, other) or covers(other, path) for other in declared), f"{stage} opens {path}"


@pytest.mark.parametrize("module", MODULES)
def test_a_module_is_short_enough_to_be_read(module):
    assert len(MODULES[module].read_text().splitlines()) <= 300


@pytest.mark.parametrize("module", MODULES)
def test_only_stages_and_the_progress_of_trials_print(module):
    if room_of(module) not in ("stages", "commands", "compute", "__main__"):
        assert not [node for node in ast.walk(tree_of(module)) if isinstance(node, ast.Call) and getattr(node.func, "id", None) == "print"]


@pytest.mark.parametrize("module", MODULES)
def test_nothing_is_random_or_dated_but_by_its_arguments(module):
    roots = {name.split(".")[0] for name in imports_of(module)}
    # how long trials take decides where they run, and nothing else; what a condition of a survey costs is measured
    timed = {"time"} if module in ("pipeline.compute.block", "pipeline.survey.points") else set()
    assert not roots & ({"random", "secrets", "uuid", "time", "datetime"} - timed)
    attributes = [node for node in ast.walk(tree_of(module)) if isinstance(node, ast.Attribute)]
    drawn = {node.attr for node in attributes if ast.unparse(node.value) in ("np.random", "numpy.random")}
    assert drawn <= ({"Generator", "PCG64", "SeedSequence"} if module == "pipeline.rng" else {"Generator"})
