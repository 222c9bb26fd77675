"""A damaged recording is repaired and counted, refused with its place, or left unharmed."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import damage
import numpy as np
import pytest
from damage import Files, chosen, header_number, header_word, retimed
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recovery_bench import Bench, Recovered, outcome

from pipeline.core.errors import PipelineError

REPAIRED, REFUSED, UNHARMED, UNNOTICED = "repaired", "refused", "unharmed", "unnoticed"
SECONDS, MEGABYTES = 5.0, 600  # for a recording of a few hundred kilobytes
SETTINGS = settings(
    max_examples=4,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


class Fault(NamedTuple):
    """Damage ``change`` of a file of ``pattern`` (of all files if it is empty), graded by severity
    from ``mild`` to ``grave``, its right outcomes, and the counts of which a repair changes one.
    """

    instrument: str
    pattern: str
    change: object
    mild: float
    grave: float
    outcomes: tuple[str, ...]
    counted: tuple[str, ...] = ()

    def inflict(self, files: Files, severity: float, rng: np.random.Generator) -> Files:
        """The files with the damage."""
        if not self.pattern:
            return self.change(files, severity, rng)
        (name,) = chosen(files, self.pattern, 1, rng)
        return {**files, name: self.change(files[name], severity, rng)}

    def between(self, share: float) -> float:
        """Severity at a share of the way from mild to grave; whole where both are."""
        severity = self.mild * (self.grave / self.mild) ** share
        whole = float(self.mild).is_integer() and float(self.grave).is_integer()
        return float(round(severity)) if whole else severity


TEXT = {  # of any log: severities
    "truncated": (1e-3, 0.9),
    "dropped_rows": (1, 10),
    "doubled_rows": (1, 10),
    "swapped_rows": (1, 10),
}
REFUSALS = {name: ((REFUSED,), ()) for name in TEXT}
# of each log: what differs from a refusal
LOGS = {
    ("take", "optitrack/*.csv"): {
        "dropped_rows": ((REPAIRED, REFUSED), ("skipped_frames",)),
        "doubled_rows": ((REPAIRED,), ("repeated_rows",)),
    },
    ("depth", "kinect/*/depth.txt"): {
        "truncated": ((REPAIRED, REFUSED, UNNOTICED), ("cut_rows",)),
        "dropped_rows": ((REPAIRED, REFUSED), ("dropped_frames",)),
    },
    ("depth", "trajectory.csv"): {},
    ("force", "force/*.csv"): {  # the program writes neither times nor sample numbers
        "truncated": ((REPAIRED, REFUSED, UNNOTICED), ("cut_rows",)),
        "dropped_rows": ((UNNOTICED,), ()),
        "doubled_rows": ((REPAIRED,), ("repeated_rows",)),
        "swapped_rows": ((UNHARMED, UNNOTICED), ()),
    },
    ("joints", "joints/*/actual.csv"): {
        "truncated": (
            (REPAIRED, REFUSED, UNHARMED),
            ("cut_rows", "rows_without_partner", "repetitions"),
        ),
        "doubled_rows": ((REPAIRED,), ("doubled_rows",)),
    },
}
FAULTS = {
    f"{pattern}: {name}": Fault(instrument, pattern, getattr(damage, name), *TEXT[name], *due)
    for (instrument, pattern), owed in LOGS.items()
    for name, due in (REFUSALS | owed).items()
}
TAKE, LOG, INDEX = "optitrack/*.csv", "force/*.csv", "kinect/*/depth.txt"
MATRIX, PNG, CLOCK = "kinect/intrinsics.yaml", "kinect/*.png", ("clock_offset", "clock_drift")
ANY, FIXED, COUNTED, HEAD = (REPAIRED, REFUSED), (REFUSED,), (REPAIRED,), (REFUSED, UNHARMED)
SEEN = (REPAIRED, REFUSED, UNNOTICED)  # within three standard errors a change is not seen
d, number, word = damage, header_number, header_word
offset = retimed(lambda t, share, s: t + s)
drift = retimed(lambda t, share, s: t * (1 + s))
jump = retimed(lambda t, share, s: t + s * (share > 0.5))
# by pattern and name: damage, mild, grave, outcomes, and the counts of which a repair changes one
GRID = {
    ("take", TAKE): {
        "header bytes": (d.foreign_bytes, 1, 10, HEAD),
        "frame count": (number(b"Total Exported Frames"), 0.5, 1e3, COUNTED, "announced_frames"),
        "rate": (number(b"Export Frame Rate"), 1.2, 2.4, FIXED),
        "no unit": (word(b"Meters", b""), 1, 1, FIXED),
        "other unit": (word(b"Meters", b"Millimeters"), 1, 1, FIXED),
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
        "clock offset": (offset, 0.02, 5.0, SEEN, *CLOCK),
        "clock drift": (drift, 0.01, 0.1, SEEN, *CLOCK),
        "clock jump": (jump, 0.02, 5.0, SEEN, *CLOCK, "dropped_frames"),
    },
    ("depth", MATRIX): {
        "calibration truncated": (d.truncated, 1e-3, 0.9, HEAD),
        "calibration rows": (number(b"rows"), 2, 1e8, FIXED),
        "calibration type": (word(b"dt: d", b"dt: u"), 1, 1, HEAD),
    },
    ("force", LOG): {
        "log header bytes": (d.foreign_bytes, 1, 10, HEAD),
        "log rate": (number(b"Frequency"), 2, 10, FIXED),
        "log unit": (word(b"(N)", b"(lbf)"), 1, 1, FIXED),
        "log saturated": (d.saturated, 2e-3, 0.1, ANY, "saturated_samples"),
        "log frozen": (d.frozen_sensor, 2e-3, 0.1, ANY, "repeated_rows", "frozen_samples"),
    },
}
FAULTS |= {
    f"{instrument}: {name}": Fault(instrument, pattern, *row[:4], row[4:])
    for (instrument, pattern), rows in GRID.items()
    for name, row in rows.items()
}


@contextmanager
def bounded(seconds: float = SECONDS) -> Iterator[None]:
    """Fail beyond ``seconds``, or beyond MEGABYTES more than are in use."""

    def overdue(*_: object) -> None:
        raise TimeoutError(f"longer than {seconds} s")

    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    limits, handler = resource.getrlimit(resource.RLIMIT_AS), signal.signal(signal.SIGALRM, overdue)
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEGABYTES * 2**20, limits[1]))
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
        resource.setrlimit(resource.RLIMIT_AS, limits)


@pytest.mark.parametrize("name", FAULTS)
@SETTINGS
@given(share=st.floats(0, 1), seed=st.integers(0, 2**32 - 1))
def test_a_fault_is_repaired_and_counted_or_refused_with_its_place(benches, name, share, seed):
    fault = FAULTS[name]
    bench, rng = benches[fault.instrument], np.random.default_rng(seed)
    files = fault.inflict(bench.files, fault.between(share), rng)
    with bounded():
        kind, found = outcome(bench, files, fault.counted)
    assert kind in fault.outcomes, (kind, found)
    assert files != bench.files
    if kind == REFUSED:
        assert isinstance(found, PipelineError) and {"file", "take"} & set(found.evidence)
        # where a file lies is evidence, so that messages are the same on every machine
        assert "\n" not in found.message and "/tmp" not in found.message


@pytest.mark.parametrize("instrument", ["take", "depth", "force", "joints"])
@settings(SETTINGS, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_file_cut_at_any_byte_never_gives_a_number_that_was_not_there(benches, instrument, seed):
    bench, rng = benches[instrument], np.random.default_rng(seed)
    name = sorted(bench.files)[rng.integers(len(bench.files))]
    content = bench.files[name]
    with bounded():
        _, found = outcome(
            bench, {**bench.files, name: content[: int(rng.integers(len(content)))]}, ()
        )
    if isinstance(found, Recovered) and instrument in ("take", "joints"):
        # the rows that are left are unchanged
        rows = bench.clean.values[: len(found.values)]
        np.testing.assert_allclose(found.values, rows, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "severity", "times"),
    [
        ("take: labels swapped", 60, 1.05),
        ("take: links swapped", 60, 1.05),
        ("take: label lost", 60, 1.05),
        ("optitrack/*.csv: doubled_rows", 10, 1.0001),
        ("take: frozen", 10, 6.0),
        ("depth: frozen", 5, 1.5),
        ("kinect/*/depth.txt: dropped_rows", 5, 1.5),
        ("depth: clock offset", 0.1, 1.5),
    ],
)
def test_a_repaired_recording_has_the_error_of_a_clean_one(benches, name, severity, times):
    fault = FAULTS[name]
    bench = benches[fault.instrument]
    for seed in range(3):
        files = fault.inflict(bench.files, severity, np.random.default_rng(seed))
        kind, found = outcome(bench, files, fault.counted)
        assert kind == REPAIRED and bench.error(found) <= times * bench.error(bench.clean)


# the controls: what the outcomes above would miss


def test_a_number_changed_in_silence_is_unnoticed_and_an_equal_one_unharmed(benches):
    bench, name = benches["take"], "optitrack/test_001.csv"
    row = bench.files[name].splitlines()[60]
    head, y, z = row.rsplit(b",", 2)  # the marker's z is normal to the plane of the arm
    other = b",".join([head, y[:-1] + (b"9" if y[-1:] < b"5" else b"1"), z])
    for old, new, kind in ((row, other, UNNOTICED), (b"\r\n", b"\n", UNHARMED)):
        files = {**bench.files, name: bench.files[name].replace(old, new)}
        assert outcome(bench, files, ("skipped_frames",))[0] == kind


def test_an_exception_of_a_library_is_no_refusal_and_the_bounds_hold(benches):
    def broken(folder: Path) -> Recovered:
        raise ValueError("from inside a library")

    bench = benches["force"]
    bench = Bench(bench.files, broken, bench.clean, bench.time, bench.truth)
    with pytest.raises(ValueError, match="library"):
        outcome(bench, bench.files, ())
    with pytest.raises(MemoryError), bounded():
        np.ones(2**28)
    with pytest.raises(TimeoutError), bounded(0.1):
        while True:
            pass
