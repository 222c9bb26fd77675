"""Tables of forces from any program: columns, units, clock, and what nothing settles."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from written_logs import refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import ForceLogOptions, read_force_table

COLUMNS = {"t": "time", "fx": "F1", "fy": "F2", "fz": "F3", "tx": "M1", "ty": "M2", "tz": "M3"}
SI = ForceLogOptions(columns=COLUMNS, force_unit="N", torque_unit="N-m", time_unit="s")
BY_NUMBER = dataclasses.replace(SI, columns={axis: n for n, axis in enumerate(COLUMNS)})
HEADER = "time,F1,F2,F3,M1,M2,M3"
POUND = 0.45359237 * 9.80665


def table(folder, *rows: str, header: str = HEADER + "\n"):
    (folder / "log.csv").write_text(header + "".join(row + "\n" for row in rows))
    return folder / "log.csv"


def test_the_force_log_of_a_real_arm_is_read_by_column_numbers(shared):
    file = shared / "recordings/ur5/Movement_No10_Standstill_ForceSensor_Fx/log_force_sensor.csv"
    result = read_force_table(file, BY_NUMBER)
    assert len(result.time) == 4675 and result.counts["cut_rows"] in (0, 1)
    np.testing.assert_array_equal(result.force[0], [-4.970965, 1.966628, -1.780504])
    np.testing.assert_array_equal(result.torque[0], [0.033873, 0.443460, -0.094441])
    times = [0, 0.006130 - 0.001323, 22.498314 - 0.001323]
    np.testing.assert_allclose(result.time[[0, 1, -1]], times, atol=1e-12)
    assert 200 < result.rate < 215 and result.counts["missing_samples"] < 10
    assert result.counts["repeated_rows"] == 352


def test_units_stand_in_the_log_or_in_the_option_and_never_differ(tmp_path):
    options = ForceLogOptions(columns={"t": "time", "fx": "F1", "fy": "F2", "fz": "F3"})
    header = "time (ms),F1 (kN),F2 (N),F3 (lbf)\n"
    file = table(tmp_path, "500,1,2,3.5", "510,1,2,3", header=header)
    result = read_force_table(file, options)
    np.testing.assert_allclose(result.force[0], [1000, 2, 3.5 * POUND], rtol=1e-12)
    np.testing.assert_allclose(result.time, [0, 0.01], atol=1e-12)
    assert np.isnan(result.torque).all()
    for other, words in (
        ({"force_unit": "N"}, "fx is in kN by the log and in N by the option"),
        ({"time_unit": "s"}, "ms by the log and in s"),
    ):
        assert (
            words in refusal(read_force_table, file, dataclasses.replace(options, **other)).message
        )
    numbers = ForceLogOptions({"fx": 2, "fy": 0, "fz": 1}, force_unit="lbf", rate=100.0)
    result = read_force_table(table(tmp_path, "1.5,2,3", "4.5,5,6", header=""), numbers)
    np.testing.assert_allclose(result.force, np.array([[3, 1.5, 2], [6, 4.5, 5]]) * POUND)
    np.testing.assert_allclose(result.time, [0, 0.01])


def test_doubled_rows_jitter_and_gaps_are_counted(tmp_path):
    times = [0.0, 0.01, 0.02, 0.02, 0.03, 0.0315, 0.04, 0.05, 0.09, 0.1, 0.11, 0.11]
    rows = [f"{t:.4f},{i},0,0,0,0,0" for i, t in enumerate(times)]
    rows[3] = rows[2]
    result = read_force_table(table(tmp_path, *rows), SI)
    assert result.force[:, 0].tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11]
    counts = {"doubled_rows": 1, "equal_times": 1, "uneven_steps": 4, "missing_samples": 3}
    assert counts.items() <= result.counts.items()


def without(axis: str) -> dict[str, str]:
    return {name: label for name, label in COLUMNS.items() if name != axis}


OPEN = [({f"{name}_unit": None}, f"{name}_unit") for name in ("force", "torque", "time")]
OPEN += [({"force_unit": "stone"}, "force_unit"), ({"columns": without("t")}, "rate")]
OPEN += [({"columns": without(axis)}, "columns") for axis in ("fz", "tz")]
OPEN += [({"columns": COLUMNS | more}, "columns") for more in ({"fx": "F9"}, {"fx": 7}, {"qx": 3})]


@pytest.mark.parametrize(("options", "key"), OPEN)
def test_what_nothing_settles_is_refused_by_the_name_of_its_option(tmp_path, options, key):
    file = table(tmp_path, "0.5,1,2,3,4,5,6", "0.6,1,2,3,4,5,7")
    read_force_table(file, SI)
    error = refusal(read_force_table, file, dataclasses.replace(SI, **options))
    assert error.evidence["key"] == f"dataset.force.log.{key}"


LOCALES = {"point": (",", "."), "comma": (";", ","), "mixed": (";", "."), "tabs": ("\t", ",")}
NUMBERS = [[i / 8, *(np.random.default_rng(i).normal(size=6).round(4)).tolist()] for i in range(6)]


def written(locale: str) -> list[str]:
    separator, decimal = LOCALES[locale]
    rows = [separator.join(repr(cell).replace(".", decimal) for cell in row) for row in NUMBERS]
    return [HEADER.replace(",", separator), *rows]


@settings(derandomize=True, max_examples=200, deadline=None)
@given(
    pages=st.lists(st.sampled_from(sorted(LOCALES)), min_size=6, max_size=6), headed=st.booleans()
)
def test_rows_of_several_locales_are_read_as_they_were_meant_or_refused(
    tmp_path_factory, pages, headed
):
    file = tmp_path_factory.getbasetemp() / "locales.csv"
    rows = [written(locale)[i + 1] for i, locale in enumerate(pages)]
    file.write_text("\n".join([*([written(pages[0])[0]] if headed else []), *rows, ""]))
    try:
        result = read_force_table(file, SI if headed else BY_NUMBER)
    except RecordingError:
        assert len(set(pages)) > 1
        return
    held = np.hstack([result.force, result.torque])
    np.testing.assert_array_equal(held, np.array(NUMBERS)[: len(held), 1:])
    assert len(held) + result.counts["cut_rows"] == 6
