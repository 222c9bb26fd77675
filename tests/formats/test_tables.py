"""Tables of numbers as programs write them, with settings, words, gaps, remarks and other contents:
read with what is missing filled or left out, and counted.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from written_logs import seen

from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.tools.inspect.command import inspect

TIME = np.arange(60) / 125
Q = np.stack([np.sin(3 * TIME), 0.2 + 0.5 * TIME**2], axis=1)
ROWS = np.column_stack([TIME, Q + 1e-4, Q]).round(6)
LABELS = ["time", "q_0", "q_1", "q_target_0", "q_target_1"]
SIGNALS = {"actual": ["q_0", "q_1"], "target": ["q_target_0", "q_target_1"]}


def table(*above: str, mark: str = ",", decimal: str = ".") -> str:
    """The rows and their labels under the lines ``above``."""
    rows = [
        mark.join(f"{cell:.6f}" for cell in row).replace(".", decimal)
        for row in ROWS.tolist()
    ]
    return "\n".join([*above, mark.join(LABELS), *rows, ""])


def beside(column: str, at: int, cell: str) -> str:
    """The table with another ``column`` whose cells hold ``cell``, %d being the row."""
    lines = [line.split(",") for line in table().splitlines()]
    for number, cells in enumerate(lines):
        cells.insert(at, column if number == 0 else cell.replace("%d", str(number)))
    return "\n".join([*map(",".join, lines), ""])


TABLES = {
    "plain": (table(), {}),
    "settings": (table("Sensor,Rokubi", "Sampling rate,125"), {}),
    "settings, semicolons and decimal commas": (
        table("Rate;125", mark=";", decimal=","),
        {},
    ),
    "settings, tabs": (table("Rate\t125", "Operator\tA. B.", mark="\t"), {}),
    "separator of Excel": (table("sep=;", mark=";", decimal=","), {}),
    "blanks": (table(mark=" "), {}),
    "comment": (table("# recorded on Monday", mark=" "), {}),
    "title, padded": (table("Arm test of 5 March,,,,"), {}),
    "byte-order mark and CRLF": (
        "\ufeff" + table("Rate,125").replace("\n", "\r\n"),
        {},
    ),
    "empty last column": (beside("note", 5, ""), {"note": "nothing"}),
    "words": (beside("mode", 1, "IDLE"), {"mode": "words"}),
    "quoted words with commas": (beside("mode", 1, '"a, b"'), {"mode": "words"}),
    "dates": (beside("clock", 1, "2024-03-05 10:15:%d.5"), {"clock": "dates or times"}),
    "another quantity": (beside("actual_main_voltage", 2, "48.%d"), {}),
    "numbers of the rows": (beside("", 0, "%d"), {}),
    "a unit beside the time": (beside("row (ms)", 0, "%d"), {}),
    "a header beyond 16 KiB": (beside("x" * 30_000, 5, "1.5"), {}),
    "footer": (table() + "\nSummary: 60 rows\nEnd\n", {}),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_recognised_labelled_and_read_whatever_is_above_and_beside_its_numbers(
    tmp_path,
    name,
):
    text, left_out = TABLES[name]
    (tmp_path / "run.csv").write_bytes(text.encode())
    (finding,) = inspect(tmp_path / "run.csv")
    assert (finding.format, finding.stops) == ("table of numbers", [])
    assert finding.facts["signals"] == SIGNALS and finding.facts["time"] == "time"
    assert (finding.facts["step_of_time"], finding.suggested["time_unit"]) == (
        0.008,
        "s",
    )
    assert finding.facts.get("columns_without_numbers", {}) == left_out
    log = read_joint_table(
        tmp_path / "run.csv",
        LogOptions("time", joints=2, signals=SIGNALS),
    )
    assert_allclose(log.time, TIME, atol=1e-6)
    assert_allclose(log.signals["target"], Q, atol=1e-6)
    assert (log.counts["cut_rows"] > 0) == (name == "footer")


def lost(*cells: tuple[int, int, str]) -> str:
    """The table with (row, column, text) in place of numbers."""
    lines = [line.split(",") for line in table().splitlines()]
    for row, column, text in cells:
        lines[row + 1][column] = text
    return "\n".join([*map(",".join, lines), ""])


def labview(text: str, ends: str = "\t") -> str:
    """The table as LabVIEW writes it, a segment with its header."""
    section = "Channels\t4\nY_Unit_Label" + 4 * "\trad" + "\nX0" + 4 * "\t0.0"
    section += "\n***End_of_Header***\t\n"
    first, *rows = text.replace(",", "\t").replace("time", "X_Value").splitlines()
    lines = [f"{first}\tComment", *(row + ends for row in rows)]
    return section + "\n".join([*lines, ""])


LABVIEW = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\t\n\t\n"
MERGED = lost(*((k, j, "") for k in range(60) for j in ((1, 2) if k % 2 else (3, 4))))
EACH = lost(*((k, j + k % 2, "") for k in range(60) for j in (1, 3)))
LATE = [(k, j, "%s") for k in range(5) for j in range(1, 5)]
HALVES = table().split("\n0.240000")
HALVES[1] = f"\n0.240000{HALVES[1]}"
MENDED = {  # name: content, rows that are read, counts, words of inspect
    "merged of two sources": (
        MERGED, slice(2, 60, 2), {"interpolated_cells": 58, "incomplete_end_rows": 1,
                                  "rows_without_measured_angle": 30}, "120 missing cells"),
    "merged of each joint": (
        EACH, slice(1, 59), {"interpolated_cells": 116, "incomplete_end_rows": 2}, "120 missing"),
    "one lost cell": (lost((9, 2, "")), slice(60), {"interpolated_cells": 1}, "1 missing cells"),
    **{f"rows of {word} before the start": (
        lost(*LATE) .replace("%s", word), slice(5, 60), {"rows_without_numbers": 5}, "20 missing")
       for word in ("None", "null", "NaN", "N/A")},
    "rows of None, times too": (
        lost(*LATE, *((k, 0, "None") for k in range(5))).replace("%s", "None"), slice(5, 60),
        {"rows_without_numbers": 5}, "5 rows without numbers"),
    "one None": (lost((9, 2, "None")), slice(60), {"interpolated_cells": 1}, "1 missing cells"),
    "remarks among the rows": (
        table().replace("\n0.240", "\n# push\n0.240"), slice(60), {"remark_rows": 1}, ""),
    "labels again": (
        f"\n\ufeff{','.join(LABELS)}".join(HALVES), slice(60), {"remark_rows": 1}, ""),
    "LabVIEW, empty comments": (LABVIEW + labview(table()), slice(60), {}, "of LabVIEW (LVM)"),
    "LabVIEW, no cell of comments": (LABVIEW + labview(table(), ""), slice(60), {}, "unit s, rad"),
    "LabVIEW, one comment": (
        LABVIEW + labview(table(), "").replace("\n0.016", "\tpush\n0.016"), slice(60), {},
        "columns without numbers Comment (nothing)"),
    "LabVIEW, two segments": (
        LABVIEW + labview(HALVES[0]) + labview(",".join(LABELS) + HALVES[1]),
        slice(60), {"remark_rows": 5}, "rows 60"),
    "UTF-16 without its mark": (table().encode("utf-16-le"), slice(60), {}, "table of numbers"),
    "UTF-16 of Windows": (table(mark="\t").encode("utf-16"), slice(60), {}, "table of numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", MENDED)
def test_what_a_table_lacks_or_repeats_is_filled_or_left_out_and_counted(
    tmp_path,
    name,
):
    content, rows, counts, words = MENDED[name]
    file = tmp_path / "run.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    said = seen(file)
    assert words in said and "!" not in said
    assert "signals actual (q_0, q_1), target (q_target_0, q_target_1)" in said
    assert all(
        f"{count} {key.replace('_', ' ')}" in said for key, count in counts.items()
    )
    log = read_joint_table(file, LogOptions(joints=2, signals=SIGNALS))
    assert_allclose(log.time, TIME[rows], atol=1e-6)
    assert_allclose(log.signals["target"], Q[rows], atol=1e-3)
    assert counts.items() <= log.counts.items()


AXES = "p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
RATES = ",".join(
    [
        *(f"w_RS_S_{a} [rad s^-1]" for a in "xyz"),
        *(f"a_RS_S_{a} [m s^-2]" for a in "xyz"),
    ],
)
CONTENTS = {  # labels: what inspect says of the table
    AXES: "of poses of a body (position and quaternion) 200 Hz; unit ns, m; columns timestamp",
    RATES: "of an inertial sensor (angular velocity and acceleration) 200 Hz; unit ns, rad s^-1",
    AXES.partition(",q_")[0]: "of positions of a point 200 Hz; unit ns, m;",
}


@pytest.mark.parametrize("labels", CONTENTS)
def test_a_table_of_no_joints_is_named_by_its_labels_and_units(tmp_path, labels):
    rows = (
        f"{1403636580838555648 + 5_000_000 * k}" + ",0.5" * labels.count("[")
        for k in range(9)
    )
    (tmp_path / "data.csv").write_text(
        "\n".join([f"#timestamp [ns],{labels}", *rows, ""]),
    )
    said = seen(tmp_path / "data.csv")
    assert (
        f"table of numbers {CONTENTS[labels]}" in said
        and "?" not in said
        and "!" not in said
    )


def test_a_motion_of_opensim_is_read_in_the_unit_that_it_states(tmp_path):
    head = "run\nnRows=60\nnColumns=5\ninDegrees=yes\nendheader"
    (tmp_path / "run.mot").write_text(table(head, mark="\t"))
    (finding,) = inspect(tmp_path / "run.mot")
    assert "OpenSim" in finding.version and finding.facts["signals"] == SIGNALS
    options = LogOptions("time", joints=2, signals=SIGNALS)
    with pytest.raises(RecordingError, match="in deg by the header") as refused:
        read_joint_table(tmp_path / "run.mot", options)
    assert refused.value.evidence["key"] == "dataset.joint_log.angle_unit"
