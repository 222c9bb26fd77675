"""The page's stage depends on the code that it runs and on what it reads, and runs last."""

from __future__ import annotations

import re

from omegaconf import OmegaConf
from source_code import MODULES, ROOT, covers, needed, room

from pipeline.recordings import steps
from pipeline.tools.page import card, command, take

STAGE = OmegaConf.to_container(OmegaConf.load(ROOT / "pipeline/tools/page/dvc.yaml"))["stages"][
    "page"
]
CORE = {module for module in MODULES if room(module) == "core"}
# read as texts: what stages and studies say that they do, and the laboratory's options
TEXTS = {"pipeline/stages", "pipeline/studies", "pipeline/laboratory/options"}


def outs(file: str) -> list[str]:
    """What the stages of a dvc.yaml write, * for an item."""
    stages = OmegaConf.to_container(OmegaConf.load(ROOT / file))["stages"].values()
    entries = [out for s in stages for key in ("outs", "metrics") for out in s.get(key, [])]
    paths = [next(iter(out)) if isinstance(out, dict) else out for out in entries]
    return [re.sub(r"\$\{item\.\w+\}", "*", path) for path in paths]


def test_its_code_is_among_its_dependencies_and_none_is_named_in_vain():
    modules = needed("pipeline.tools.page.command", CORE)
    files = {str(MODULES[m].relative_to(ROOT)) for m in modules if MODULES[m].stat().st_size}
    code = [path for path in STAGE["deps"] if covers("pipeline", path)]
    files -= {"pipeline/__init__.py"}  # of which no stage's numbers but those of all would change
    assert sorted(f for f in files if not any(covers(path, f) for path in code)) == []
    templates = {"pipeline/tools/page/templates", "pipeline/core"}
    idle = [p for p in code if not any(covers(p, f) for f in files)]
    assert set(idle) <= templates | TEXTS
    assert all((ROOT / path).exists() for path in code)


def test_no_dependency_holds_its_own_lock_file():
    own = "pipeline/tools/page/dvc.lock"
    assert not [path for path in STAGE["deps"] if covers(path, own)]


def test_the_files_that_it_reads_are_among_its_dependencies():
    read = [
        command.LOCK,
        command.DATASETS,
        command.FIGURES,
        command.TABLES,
        command.STUDY_PAGES,
        command.CLAIMS,
        command.ERRATA,
        command.CITATION,
        command.REQUIREMENTS,
        command.COSTS,
        take.TRACK,
        take.ARTICULATE,
        take.FILTER,
        take.FIT,
        steps.MOTION,
        card.OPTIONS,
    ]
    missing = [
        str(f) for f in read if not any(covers(path, f.as_posix()) for path in STAGE["deps"])
    ]
    assert missing == []


def test_every_report_that_another_stage_writes_comes_before_it():
    reports = [path for path in outs("dvc.yaml") if path.startswith("reports/")]
    assert reports
    late = [path for path in reports if not any(covers(dep, path) for dep in STAGE["deps"])]
    assert late == []
