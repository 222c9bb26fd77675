"""Joint logs in MATLAB's files: read by the names of their matrices, refused where damaged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Head
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.mat import FORMAT, read_mat

TIME = np.arange(6) * 0.005
ACTUAL = np.random.default_rng(1).normal(size=(6, 3))
HELD = {"time": TIME, "measured": ACTUAL, "q_target": ACTUAL + 1, "robot": {"name": "arm"}}


@pytest.fixture
def file(tmp_path):
    savemat(tmp_path / "run.mat", HELD, do_compression=True)
    return tmp_path / "run.mat"


def test_matrices_are_told_by_their_names_and_a_vector_is_a_number_a_row(file):
    assert FORMAT.recognises(Head.read(file))
    log = read_mat(file, LogOptions())
    np.testing.assert_array_equal(log.time, TIME)
    np.testing.assert_array_equal(log.signals["actual"], ACTUAL)
    np.testing.assert_array_equal(log.signals["target"], ACTUAL + 1)


@pytest.mark.parametrize(
    ("held", "words"),
    [
        (HELD | {"time": TIME[:-1]}, "5 times for 6 of actual"),
        (HELD | {"measured": np.full((6, 3), np.nan)}, "measured holds"),
        (HELD | {"measured": "text"}, "no array of plain numbers"),
        ({name: HELD[name] for name in ("time", "q_target")}, "named like the actual"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, held, words):
    savemat(tmp_path / "run.mat", held)
    with pytest.raises(RecordingError, match=words):
        read_mat(tmp_path / "run.mat", LogOptions())


def test_a_damaged_file_and_one_of_the_version_7_3_are_refused(file):
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    with pytest.raises(RecordingError, match="damaged"):
        read_mat(file, LogOptions())
    file.write_bytes(b"MATLAB 7.3 MAT-file, " + content[21:])
    with pytest.raises(RecordingError, match="-v7"):
        read_mat(file, LogOptions())


def test_matrices_in_structs_have_a_dotted_path(tmp_path):
    rec = {"t": TIME, "arm": {"q": ACTUAL, "ref_pos_deg": np.rad2deg(ACTUAL)}, "name": "run"}
    savemat(tmp_path / "run.mat", {"rec": rec})
    signals = {"actual": ["rec.arm.ref_pos_deg"]}
    log = read_mat(tmp_path / "run.mat", LogOptions("rec.t", angle_unit="deg", signals=signals))
    np.testing.assert_allclose(log.signals["actual"], ACTUAL)
    columns = {"actual": [f"rec.arm.q:{j}" for j in (2, 0, 1)]}
    log = read_mat(tmp_path / "run.mat", LogOptions("rec.t", signals=columns))
    np.testing.assert_array_equal(log.signals["actual"], ACTUAL[:, [2, 0, 1]])
    with pytest.raises(RecordingError, match=r"there are .*rec\.arm\.q \(6, 3\)") as refused:
        read_mat(tmp_path / "run.mat", LogOptions(signals={"actual": ["q"]}))
    assert refused.value.evidence["key"] == "dataset.joint_log.signals"
