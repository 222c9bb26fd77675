"""Tables of numbers as programs write them, with settings, words, gaps, remarks and other contents:
read with what is missing filled or left out, and counted.
"""

from collections.abc import Sequence

import numpy as np
import pytest
from case_tables import cases_beside
from numpy.testing import assert_allclose
from written_logs import seen

from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.tools.inspect.command import inspect

cases = cases_beside(__file__)
TIME = np.arange(60) / 125
Q = np.stack([np.sin(3 * TIME), 0.2 + 0.5 * TIME**2], axis=1)
ROWS = np.column_stack([TIME, Q + 1e-4, Q])
LABELS = ["time", "q_0", "q_1", "q_target_0", "q_target_1"]
SIGNALS = {"actual": ["q_0", "q_1"], "target": ["q_target_0", "q_target_1"]}
WIDE = {"beside": ["x" * 30_000, 5, "1.5"]}  # a header of more than 16 KiB


def table(
    *,
    above: Sequence[str] = (),
    mark: str = ",",
    decimal: str = ".",
    beside: Sequence | None = None,
    lost: Sequence[Sequence] = (),
    before: Sequence[str] = ("", ""),
    end: str = "\n",
    behind: str = "",
    encoding: str = "utf-8",
) -> bytes:
    """The rows and their labels under the lines ``above``.

    ``beside`` is the label of another column, its number, and its cells, in which %d is the row's
    number. ``lost`` has first row, end, step, columns and the text in place of their numbers.
    ``before`` is a place in the text and what is written before it.
    """
    lines = [LABELS.copy()]
    for row in ROWS.tolist():
        lines.append([f"{number:.6f}".replace(".", decimal) for number in row])
    for *rows, columns, text in lost:
        for row in range(*rows):
            for column in columns:
                lines[row + 1][column] = text
    if beside:
        label, column, cell = beside
        for number, cells in enumerate(lines):
            text = cell.replace("%d", str(number)) if number else label
            cells.insert(column, text)
    text = end.join([*above, *map(mark.join, lines), ""])
    place, remark = before
    if place:
        text = text.replace(place, remark + place, 1)
    return (text + behind).encode(encoding)


@cases("recognised", [WIDE, {}])
def test_a_table_is_recognised_labelled_and_read_whatever_is_above_and_beside_its_numbers(
    tmp_path,
    changes,
    left_out,
):
    file = tmp_path / "run.csv"
    file.write_bytes(table(**changes))

    (finding,) = inspect(file)
    log = read_joint_table(file, LogOptions("time", joints=2, signals=SIGNALS))

    assert (finding.format, finding.stops) == ("table of numbers", [])
    assert finding.facts["signals"] == SIGNALS and finding.facts["time"] == "time"
    assert finding.facts["step_of_time"] == 0.008
    assert finding.suggested["time_unit"] == "s"
    assert finding.facts.get("columns_without_numbers", {}) == left_out
    assert_allclose(log.time, TIME, atol=1e-6)
    assert_allclose(log.signals["target"], Q, atol=1e-6)
    assert (log.counts["cut_rows"] > 0) == ("behind" in changes)


def labview(rows: bytes, ends: str = "\t") -> str:
    """A segment of a LabVIEW file with its header, its rows behind the labels' row."""
    labels, *numbers = rows.decode().replace("time", "X_Value").splitlines()
    lines = ["Channels\t4"]
    lines.append("Y_Unit_Label\trad\trad\trad\trad")
    lines.append("X0\t0.0\t0.0\t0.0\t0.0")
    lines.append("***End_of_Header***\t")
    lines.append(f"{labels}\tComment")
    lines += [row + ends for row in numbers]
    return "\n".join([*lines, ""])


LABVIEW = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\t\n\t\n"
TABS = table(mark="\t")
NO_COMMENTS = labview(TABS, "")
LABELS_ROW, *TAB_ROWS = TABS.splitlines(keepends=True)
HALVES = [
    labview(b"".join([LABELS_ROW, *half])) for half in (TAB_ROWS[:30], TAB_ROWS[30:])
]
SEGMENTS = [  # text, remarks, words of inspect
    (labview(TABS), 0, "of LabVIEW (LVM)"),
    (NO_COMMENTS, 0, "unit s, rad"),
    (
        NO_COMMENTS.replace("\n0.016", "\tpush\n0.016"),
        0,
        "columns without numbers Comment (nothing)",
    ),
    ("".join(HALVES), 5, "rows 60"),
]


def require_rows(file, rows: slice, counts: dict, words: str) -> None:
    """Rows that are read, counted and shown by inspect with the ``words``."""
    said = seen(file)
    assert words in said and "!" not in said
    assert "signals actual (q_0, q_1), target (q_target_0, q_target_1)" in said
    for key, count in counts.items():
        assert f"{count} {key.replace('_', ' ')}" in said
    log = read_joint_table(file, LogOptions(joints=2, signals=SIGNALS))
    assert_allclose(log.time, TIME[rows], atol=1e-6)
    assert_allclose(log.signals["target"], Q[rows], atol=1e-3)
    assert counts.items() <= log.counts.items()


@cases("mended")
def test_what_a_table_lacks_or_repeats_is_filled_or_left_out_and_counted(
    tmp_path,
    changes,
    rows,
    counts,
    words,
):
    (tmp_path / "run.csv").write_bytes(table(**changes))
    require_rows(tmp_path / "run.csv", slice(*rows), counts, words)


@pytest.mark.parametrize(("text", "remarks", "words"), SEGMENTS)
def test_segments_and_comments_of_labview_are_read(tmp_path, text, remarks, words):
    (tmp_path / "run.csv").write_text(LABVIEW + text)
    counts = {"remark_rows": remarks} if remarks else {}
    require_rows(tmp_path / "run.csv", slice(60), counts, words)


@cases("contents")
def test_a_table_of_no_joints_is_named_by_its_labels_and_units(tmp_path, labels, words):
    lines = [f"#timestamp [ns],{labels}"]
    for k in range(9):
        stamp = 1403636580838555648 + 5_000_000 * k
        lines.append(f"{stamp}" + ",0.5" * labels.count("["))
    (tmp_path / "data.csv").write_text("\n".join([*lines, ""]))

    said = seen(tmp_path / "data.csv")

    assert f"table of numbers {words}" in said
    assert "?" not in said and "!" not in said


def test_a_motion_of_opensim_is_read_in_the_unit_that_it_states(tmp_path):
    file = tmp_path / "run.mot"
    header = ["run", "nRows=60", "nColumns=5", "inDegrees=yes", "endheader"]
    file.write_bytes(table(above=header, mark="\t"))
    (finding,) = inspect(file)
    assert "OpenSim" in finding.version and finding.facts["signals"] == SIGNALS

    options = LogOptions("time", joints=2, signals=SIGNALS)
    with pytest.raises(RecordingError, match="in deg by the header") as refused:
        read_joint_table(file, options)
    assert refused.value.evidence["key"] == "dataset.joint_log.angle_unit"
