"""Joint logs as tables and as arrays with names: signals by the names of columns and arrays, or by
the options; units; logs of real arms; refusals by array and row.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from joint_files import read_joint_log, table
from numpy.testing import assert_allclose, assert_array_equal
from ros_bags import Message, write_bag
from scipy.io import loadmat, savemat
from source_code import ROOT
from written_logs import refusal

from pipeline.core.sources import imported_sources, sources_hash
from pipeline.formats import joints
from pipeline.formats.format import Kind, format_of, formats_in
from pipeline.formats.joints.arrays import read_arrays
from pipeline.formats.joints.bag import JOINT_STATE, read_joint_bag
from pipeline.formats.joints.log import LogOptions
from pipeline.recordings.movement import read_log
from pipeline.stages.files import reader_code

cases = cases_beside(__file__)
KEY = "dataset.joint_log"


@cases("forms")
def test_tables_are_read_by_labels_or_numbers_in_any_form(
    tmp_path,
    header,
    row,
    columns,
    options,
):
    times = ["0.000", "0.008", "0.016", "0.024"]
    rows = [row.format(t=time) for time in times]
    if ";" in header:
        rows = [text.replace(".", ",") for text in rows]
    file = table(tmp_path, header, *rows)

    log = read_joint_log(file, joints=3, columns=columns, options=LogOptions(**options))

    assert_allclose(log.signals["actual"], [[0.1, 0.2, 0.3]] * 4, rtol=1e-12)
    assert_allclose(log.time, [0, 0.008, 0.016, 0.024], atol=1e-12)


def test_columns_whose_labels_name_other_joints_are_refused(tmp_path):
    file = table(tmp_path, "t,q_elbow,q_wrist", "0,1,2", "1,1,2")
    options = LogOptions("t", names=("wrist_joint", "elbow_joint"))
    columns = {"columns": ["q_elbow", "q_wrist"], "options": options}
    error = refusal(partial(read_joint_log, joints=2, **columns), file)

    assert error.evidence["key"] == f"{KEY}.joints"
    assert "elbow_joint, wrist_joint" in error.message


def test_columns_whose_cells_name_other_joints_are_refused(tmp_path):
    row = "elbow,wrist,1,2"
    file = table(tmp_path, "t,name0,name1,q0,q1", f"0,{row}", f"1,{row}")
    read = partial(read_joint_log, joints=2, columns=["q0", "q1"])
    right = LogOptions("t", names=("elbow", "wrist"))
    assert read(file, options=right).signals["actual"].tolist() == [[1, 2]] * 2

    exchanged = LogOptions("t", names=("wrist", "elbow"))
    error = refusal(partial(read, options=exchanged), file)
    assert error.evidence["key"] == f"{KEY}.joints"


@cases("units")
def test_a_unit_in_the_header_is_never_read_as_another(
    tmp_path,
    header,
    key,
    unit,
    last,
    angles,
):
    file = tmp_path / "log.csv"
    options = LogOptions()
    file.write_text(f"{header}\n0.0,0.5,1.5\n0.1,0.5,1.5\n")
    if key:
        error = refusal(partial(read_joint_log, joints=2), file)
        assert error.evidence["key"] == f"{KEY}.{key}"
        options = LogOptions(**{key: unit})
    log = read_joint_log(file, joints=2, options=options)

    assert log.time[-1] == pytest.approx(last)
    assert_allclose(log.signals["actual"], [angles] * 2)


def test_degrees_that_are_taken_for_radians_are_refused_with_the_option_and_the_time(
    tmp_path,
):
    file = table(tmp_path, "", "0.0, 10.5, -90.0", "0.1, 10.5, -90.0")
    error = refusal(partial(read_joint_log, joints=2), file)

    assert error.evidence["key"] == f"{KEY}.angle_unit"
    assert "at 0 s from" in error.message


ROWS = 6
PLAIN = LogOptions()
STAMPS = 1.46e9 + np.arange(ROWS) * 0.005  # s since 1970
ACTUAL = np.random.default_rng(1).normal(size=(ROWS, 3))
ARRAYS = {"times": STAMPS, "positions": ACTUAL, "target_positions": ACTUAL + 1}
ARRAYS["torques"] = 0 * ACTUAL


def parquet(file: Path, arrays: dict[str, np.ndarray]) -> None:
    columns = {"mode": "servo"}
    # numbers order the joints, not the places of the columns
    for name, values in reversed(arrays.items()):
        if values.ndim == 1:
            columns[name] = values
        else:
            for joint in reversed(range(values.shape[1])):
                columns[f"{name}_{joint}"] = values[:, joint]
    pd.DataFrame(columns).to_parquet(file)


WRITE = {
    "npz": lambda file, arrays: np.savez(file, **arrays),
    "mat": lambda file, arrays: savemat(file, arrays, do_compression=True),
    "parquet": parquet,
}


def archive(folder: Path, form: str = "npz", **arrays: np.ndarray) -> Path:
    WRITE[form](folder / f"log.{form}", arrays)
    return folder / f"log.{form}"


def test_the_code_of_a_reader_is_named_for_the_files_that_it_reads(tmp_path):
    """A further format changes no line of the list of other files."""
    module, code = reader_code(archive(tmp_path, **ARRAYS)).split()
    assert module == read_arrays.__module__
    assert code == sources_hash(imported_sources([module]))
    (tmp_path / "log.csv").write_text("time,q_0\n0.0,0.1\n0.1,0.2\n")
    assert reader_code(tmp_path / "log.csv") == ""

    states = Message(JOINT_STATE, 1.0, name=["a"], position=np.zeros(1))
    states.fields |= dict.fromkeys(("velocity", "effort"), np.zeros(0))
    bag = write_bag(tmp_path, "mcap", {"/joint_states": [(1.0, states)]})
    for file in bag.iterdir():
        assert reader_code(file).split()[0] == read_joint_bag.__module__


@pytest.mark.parametrize("form", WRITE)
def test_arrays_are_found_by_their_names(tmp_path, form):
    file = archive(tmp_path, form, **ARRAYS)
    assert format_of(file, formats_in(joints, Kind.JOINTS)).read is read_arrays

    log = read_arrays(file, PLAIN)
    assert_array_equal(log.time, STAMPS)
    assert [*log.signals] == ["actual", "target"] and log.counts == {"doubled_rows": 0}
    assert_array_equal(log.signals["actual"], ACTUAL)
    assert_array_equal(log.signals["target"], ACTUAL + 1)


@pytest.mark.parametrize("form", WRITE)
def test_arrays_and_columns_are_named_by_the_option(tmp_path, form):
    clock = np.arange(ROWS) * 5
    turned = ACTUAL[:, [1, 0, 2]]
    file = archive(tmp_path, form, clock=clock, a=ACTUAL, b=turned)
    columns = ["b_1", "b_0", "b_2"] if form == "parquet" else ["b:1", "b:0", "b:2"]
    named = {"actual": ["a"], "target": columns}
    options = LogOptions("clock", angle_unit="deg", time_unit="ms", signals=named)

    log = read_arrays(file, options)

    assert_allclose(log.time, np.arange(ROWS) * 0.005)
    assert_allclose(log.signals["actual"], np.deg2rad(ACTUAL))
    assert_array_equal(log.signals["actual"], log.signals["target"])


def test_without_times_the_rate_gives_them_and_an_absent_column_is_refused(tmp_path):
    file = archive(tmp_path, "npz", a=ACTUAL)
    log = read_arrays(file, LogOptions(None, rate=200.0, signals={"actual": ["a"]}))
    assert_allclose(log.time, np.arange(ROWS) * 0.005)

    for column in ("a:3", "absent:0"):
        options = LogOptions(None, rate=200.0, signals={"actual": [column] * 3})
        error = refusal(read_arrays, file, options)
        assert "a (6, 3)" in error.message
        assert error.evidence["key"] == f"{KEY}.signals"


LOST = ACTUAL.copy()
BACK = STAMPS.copy()
LOST[4] = np.nan
BACK[2] = 0.0
TWICE = "2 arrays could be the measured angles, positions, q; name one in signals"
REFUSED = {  # words: arrays, evidence
    "positions:0 holds nan": (
        ARRAYS | {"positions": LOST},
        {"array": "positions:0", "row": 4},
    ),
    "does not increase": (ARRAYS | {"times": BACK}, {"array": "times", "row": 2}),
    "6 times for 5 of actual": (ARRAYS | {"positions": ACTUAL[:5]}, {"array": "times"}),
    "positions (6,)": (ARRAYS | {"positions": ACTUAL[:, 0]}, {"key": f"{KEY}.signals"}),
    TWICE: (ARRAYS | {"q": ACTUAL}, {"key": f"{KEY}.signals"}),
    "no name of an array states the time": (
        {"q": ACTUAL, "q_target": ACTUAL},
        {"key": f"{KEY}.time"},
    ),
}


def test_an_array_that_the_file_lacks_is_named_with_those_that_it_has(tmp_path):
    options = replace(PLAIN, signals={"actual": ["measured"], "target": ["targets"]})
    error = refusal(read_arrays, archive(tmp_path, "npz", **ARRAYS), options)

    assert "actual is named measured, which the file lacks" in error.message
    assert "positions (6, 3)" in error.message


@pytest.mark.parametrize("form", ["npz", "mat"])
@pytest.mark.parametrize("words", REFUSED)
def test_what_is_no_log_is_refused_by_array_and_row(tmp_path, words, form):
    arrays, evidence = REFUSED[words]
    error = refusal(read_arrays, archive(tmp_path, form, **arrays), PLAIN)
    assert words in error.message and evidence.items() <= error.evidence.items()


def test_objects_are_never_loaded(tmp_path):
    class Trap:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "pwned",))

    objects = np.empty((ROWS, 3), dtype=object)
    objects[:] = Trap()
    file = archive(tmp_path, **ARRAYS | {"positions": objects})
    error = refusal(read_arrays, file, PLAIN)
    assert "positions ()" in error.message and not (tmp_path / "pwned").exists()


def test_matrices_in_structs_have_a_dotted_path(tmp_path):
    arm = {"q": ACTUAL, "ref_pos_deg": np.rad2deg(ACTUAL)}
    file = archive(tmp_path, "mat", rec={"t": STAMPS, "arm": arm, "name": "run"})
    signals = {"actual": ["rec.arm.ref_pos_deg"]}
    log = read_arrays(file, LogOptions("rec.t", angle_unit="deg", signals=signals))
    assert_allclose(log.signals["actual"], ACTUAL)

    columns = {"actual": ["rec.arm.q:2", "rec.arm.q:0", "rec.arm.q:1"]}
    log = read_arrays(file, LogOptions("rec.t", signals=columns))
    assert_array_equal(log.signals["actual"], ACTUAL[:, [2, 0, 1]])
    error = refusal(read_arrays, file, LogOptions(signals={"actual": ["q"]}))
    assert "rec.arm.q (6, 3)" in error.message


def test_a_file_of_version_7_3_is_refused_with_the_option_of_matlab(tmp_path):
    file = archive(tmp_path, "mat", **ARRAYS)
    file.write_bytes(b"MATLAB 7.3 MAT-file, " + file.read_bytes()[21:])
    assert "-v7" in refusal(read_arrays, file, PLAIN).message


@pytest.mark.parametrize("run", ["run_A", "run_B"])
def test_structs_of_a_real_arm_are_what_scipy_reads(run):
    file = ROOT.parent / f"shared/recordings/kr300/{run}.mat"
    if not file.is_file():
        pytest.skip(f"the recordings of the KR300 are absent at {file}")
    struct = loadmat(file, simplify_cells=True)["rec"]

    log = read_arrays(file, PLAIN)

    for signal, name in (("actual", "act_pos_se_deg"), ("target", "ref_pos_deg")):
        angles = np.deg2rad(struct[name].T)
        assert_array_equal(log.signals[signal], angles)
    assert_allclose(log.time, struct["time_cont"], atol=1e-9)


@pytest.mark.parametrize("form", ["npz", "mat"])
def test_joints_times_samples_and_joint_names_beside_the_times_are_read(tmp_path, form):
    beside = {"joint_names": np.array([*"abc"]), "None": np.array(["x"])}
    turned = {name: array.T for name, array in ARRAYS.items()}
    file = archive(tmp_path, form, **turned | beside)

    log = read_arrays(file, PLAIN)

    assert_array_equal(log.signals["target"], ACTUAL + 1)
    assert log.joints == ("a", "b", "c")
    error = refusal(read_arrays, file, LogOptions("absent", joints=3))
    assert "None" not in error.message and "positions (6, 3)" in error.message

    exchanged = LogOptions("times", joints=3, names=("b", "a", "c"))
    error = refusal(read_log, file, exchanged)
    assert "the joints of the log are a, b, c" in error.message
