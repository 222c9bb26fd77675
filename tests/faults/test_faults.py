"""A damaged recording is repaired and counted, refused with its place, or left unharmed."""

from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import recording_damage as damage
from case_tables import cases_beside

from pipeline.core.typed_yaml import read_yaml

REPAIRED = "repaired"
REFUSED = "refused"
UNHARMED = "unharmed"
UNNOTICED = "unnoticed"
SEEDS = 4  # of each fault, from mild to grave


class Fault(NamedTuple):
    """Damage ``change`` of one file of ``pattern`` (of all files if it is empty), graded by
    severity from ``mild`` to ``grave``, its right outcomes, and the counts of which a repair
    changes one.
    """

    instrument: str
    pattern: str
    change: object
    mild: float
    grave: float
    outcomes: list[str]
    counted: list[str]

    def inflict(self, files, severity: float, seed: int) -> dict[str, bytes]:
        """The files with the damage."""
        rng = np.random.default_rng(seed)
        if not self.pattern:
            return self.change(files, severity, rng)
        names = [name for name in files if fnmatchcase(name, self.pattern)]
        (name,) = damage.some(names, 1, rng)
        return {**files, name: self.change(files[name], severity, rng)}

    def severities(self) -> list[float]:
        """Severities from mild to grave, whole numbers if these are."""
        severities = np.geomspace(self.mild, self.grave, SEEDS)
        if isinstance(self.mild, int):
            severities = severities.round().astype(int)
        return severities.tolist()


def read_faults() -> dict[str, Fault]:
    """The faults of the file beside this module, by pattern and name."""
    faults = {}
    for group in read_yaml(Path(__file__).with_suffix(".yaml"))["faults"]:
        instrument = group["instrument"]
        pattern = group["pattern"]
        for name, ((function, *arguments), *row) in group["damage"].items():
            change = getattr(damage, function)
            if arguments:
                change = change(*(text.encode() for text in arguments))
            faults[f"{pattern}: {name}"] = Fault(instrument, pattern, change, *row)
    return faults


cases = cases_beside(__file__)
FAULTS = read_faults()


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_repaired_and_counted_or_refused_with_its_place(benches, name):
    fault = FAULTS[name]
    bench = benches[fault.instrument]
    for seed, severity in enumerate(fault.severities()):
        files = fault.inflict(bench.files, severity, seed)
        assert files != bench.files

        kind, outcome = bench.outcome(files, fault.counted)

        assert kind in fault.outcomes, (seed, kind, outcome)
        if kind == REFUSED:
            assert {"file", "take"} & set(outcome.evidence)
            # the path is evidence, so that messages are the same on every machine
            assert "\n" not in outcome.message and "/tmp" not in outcome.message


@cases("repaired")
def test_a_repaired_recording_has_the_error_of_a_clean_one(
    benches,
    motion,
    name,
    severity,
    times,
):
    fault = FAULTS[name]
    bench = benches[fault.instrument]

    def error(recovered) -> float:
        return np.sqrt(np.mean((recovered.q - motion(recovered.time)) ** 2))

    for seed in range(3):
        files = fault.inflict(bench.files, severity, seed)
        kind, recovered = bench.outcome(files, fault.counted)
        assert kind == REPAIRED
        assert error(recovered) <= times * error(bench.clean)


def test_a_number_changed_in_silence_is_unnoticed_and_other_line_ends_are_unharmed(
    benches,
):
    bench = benches["take"]
    name = "optitrack/test_001.csv"
    row = bench.files[name].splitlines()[60]
    head, y, z = row.rsplit(b",", 2)  # the marker's z is normal to the plane of the arm
    digit = b"9" if y[-1:] < b"5" else b"1"
    changed = b",".join([head, y[:-1] + digit, z])

    for old, new, kind in ((row, changed, UNNOTICED), (b"\r\n", b"\n", UNHARMED)):
        files = {**bench.files, name: bench.files[name].replace(old, new)}
        assert bench.outcome(files, ("skipped_frames",))[0] == kind
