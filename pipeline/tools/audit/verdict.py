"""Whether a run of what is committed gives what is committed: the lock files, and every output of
every stage.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.tools.audit.contents import compare
from pipeline.tools.audit.difference import Difference
from pipeline.tools.audit.lock import changed_inputs, lock_files, read_locks

IDENTICAL, WITHIN, DIFFERENT = "identical", "within tolerance", "different"
# the contents that the hash belongs to are neither committed nor in a cache; what they matter shows
# in what is made of them, and the reports, which are committed, are made of all
HASH_ALONE = "only its hash is known"
# of a model that is no longer chosen, or another dataset's
NOT_RUN = "not run"


@dataclass(frozen=True)
class Output:
    """An output of a stage with its verdict, its hashes (None where there is none), and its
    differences, the farthest first.
    """

    stage: str
    path: str
    verdict: str
    committed: str | None
    rerun: str | None
    differences: Sequence[Difference]


@dataclass(frozen=True)
class Audit:
    """A rerun held against what is committed.

    ``locks`` says whether each lock file is the same to the byte; ``outdated`` names, of every
    stage that was locked on other inputs than the commit has, these inputs.
    """

    locks: Mapping[str, bool]
    outputs: Sequence[Output]
    outdated: Mapping[str, Sequence[str]]

    @property
    def verdict(self) -> str:
        """Of all outputs together."""
        verdicts = {output.verdict for output in self.outputs} - {NOT_RUN}
        return (
            DIFFERENT if DIFFERENT in verdicts else IDENTICAL if verdicts == {IDENTICAL} else WITHIN
        )


def judge(
    committed: Path, rerun: Path, ran: Sequence[str], fetch: Callable[[Sequence[str]], None]
) -> Audit:
    """The audit from two clones, of which in ``rerun`` the stages ``ran``; ``fetch`` puts outputs
    into ``committed`` that can be had.
    """
    before, now = read_locks(committed), read_locks(rerun)
    hashes = {}
    for name in before | now:
        old, new = (locks[name].outputs if name in locks else {} for locks in (before, now))
        hashes |= {(name, path): (old.get(path), new.get(path)) for path in {**old, **new}}
    fetch(
        [
            path
            for (name, path), (old, new) in hashes.items()
            if name in ran and old and new and old != new
        ]
    )
    outputs = [
        _judge(committed, rerun, name, path, *pair, name in ran)
        for (name, path), pair in hashes.items()
    ]
    written = {path for _, path in hashes}
    outdated = {
        name: changed_inputs(before[name], now[name], written)
        for name in ran
        if name in before and name in now
    }
    files = sorted({*lock_files(committed), *lock_files(rerun)})
    locks = {
        file: all((clone / file).is_file() for clone in (committed, rerun))
        and _equal(committed / file, rerun / file)
        for file in files
    }
    return Audit(locks, outputs, {name: inputs for name, inputs in outdated.items() if inputs})


def _judge(
    committed: Path, rerun: Path, stage: str, path: str, old: str | None, new: str | None, ran: bool
) -> Output:
    differences: list[Difference] = []
    if not ran:
        verdict = NOT_RUN
    elif old is None or new is None:
        verdict, differences = (
            DIFFERENT,
            [Difference("", False, "in the rerun alone" if old is None else "not in the rerun")],
        )
    elif old == new:
        verdict = IDENTICAL
    elif not (committed / path).exists():
        verdict = HASH_ALONE
    else:
        differences = sorted(
            compare(committed / path, rerun / path),
            key=lambda difference: (difference.within, -(difference.relative or 0.0)),
        )
        verdict = WITHIN if all(difference.within for difference in differences) else DIFFERENT
    return Output(stage, path, verdict, old, new, differences)


def _equal(file: Path, other: Path) -> bool:
    return file.read_bytes() == other.read_bytes()
