"""Joint logs that are arrays with names, in each of their formats: read by the names, or as the
option has them; what is damaged, hostile or of another shape is refused by array and row.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from pipeline.core.errors import RecordingError
from pipeline.formats import joints
from pipeline.formats.format import Kind, format_of, formats_in
from pipeline.formats.joints.arrays import read_arrays
from pipeline.formats.joints.log import LogOptions

ROWS, PLAIN = 6, LogOptions()
TIME = 1.46e9 + np.arange(ROWS) * 0.005  # s since 1970
ACTUAL = np.random.default_rng(1).normal(size=(ROWS, 3))
ARRAYS = {"times": TIME, "positions": ACTUAL, "target_positions": ACTUAL + 1, "torques": 0 * ACTUAL}
SIGNALS, TIMES = "dataset.joint_log.signals", "dataset.joint_log.time"


def parquet(file: Path, arrays: dict[str, np.ndarray]) -> None:
    columns = {}
    for name, values in arrays.items():
        many = {f"{name}_{j}": column for j, column in enumerate(np.atleast_2d(values.T))}
        columns |= many if values.ndim > 1 else {name: values}
    # numbers order the joints, not the places of the columns
    pd.DataFrame(dict(reversed(columns.items()))).assign(mode="servo").to_parquet(file)


WRITE = {
    "npz": lambda file, arrays: np.savez(file, **arrays),
    "mat": lambda file, arrays: savemat(file, arrays, do_compression=True),
    "parquet": parquet,
}


def archive(folder: Path, form: str = "npz", **arrays: np.ndarray) -> Path:
    WRITE[form](folder / f"log.{form}", arrays)
    return folder / f"log.{form}"


def refusal(file: Path, options: LogOptions = PLAIN) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_arrays(file, options)
    assert caught.value.evidence["file"] == file
    return caught.value


@pytest.mark.parametrize("form", WRITE)
def test_arrays_are_found_by_their_names_or_named_by_the_option(tmp_path, form):
    file = archive(tmp_path, form, **ARRAYS)
    assert format_of(file, formats_in(joints, Kind.JOINTS)).read is read_arrays
    log = read_arrays(file, PLAIN)
    np.testing.assert_array_equal(log.time, TIME)
    assert [*log.signals] == ["actual", "target"] and log.counts == {"doubled_rows": 0}
    np.testing.assert_array_equal(log.signals["actual"], ACTUAL)
    np.testing.assert_array_equal(log.signals["target"], ACTUAL + 1)
    file = archive(tmp_path, form, clock=np.arange(ROWS) * 5, a=ACTUAL, b=ACTUAL[:, [1, 0, 2]])
    columns = ["b:1", "b:0", "b:2"] if form != "parquet" else ["b_1", "b_0", "b_2"]
    named = {"actual": ["a"], "target": columns}
    log = read_arrays(file, LogOptions("clock", angle_unit="deg", time_unit="ms", signals=named))
    np.testing.assert_allclose(log.time, np.arange(ROWS) * 0.005)
    np.testing.assert_allclose(log.signals["actual"], np.deg2rad(ACTUAL))
    np.testing.assert_array_equal(log.signals["actual"], log.signals["target"])
    untimed = read_arrays(file, LogOptions(None, rate=200.0, signals={"actual": ["a"]}))
    np.testing.assert_allclose(untimed.time, np.arange(ROWS) * 0.005)
    for wrong in (["a:3"] * 3, ["absent:0"] * 3):
        error = refusal(file, LogOptions("clock", signals={"actual": wrong}))
        assert "a (6, 3)" in error.message and error.evidence["key"] == SIGNALS


def changed(name: str, row: int, value: float) -> dict[str, np.ndarray]:
    values = ARRAYS[name].copy()
    values[row] = value
    return ARRAYS | {name: values}


REFUSED = {
    "positions:0 holds nan": (changed("positions", 4, np.nan), {"array": "positions:0", "row": 4}),
    "times holds inf": (changed("times", 2, np.inf), {"array": "times", "row": 2}),
    "does not increase": (changed("times", 2, 0.0), {"array": "times", "row": 2}),
    "6 times for 2 of actual": (ARRAYS | {"positions": ACTUAL.T[:2]}, {"array": "times"}),
    "positions (6,)": (ARRAYS | {"positions": ACTUAL[:, 0]}, {"key": SIGNALS}),
    "positions ()": (ARRAYS | {"positions": ACTUAL.astype(str)}, {"key": SIGNALS}),
    "the actual must be": (ARRAYS | {"q": ACTUAL}, {"key": SIGNALS}),
    "the target must be": ({"times": TIME, "q": ACTUAL}, {"key": SIGNALS}),
    "the time must be": ({"q": ACTUAL, "q_target": ACTUAL}, {"key": TIMES}),
}


@pytest.mark.parametrize("form", ["npz", "mat"])
@pytest.mark.parametrize("words", REFUSED)
def test_what_is_no_log_is_refused_by_array_and_row(tmp_path, words, form):
    arrays, evidence = REFUSED[words]
    error = refusal(archive(tmp_path, form, **arrays))
    assert words in error.message and evidence.items() <= error.evidence.items()


def test_objects_are_never_loaded_and_an_announced_size_takes_no_memory(tmp_path):
    class Trap:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "pwned",))

    objects = np.empty((ROWS, 3), dtype=object)
    objects[:] = Trap()
    error = refusal(archive(tmp_path, **ARRAYS | {"positions": objects}))
    assert "positions ()" in error.message and not (tmp_path / "pwned").exists()
    header = io.BytesIO()
    announced = {"descr": "<f8", "fortran_order": False, "shape": (10**11, 3)}
    np.lib.format.write_array_header_1_0(header, announced)
    with zipfile.ZipFile(archive(tmp_path, times=TIME, q_target=ACTUAL), "a") as members:
        members.writestr("q.npy", header.getvalue())
    assert "of memory" in refusal(tmp_path / "log.npz").message


def test_matrices_in_structs_have_a_dotted_path_and_version_7_3_is_named(tmp_path):
    rec = {"t": TIME, "arm": {"q": ACTUAL, "ref_pos_deg": np.rad2deg(ACTUAL)}, "name": "run"}
    file = archive(tmp_path, "mat", rec=rec)
    signals = {"actual": ["rec.arm.ref_pos_deg"]}
    log = read_arrays(file, LogOptions("rec.t", angle_unit="deg", signals=signals))
    np.testing.assert_allclose(log.signals["actual"], ACTUAL)
    columns = {"actual": [f"rec.arm.q:{j}" for j in (2, 0, 1)]}
    log = read_arrays(file, LogOptions("rec.t", signals=columns))
    np.testing.assert_array_equal(log.signals["actual"], ACTUAL[:, [2, 0, 1]])
    assert "rec.arm.q (6, 3)" in refusal(file, LogOptions(signals={"actual": ["q"]})).message
    file.write_bytes(b"MATLAB 7.3 MAT-file, " + file.read_bytes()[21:])
    assert "-v7" in refusal(file).message


def test_a_real_archive_holds_both_angles_of_seven_joints(shared):
    log = read_arrays(shared / "recordings/lwr4/measurements_1.npz", PLAIN)
    assert {name: rows.shape for name, rows in log.signals.items()} == {
        "actual": (5027, 7),
        "target": (5027, 7),
    }
    assert log.time[-1] - log.time[0] == pytest.approx(25.1295, abs=1e-4)
