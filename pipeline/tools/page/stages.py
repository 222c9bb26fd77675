"""What the pipelines ran, from their lock files: each run of a stage with what it read and wrote,
and which stage follows which.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.core.typed_yaml import read_yaml

STAGES, STUDIES = Path("pipeline/stages"), Path("pipeline/studies")


@dataclass(frozen=True)
class StageRun:
    """One run of a stage: its name (fit, or fit@additive), its stage, what that does, its program,
    and the paths that it read and wrote, each with the MD5 that DVC holds of it (of a folder that
    of the list of its files).
    """

    name: str
    stage: str
    what: str
    program: str
    reads: Mapping[str, str]
    writes: Mapping[str, str]


@dataclass(frozen=True)
class Stage:
    """A stage: what it does, the paths it writes, * for the item of a matrix, and the stages that
    it follows directly.
    """

    name: str
    what: str
    writes: list[str]
    after: list[str]


def locked_runs(file: Path, models: Collection[str]) -> list[StageRun]:
    """The runs in a lock file of DVC, none where there is no file.

    Entries of stages that are gone and of models that are not among ``models`` stay in a lock file
    and are passed over.
    """
    entries = read_yaml(file).get("stages", {}) if file.is_file() else {}
    runs = [_run(name, entry, file) for name, entry in entries.items()]
    by_model = {run.stage for run in runs if run and run.name.partition("@")[2] in models}
    return [
        run
        for run in runs
        if run and (run.stage not in by_model or run.name.partition("@")[2] in models)
    ]


def _run(name: str, entry: Mapping, lock: Path) -> StageRun | None:
    """None for a stage whose program is gone; a study has its ``lock`` beside its program."""
    stage = name.partition("@")[0]
    named = re.match(r"python -m pipeline ([\w-]+)", str(entry["cmd"]))
    if named is None:
        return None
    study = lock.is_relative_to(STUDIES)
    program = lock.with_name("stage.py") if study else STAGES / f"{named[1]}.py"
    if not program.is_file():
        return None
    reads = {out["path"]: out.get("md5", "") for out in entry.get("deps", [])}
    reads |= dict.fromkeys(entry.get("params", {}), "")
    writes = {out["path"]: out.get("md5", "") for out in entry.get("outs", [])}
    return StageRun(name, stage, purpose(program), program.as_posix(), reads, writes)


def purpose(program: Path) -> str:
    """What a program's docstring says that it does, after its name."""
    text = ast.get_docstring(ast.parse(program.read_text(encoding="utf-8"))) or ""
    first = " ".join(text.partition("\n\n")[0].split())
    return first.partition(": ")[2] or first


def stages_in_order(runs: Sequence[StageRun]) -> list[Stage]:
    """The stages of ``runs``, none before one that it reads from, else by their names."""
    names = sorted({run.stage for run in runs})
    before = {name: _before(name, runs) for name in names}
    stages: list[Stage] = []
    waiting = names
    while waiting:
        done = {stage.name for stage in stages}
        # where stages read from each other, which DVC refuses, the first by name goes first
        name = next((name for name in waiting if before[name] <= done), waiting[0])
        own = [run for run in runs if run.stage == name]
        after = _direct(name, before)
        stages.append(Stage(name, own[0].what, _patterns(own), after))
        waiting = [other for other in waiting if other != name]
    return stages


def _before(name: str, runs: Sequence[StageRun]) -> set[str]:
    """The stages that wrote what stage ``name`` read."""
    reads = {path for run in runs if run.stage == name for path in run.reads}
    return {
        run.stage
        for run in runs
        if run.stage != name
        and any(touch(read, written) for read in reads for written in run.writes)
    }


def touch(read: str, written: str) -> bool:
    """Whether one path is the other or a folder that it lies in."""
    return f"{read}/".startswith(f"{written}/") or f"{written}/".startswith(f"{read}/")


def _patterns(runs: Sequence[StageRun]) -> list[str]:
    items = [(run.name.partition("@")[2], run) for run in runs]
    paths = [
        path.replace(item, "*") if item else path for item, run in items for path in run.writes
    ]
    return list(dict.fromkeys(paths))


def _direct(name: str, before: Mapping[str, set[str]]) -> list[str]:
    """Of the stages before ``name`` those that no other of them follows, by name."""
    earlier = set()
    for other in before[name]:
        earlier |= _all_before(other, before)
    return sorted(before[name] - earlier)


def _all_before(name: str, before: Mapping[str, set[str]]) -> set[str]:
    reached, waiting = set(), [name]
    while waiting:
        new = before[waiting.pop()] - reached
        reached |= new
        waiting += new
    return reached
