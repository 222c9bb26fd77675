"""Mutants of a sample, read one by one in a process that they may end: what became of each."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from mutants import mutants
from mutated_samples import SAMPLES, values, write_samples

from pipeline.core.bounds import Reading, Sandbox, within
from pipeline.core.errors import PipelineError

COUNT = 420  # mutants of a sample
BOUNDS = Reading(seconds=10, memory_mib=1024)
# how the sandbox says what ended badly
FAILURES = ("its reader fails", "ends the process", "not read within", "of memory")
TABLE = Path(__file__).parent / "formats" / "accepted_mutants.csv"
COLUMNS = ["format", "change", "mutants", "refused", "counted", "accepted", "effect"]


@dataclass
class Campaign:
    """Ends of the mutants of each kind of change, the effects of those accepted, and failures."""

    outcomes: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    effects: dict[str, dict[str, float | str]] = field(default_factory=lambda: defaultdict(dict))
    failures: list[str] = field(default_factory=list)

    def table(self, name: str) -> pd.DataFrame:
        """A row of the table of each change that was accepted, in silence, of any mutant."""
        rows = []
        for kind, ends in self.outcomes.items():
            if not ends["accepted"]:
                continue
            effect = "; ".join(f"{key}: {self.effects[kind][key]}" for key in self.effects[kind])
            rows.append((name, kind, ends.total(), ends["refused"], ends["counted"]))
            rows[-1] += (ends["accepted"], effect)
        return pd.DataFrame(rows, columns=COLUMNS)


def run(name: str, folder: Path, count: int = COUNT) -> Campaign:
    """Read ``count`` mutants of the sample in the ``folder`` that holds them all."""
    return within(BOUNDS, _run, name, folder, count)


def _run(name: str, folder: Path, count: int) -> Campaign:
    sample, campaign = SAMPLES[name], Campaign()
    sound = folder / sample.place
    content, before = sound.read_bytes(), values(sample.read(sound))
    with tempfile.TemporaryDirectory() as scratch, Sandbox() as sandbox:
        copy = Path(scratch) / sample.place
        copy.parent.mkdir(parents=True, exist_ok=True)
        if sound.parent != folder:
            shutil.copytree(sound.parent, copy.parent, dirs_exist_ok=True)
        for kind, mutant in mutants(content, count, text=sample.text):
            copy.write_bytes(mutant)
            end, effects = _outcome(sandbox, sample.read, copy, before)
            campaign.outcomes[kind][end] += 1
            _keep_greatest(campaign.effects[kind], effects)
            if end == "failed":
                campaign.failures.append(f"{kind}: {effects['reason']}")
    return campaign


def _outcome(
    sandbox: Sandbox, read: Callable, file: Path, before: dict
) -> tuple[str, dict[str, float | str]]:
    """How reading the mutant ends: refused, same, counted (other values and counts), accepted
    (other values in silence) or failed.
    """
    try:
        after = sandbox.call(_values, read, file)
    except PipelineError as error:
        # a library may end, or not return, in a process of the reader's own, which names the file
        failed = any(words in error.message for words in FAILURES) and "file" not in error.evidence
        return ("failed" if failed else "refused"), {"reason": error.message} if failed else {}
    keys = before.keys() | after.keys()
    changed = {key for key in keys if _differ(before.get(key), after.get(key))}
    if not changed:
        return "same", {}
    if any("counts" in key for key in changed):
        return "counted", {}
    effects: dict[str, float | str] = {}
    for key in sorted(changed):
        effect = _effect(before.get(key), after.get(key))
        _keep_greatest(effects, {key.partition("/")[0]: effect})
    return "accepted", effects


def _values(read: Callable, file: Path) -> dict:
    return values(read(file))


def _differ(before: np.ndarray | str | None, after: np.ndarray | str | None) -> bool:
    if not (isinstance(before, np.ndarray) and isinstance(after, np.ndarray)):
        return type(before) is not type(after) or before != after
    return not np.array_equal(before, after, equal_nan=before.dtype.kind == "f")


def _effect(before: object, after: object) -> float | str:
    """How far a value is off in the greatest that it was, to the power of ten; else a word."""
    if before is None or after is None:
        return "other names"
    if isinstance(before, str) or isinstance(after, str):
        return "another word"
    if before.shape != after.shape:
        return "another size"
    if before.dtype.kind == "O" or (np.isnan(before) != np.isnan(after)).any():
        return "other gaps"
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.nanmax(np.abs(after.astype(float) - before.astype(float)), initial=0.0)
        size = np.nanmax(np.abs(before.astype(float)), initial=0.0)
    return 10.0 ** np.ceil(np.log10(off / (size or 1.0)))


def _keep_greatest(kept: dict[str, float | str], more: dict[str, float | str]) -> None:
    for key, effect in more.items():
        there = kept.get(key, 0.0)
        if isinstance(there, str) or isinstance(effect, str):
            words = {word for word in (there, effect) if isinstance(word, str)}
            kept[key] = " or ".join(sorted({w for word in words for w in word.split(" or ")}))
        else:
            kept[key] = max(there, effect)


if __name__ == "__main__":  # writes the table anew: PYTHONPATH=. python tests/mutant_campaign.py
    with tempfile.TemporaryDirectory() as place:
        write_samples(Path(place))
        names = sys.argv[1:] or list(SAMPLES)
        tables = []
        for name in names:
            run_of_mutants = run(name, Path(place))
            tables.append(run_of_mutants.table(name))
            ends = dict(sum(run_of_mutants.outcomes.values(), Counter()))
            print(name, ends, *run_of_mutants.failures[:5], sep="\n    ", flush=True)
    if not sys.argv[1:]:
        pd.concat(tables).to_csv(TABLE, index=False, lineterminator="\n")
