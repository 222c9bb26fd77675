"""A damaged recording is repaired and counted, refused with its place, or left unharmed."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import NamedTuple

import damage as d
import numpy as np
import pytest

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
        (name,) = d.some([name for name in files if fnmatchcase(name, self.pattern)], 1, rng)
        return {**files, name: self.change(files[name], severity, rng)}


TAKE, LOG, INDEX = "optitrack/*.csv", "force/*.csv", "kinect/*/depth.txt"
JOINTS, MATRIX, PNG = "joints/*/actual.csv", "kinect/intrinsics.yaml", "kinect/*.png"
CLOCK, PARTNERS = ("clock_offset", "clock_drift"), ("rows_without_partner", "repetitions")
ANY, FIXED, COUNTED, HEAD = (REPAIRED, REFUSED), (REFUSED,), (REPAIRED,), (REFUSED, UNHARMED)
SEEN = (REPAIRED, REFUSED, UNNOTICED)  # within three standard errors a change is not seen
offset = d.retimed(lambda t, share, s: t + s)
drift = d.retimed(lambda t, share, s: t * (1 + s))
jump = d.retimed(lambda t, share, s: t + s * (share > 0.5))
# any log of text: damage and severities
TEXT = {
    "truncated": (d.truncated, 1e-3, 0.9),
    "rows dropped": (d.dropped_rows, 1, 10),
    "rows doubled": (d.doubled_rows, 1, 10),
    "rows swapped": (d.swapped_rows, 1, 10),
}
# by instrument, pattern and name: damage, mild, grave, outcomes, and the counts of which a repair
# changes one
GRID = {
    ("take", TAKE): {
        "truncated": (*TEXT["truncated"], FIXED),
        "rows dropped": (*TEXT["rows dropped"], ANY, "skipped_frames"),
        "rows doubled": (*TEXT["rows doubled"], COUNTED, "repeated_rows"),
        "rows swapped": (*TEXT["rows swapped"], FIXED),
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
    ("depth", PNG): {
        "bits": (d.flipped_bits, 1, 10, FIXED),
        "truncated": (d.truncated, 1e-3, 0.9, FIXED),
    },
    ("depth", ""): {
        "missing": (d.all_lost, 1, 10, FIXED),
        "frozen": (d.all_frozen, 1, 10, ANY, "frozen_frames"),
        "pixels lost": (d.all_lost_pixels, 0.1, 0.95, ANY, "valid", "frames_without_fit"),
        "other unit": (d.all_other_unit, 0.2, 0.5, FIXED),
    },
    ("depth", INDEX): {
        "truncated": (*TEXT["truncated"], SEEN, "cut_rows"),
        "rows dropped": (*TEXT["rows dropped"], ANY, "dropped_frames"),
        "rows doubled": (*TEXT["rows doubled"], FIXED),
        "rows swapped": (*TEXT["rows swapped"], FIXED),
        "clock offset": (offset, 0.02, 5.0, SEEN, *CLOCK),
        "clock drift": (drift, 0.01, 0.1, SEEN, *CLOCK),
        "clock jump": (jump, 0.02, 5.0, SEEN, *CLOCK, "dropped_frames"),
    },
    ("depth", "trajectory.csv"): {name: (*row, FIXED) for name, row in TEXT.items()},
    ("depth", MATRIX): {
        "truncated": (d.truncated, 1e-3, 0.9, HEAD),
        "number of rows": (d.header_number(b"rows"), 2, 1e8, FIXED),
        "type": (d.header_word(b"dt: d", b"dt: u"), 1, 1, HEAD),
    },
    ("force", LOG): {  # the program writes neither times nor sample numbers
        # at least the 2 s of the tare and 0.4 s more are left
        "truncated": (d.truncated, 1e-3, 0.8, SEEN, "cut_rows"),
        "rows dropped": (*TEXT["rows dropped"], (UNNOTICED,)),
        "rows doubled": (*TEXT["rows doubled"], COUNTED, "repeated_rows"),
        "rows swapped": (*TEXT["rows swapped"], (UNHARMED, UNNOTICED)),
        "rate": (d.header_number(b"Frequency"), 2, 10, FIXED),
        "other unit": (d.header_word(b"(N)", b"(lbf)"), 1, 1, FIXED),
    },
    ("joints", JOINTS): {
        "truncated": (*TEXT["truncated"], (*HEAD, REPAIRED), "cut_rows", *PARTNERS),
        "rows dropped": (*TEXT["rows dropped"], FIXED),
        "rows doubled": (*TEXT["rows doubled"], COUNTED, "doubled_rows"),
        "rows swapped": (*TEXT["rows swapped"], FIXED),
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
        kind, found = bench.outcome(files, fault.counted)
        assert kind in fault.outcomes, (seed, kind, found)
        if kind == REFUSED:
            assert {"file", "take"} & set(found.evidence)
            # the path is evidence, so that messages are the same on every machine
            assert "\n" not in found.message and "/tmp" not in found.message


@pytest.mark.parametrize("instrument", ["take", "depth", "force", "joints"])
def test_a_file_cut_at_any_byte_never_gives_a_number_that_was_not_there(benches, instrument):
    bench, rng = benches[instrument], np.random.default_rng(1)
    for _ in range(25):
        name = rng.choice(sorted(bench.files))
        content = bench.files[name]
        cut = {**bench.files, name: content[: int(rng.integers(len(content)))]}
        kind, found = bench.outcome(cut)
        if kind != REFUSED and instrument in ("take", "joints"):
            # the rows that are left are unchanged
            rows = bench.clean.values[: len(found.values)]
            np.testing.assert_allclose(found.values, rows, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "severity", "times"),
    [
        (f"{TAKE}: labels swapped", 60, 1.05),
        (f"{TAKE}: links swapped", 60, 1.05),
        (f"{TAKE}: label lost", 60, 1.05),
        (f"{TAKE}: rows doubled", 10, 1.0001),
        (f"{TAKE}: frozen", 10, 6.0),
        (": frozen", 5, 1.5),
        (f"{INDEX}: rows dropped", 5, 1.5),
        (f"{INDEX}: clock offset", 0.1, 1.5),
    ],
)
def test_a_repaired_recording_has_the_error_of_a_clean_one(benches, motion, name, severity, times):
    fault = FAULTS[name]
    bench = benches[fault.instrument]

    def error(recovered) -> float:
        return np.sqrt(np.mean((recovered.values - motion(recovered.time)) ** 2))

    for seed in range(3):
        files = fault.inflict(bench.files, severity, seed)
        kind, found = bench.outcome(files, fault.counted)
        assert kind == REPAIRED and error(found) <= times * error(bench.clean)


def test_a_number_changed_in_silence_is_unnoticed_and_other_line_ends_are_unharmed(benches):
    bench, name = benches["take"], "optitrack/test_001.csv"
    row = bench.files[name].splitlines()[60]
    head, y, z = row.rsplit(b",", 2)  # the marker's z is normal to the plane of the arm
    other = b",".join([head, y[:-1] + (b"9" if y[-1:] < b"5" else b"1"), z])
    for old, new, kind in ((row, other, UNNOTICED), (b"\r\n", b"\n", UNHARMED)):
        files = {**bench.files, name: bench.files[name].replace(old, new)}
        assert bench.outcome(files, ("skipped_frames",))[0] == kind
