"""Which column of an ATI DAQ F/T log is which axis, in which unit: labels or options decide."""

from __future__ import annotations

import numpy as np
import pytest
from force_files import ROW, log, refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.force.daqft import read_daqft
from pipeline.formats.force.record import ForceLogOptions
from pipeline.formats.force.table import read_force_table


@pytest.mark.parametrize(
    ("force", "torque", "newton", "newton_metre"),
    [
        ("N", "N-m", 1, 1),
        ("N", "N-mm", 1, 1e-3),
        ("kN", "kN-m", 1e3, 1e3),
        ("lbf", "lbf-in", 0.45359237 * 9.80665, 0.45359237 * 9.80665 * 0.0254),
        ("lbf", "lbf-ft", 0.45359237 * 9.80665, 0.45359237 * 9.80665 * 0.3048),
        ("N", "N·m", 1, 1),
    ],
)
def test_units_become_newton_and_newton_metre(tmp_path, force, torque, newton, newton_metre):
    result = read_daqft(log(tmp_path, '"1","2","3","4","5","6"', force=force, torque=torque))
    np.testing.assert_allclose(result.force, [np.array([1, 2, 3]) * newton], rtol=1e-14)
    np.testing.assert_allclose(result.torque, [np.array([4, 5, 6]) * newton_metre], rtol=1e-14)


def test_labels_decide_the_order_of_the_axes(tmp_path):
    file = log(tmp_path, '"1","2","3","4","5","6"')
    file.write_text(
        file.read_text()
        .replace("Force X", "Force ?")
        .replace("Force Z", "Force X")
        .replace("Force ?", "Force Z")
    )
    np.testing.assert_array_equal(read_daqft(file).force, [[3, 2, 1]])


def test_a_log_of_forces_alone_has_no_torque(tmp_path):
    (tmp_path / "log.csv").write_text(
        "Force X (N),Force Y (N),Force Z (N),Frequency = 250,Averaging Level = 1\n1,2,3\n"
    )
    result = read_daqft(tmp_path / "log.csv")
    np.testing.assert_array_equal(result.force, [[1, 2, 3]])
    assert np.isnan(result.torque).all()


NUMBERED = {"fx": 0, "fy": 1, "fz": 2, "tx": 3, "ty": 4, "tz": 5}


@pytest.mark.parametrize(
    "header",
    [
        "Frequency = 1000,Averaging Level = 16,F/T Serial Number = "
        "FT1\nFx,Fy,Fz,Tx,Ty,Tz\nN,N,N,N-mm,N-mm,N-mm",
        'Paused for 500 milliseconds before saving data.\n"Force X","Force Y","Force Z","Torque '
        'X","Torque Y","Torque Z"\n'
        '"(N)","(N)","(N)","(N-mm)","(N-mm)","(N-mm)","Frequency = 1000","Averaging Level = '
        '16","F/T Serial Number = FT1"',
        "Fx [N],Fy [N],Fz [N],Mx [N-mm],My [N-mm],Mz [N-mm],Frequency = 1000,Averaging Level = "
        "16,F/T Serial Number = FT1",
    ],
)
def test_labels_units_and_settings_may_stand_in_rows_of_their_own(tmp_path, header):
    (tmp_path / "log.csv").write_text(f"{header}\n{ROW}\n{ROW}\n")
    result = read_daqft(tmp_path / "log.csv")
    np.testing.assert_array_equal(result.force, [[1.5, 2, 3]] * 2)
    np.testing.assert_allclose(result.torque, [[0.004, 0.005, 0.006]] * 2)
    assert (result.rate, result.serial) == (62.5, "FT1")


def test_axes_that_are_labelled_twice_are_settled_by_their_numbers(tmp_path):
    file = log(tmp_path, ROW)
    file.write_text(file.read_text().replace("Torque X", "Torque Z"))
    assert refusal(file).evidence["key"] == "dataset.force.log.columns"
    options = ForceLogOptions(columns=NUMBERED)
    np.testing.assert_array_equal(read_daqft(file, options).torque, [[4, 5, 6]])
    # only what is named is read
    forces = ForceLogOptions(
        columns={axis: column for axis, column in NUMBERED.items() if axis.startswith("f")}
    )
    assert np.isnan(read_daqft(file, forces).torque).all()


def test_a_log_without_labels_is_a_table_whose_columns_have_numbers(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(f"{ROW}\n{ROW}\n")
    assert refusal(file).evidence["key"] == "dataset.force.log.format"
    result = read_force_table(
        file, ForceLogOptions(columns=NUMBERED, rate=62.5, force_unit="N", torque_unit="N-m")
    )
    np.testing.assert_array_equal(
        np.hstack([result.force, result.torque]), [[1.5, 2, 3, 4, 5, 6]] * 2
    )


@pytest.mark.parametrize(
    ("columns", "words"),
    [({"fx": 0, "fy": 1}, "fz"), ({"fx": 0, "fy": 1, "fz": 2, "tx": 3}, "all or none")],
)
def test_columns_that_name_some_of_the_axes_are_refused(tmp_path, columns, words):
    file = log(tmp_path, '"1","2","3","4","5","6"')
    with pytest.raises(RecordingError, match=words) as caught:
        read_daqft(file, ForceLogOptions(columns=columns))
    assert caught.value.evidence["key"] == "dataset.force.log.columns"
