"""A damaged recording is repaired and counted, refused with its place, or left unharmed."""

from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
import pytest
import recording_damage as d

REPAIRED, REFUSED, UNHARMED, UNNOTICED = "repaired", "refused", "unharmed", "unnoticed"
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
    outcomes: tuple[str, ...]
    counted: tuple[str, ...] = ()

    def inflict(self, files, severity: float, seed: int) -> dict[str, bytes]:
        """The files with the damage."""
        rng = np.random.default_rng(seed)
        if not self.pattern:
            return self.change(files, severity, rng)
        (name,) = d.some(
            [name for name in files if fnmatchcase(name, self.pattern)],
            1,
            rng,
        )
        return {**files, name: self.change(files[name], severity, rng)}


TAKE, INDEX = "optitrack/*.csv", "kinect/*/depth.txt"
CLOCK = ("clock_offset", "clock_drift")
ANY, FIXED, COUNTED = (REPAIRED, REFUSED), (REFUSED,), (REPAIRED,)
# within three standard errors a change is not seen
SEEN = (
    REPAIRED,
    REFUSED,
    UNNOTICED,
)
offset = d.retimed(lambda t, share, s: t + s)
drift = d.retimed(lambda t, share, s: t * (1 + s))
jump = d.retimed(lambda t, share, s: t + s * (share > 0.5))
# by instrument, pattern and name: damage, mild, grave, outcomes, and the counts of which a repair
# changes one; formats/test_damage.py has the rows that are lost, doubled or cut
GRID = {
    ("take", TAKE): {
        "frame count": (
            d.header_number(b"Total Exported Frames"), 0.5, 1e3, COUNTED, "announced_frames"),
        "rate": (d.header_number(b"Export Frame Rate"), 1.2, 2.4, FIXED),
        "no unit": (d.header_word(b"Meters", b""), 1, 1, FIXED),
        "other unit": (d.header_word(b"Meters", b"Millimeters"), 1, 1, FIXED),
        "other lengths": (d.other_lengths, 39.37, 1000.0, FIXED),
        "link hidden": (d.hidden_link, 5, 60, ANY, "interpolated", "missing"),
        "samples hidden": (d.hidden_samples, 0.01, 0.3, COUNTED, "missing"),
        "labels swapped": (d.swapped_labels, 5, 60, COUNTED, "relabelled"),
        "links swapped": (d.swapped_links, 5, 60, COUNTED, "relabelled"),
        "label lost": (d.lost_label, 5, 60, COUNTED, "adopted"),
        "frozen": (d.frozen_tracker, 5, 60, ANY, "frozen_frames"),
    },
    ("depth", ""): {
        "missing": (d.all_lost, 1, 10, FIXED),
        "frozen": (d.all_frozen, 1, 10, ANY, "frozen_frames"),
        "pixels lost": (d.all_lost_pixels, 0.1, 0.95, ANY, "valid", "frames_without_fit"),
        "other unit": (d.all_other_unit, 0.2, 0.5, FIXED),
    },
    ("depth", INDEX): {
        "clock offset": (offset, 0.02, 5.0, SEEN, *CLOCK),
        "clock drift": (drift, 0.01, 0.1, SEEN, *CLOCK),
        "clock jump": (jump, 0.02, 5.0, SEEN, *CLOCK, "dropped_frames"),
    },
}  # fmt: skip
FAULTS = {
    f"{pattern}: {name}": Fault(instrument, pattern, *row[:4], row[4:])
    for (instrument, pattern), rows in GRID.items()
    for name, row in rows.items()
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_repaired_and_counted_or_refused_with_its_place(benches, name):
    fault = FAULTS[name]
    bench = benches[fault.instrument]
    for seed, severity in enumerate(np.geomspace(fault.mild, fault.grave, SEEDS)):
        whole = float(fault.mild).is_integer() and float(fault.grave).is_integer()
        files = fault.inflict(bench.files, round(severity) if whole else severity, seed)
        assert files != bench.files
        kind, outcome = bench.outcome(files, fault.counted)
        assert kind in fault.outcomes, (seed, kind, outcome)
        if kind == REFUSED:
            assert {"file", "take"} & set(outcome.evidence)
            # the path is evidence, so that messages are the same on every machine
            assert "\n" not in outcome.message and "/tmp" not in outcome.message


@pytest.mark.parametrize(
    ("name", "severity", "times"),
    [
        (f"{TAKE}: labels swapped", 60, 1.05),
        (f"{TAKE}: links swapped", 60, 1.05),
        (f"{TAKE}: label lost", 60, 1.05),
        (f"{TAKE}: frozen", 10, 6.0),
        (": frozen", 5, 1.5),
        (f"{INDEX}: clock offset", 0.1, 1.5),
    ],
)
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
    bench, name = benches["take"], "optitrack/test_001.csv"
    row = bench.files[name].splitlines()[60]
    head, y, z = row.rsplit(b",", 2)  # the marker's z is normal to the plane of the arm
    digit = b"9" if y[-1:] < b"5" else b"1"
    changed = b",".join([head, y[:-1] + digit, z])
    for old, new, kind in ((row, changed, UNNOTICED), (b"\r\n", b"\n", UNHARMED)):
        files = {**bench.files, name: bench.files[name].replace(old, new)}
        assert bench.outcome(files, ("skipped_frames",))[0] == kind
