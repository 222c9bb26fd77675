"""What the pipeline makes of recordings, clean or faulty: the values it recovers, what it counted
on the way, or its refusal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.studies.faults.fault import REFUSED, REPAIRED, UNHARMED, UNNOTICED, Fault, Files

# rad or N: above what another order of summation leaves, below what any instrument resolves
SAME = 1e-9


@dataclass(frozen=True)
class Recovered:
    """``values`` (N, d) at ``time`` (N,) in s: joint angles in rad, or moments of force in N;
    ``counts`` as in the table ``quality``.
    """

    time: np.ndarray
    values: np.ndarray
    counts: dict[str, float]


@dataclass(frozen=True)
class Outcome:
    """What became of a fault: one of :data:`pipeline.studies.faults.fault.OUTCOMES`, what was
    recovered, and what was said or counted of it.
    """

    kind: str
    recovered: Recovered | None
    said: str
    evidence: dict[str, object]


@dataclass(frozen=True, repr=False)
class Bench:
    """A valid recording: its ``files``, how values are recovered from their folder, those ``clean``
    values, and the truth they stand for.

    ``truth`` (K, d) at ``time`` (K,) in s.
    """

    files: Files
    recover: Callable[[Path], Recovered]
    clean: Recovered
    time: np.ndarray
    truth: np.ndarray

    def error(self, recovered: Recovered) -> float:
        """Root mean square, over samples and columns, of recovered values minus the truth, which is
        linear between its samples.
        """
        expected = np.stack(
            [np.interp(recovered.time, self.time, column) for column in self.truth.T], axis=-1
        )
        return float(np.sqrt(np.mean((recovered.values - expected) ** 2)))


def recovered_from(files: Files, recover: Callable[[Path], Recovered]) -> Recovered:
    """What is recovered from ``files``, written into a folder of their own."""
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            file = Path(folder) / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        return recover(Path(folder))


def suffer(bench: Bench, fault: Fault, severity: float, rng: np.random.Generator) -> Outcome:
    """What becomes of the recording with ``fault`` in it. Any exception but a refusal of the
    pipeline's own passes through.
    """
    faulty = fault.inflict(bench.files, severity, rng)
    try:
        recovered = recovered_from(faulty, bench.recover)
    except PipelineError as error:
        return Outcome(REFUSED, None, error.message, error.evidence)
    clean = bench.clean
    counted = {
        name: recovered.counts.get(name, 0.0)
        for name in fault.counted
        if _differs(name, recovered.counts, clean.counts)
    }
    said = ", ".join(f"{name.replace('_', ' ')} {value:.6g}" for name, value in counted.items())
    same = recovered.values.shape == clean.values.shape and np.allclose(
        recovered.values, clean.values, rtol=0, atol=SAME
    )
    kind = REPAIRED if counted else UNHARMED if same else UNNOTICED
    return Outcome(kind, recovered, said, {})


def _differs(name: str, counts: dict[str, float], clean: dict[str, float]) -> bool:
    """Whether a count is another, or an estimate is off the clean one by more than three of its
    standard errors.
    """
    margin = 3 * clean.get(f"{name}_standard_error", 0.0)
    return abs(counts.get(name, 0.0) - clean.get(name, 0.0)) > margin
