"""Joint logs in NumPy's archives: read by the names of their arrays, or as the option has them;
what is damaged, hostile or of another shape is refused by array and row.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Head
from pipeline.formats.joints import npz
from pipeline.formats.joints.log import LogOptions

ROWS, PLAIN = 6, LogOptions()
TIME = 1.46e9 + np.arange(ROWS) * 0.005  # s since 1970
ACTUAL = np.random.default_rng(1).normal(size=(ROWS, 3))
ARRAYS = {"times": TIME, "positions": ACTUAL, "target_positions": ACTUAL + 1, "torques": 0 * ACTUAL}


def archive(folder: Path, **arrays: np.ndarray) -> Path:
    np.savez(folder / "log.npz", **arrays)
    return folder / "log.npz"


def refusal(file: Path, options: LogOptions = PLAIN) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        npz.read_npz(file, options)
    assert caught.value.evidence["file"] == file
    return caught.value


def test_arrays_are_told_by_their_names(tmp_path):
    file = archive(tmp_path, **ARRAYS)
    assert npz.FORMAT.recognises(Head.read(file))
    log = npz.read_npz(file, LogOptions())
    np.testing.assert_array_equal(log.time, TIME)
    assert [*log.signals] == ["actual", "target"] and log.counts == {"doubled_rows": 0}
    np.testing.assert_array_equal(log.signals["target"], ACTUAL + 1)
    # the control: another archive of ZIP is none of these
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as other:
        other.writestr("notes.txt", "a")
    assert not npz.FORMAT.recognises(Head.read(tmp_path / "other.zip"))


def test_the_option_names_arrays_or_their_columns_and_units(tmp_path):
    file = archive(tmp_path, clock=np.arange(ROWS) * 5, a=ACTUAL, b=ACTUAL[:, [1, 0, 2]])
    options = LogOptions(
        "clock",
        angle_unit="deg",
        time_unit="ms",
        signals={"actual": ["a"], "target": ["b:1", "b:0", "b:2"]},
    )
    log = npz.read_npz(file, options)
    np.testing.assert_allclose(log.time, np.arange(ROWS) * 0.005)
    np.testing.assert_allclose(log.signals["actual"], np.deg2rad(ACTUAL))
    np.testing.assert_array_equal(log.signals["actual"], log.signals["target"])
    untimed = npz.read_npz(file, LogOptions(None, rate=200.0, signals={"actual": ["a"]}))
    np.testing.assert_allclose(untimed.time, np.arange(ROWS) * 0.005)


def changed(name: str, row: int, value: float) -> dict[str, np.ndarray]:
    values = ARRAYS[name].copy()
    values[row] = value
    return ARRAYS | {name: values}


@pytest.mark.parametrize(
    ("arrays", "words", "evidence"),
    [
        (changed("positions", 4, np.nan), "positions holds", {"array": "positions", "row": 4}),
        (changed("times", 2, np.inf), "times holds inf", {"array": "times", "row": 2}),
        (changed("times", 2, 0.0), "does not increase", {"array": "times", "row": 2}),
        (ARRAYS | {"positions": ACTUAL.T[:2]}, "6 times for 2 of actual", {"array": "times"}),
        (ARRAYS | {"positions": ACTUAL[:, 0]}, r"shape is \(6,\)", {"array": "positions"}),
        (ARRAYS | {"positions": ACTUAL.astype(str)}, "no array of plain", {"array": "positions"}),
        (ARRAYS | {"positions": ACTUAL[:0]}, r"shape is \(0, 3\)", {"array": "positions"}),
        (ARRAYS | {"q": ACTUAL}, "could each be the actual", {"key": "dataset.joint_log.signals"}),
        ({"x": TIME, "q": ACTUAL}, "named like the target", {"key": "dataset.joint_log.signals"}),
        (
            {"q": ACTUAL, "q_target": ACTUAL},
            "named like the time",
            {"key": "dataset.joint_log.time"},
        ),
    ],
)
def test_what_is_no_log_is_refused_by_array_and_row(tmp_path, arrays, words, evidence):
    error = refusal(archive(tmp_path, **arrays))
    assert evidence.items() <= error.evidence.items()
    with pytest.raises(AssertionError, match=words):
        raise AssertionError(error.message)


def test_columns_that_are_not_there_are_refused_with_what_there_is(tmp_path):
    file = archive(tmp_path, **ARRAYS)
    for columns in (["positions:3"] * 3, ["pos:0"] * 3, ["positions", "positions", "positions"]):
        error = refusal(file, LogOptions(signals={"actual": columns}))
        assert "positions (6, 3)" in error.message


def test_objects_are_never_loaded(tmp_path):
    class Trap:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "pwned",))

    objects = np.empty((ROWS, 3), dtype=object)
    objects[:] = Trap()
    error = refusal(archive(tmp_path, **ARRAYS | {"positions": objects}))
    assert "no array of plain numbers" in error.message and not (tmp_path / "pwned").exists()


def test_a_header_that_asks_for_more_than_the_file_has_takes_no_memory(tmp_path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**11, 3)}
    )
    with zipfile.ZipFile(archive(tmp_path, times=TIME, q_target=ACTUAL), "a") as members:
        members.writestr("q.npy", header.getvalue())
    assert "no array of plain numbers" in refusal(tmp_path / "log.npz").message


def test_an_archive_cut_or_damaged_at_any_place_is_refused_or_read_as_it_was(tmp_path):
    file = archive(tmp_path, **{name: ARRAYS[name] for name in ("times", "positions")})
    content, options = file.read_bytes(), LogOptions(signals={"actual": ["positions"]})
    for place in range(0, len(content), 7):
        file.write_bytes(content[:place])
        refusal(file, options)
        file.write_bytes(content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :])
        try:
            log = npz.read_npz(file, options)
        except RecordingError:
            continue
        np.testing.assert_array_equal(log.signals["actual"], ACTUAL)


def test_a_real_archive_holds_both_angles_of_seven_joints(shared):
    log = npz.read_npz(shared / "recordings/lwr4/measurements_1.npz", LogOptions())
    assert {name: rows.shape for name, rows in log.signals.items()} == {
        "actual": (5027, 7),
        "target": (5027, 7),
    }
    assert log.time[-1] - log.time[0] == pytest.approx(25.1295, abs=1e-4)
