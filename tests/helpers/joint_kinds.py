"""Kinds of joint logs and tables: see :func:`kinds.kind`."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from kinds import kind
from scipy.io import savemat

RATE = 125.0  # Hz
HOME = np.array([0.9, -1.1, 0.35, -1.4, 0.3, 0.5])  # rad, of UR below
AWAY = HOME + np.array([0.45, 0.25, -0.5, 0.15, 0.2, -0.25])
UR = ["elbow", "shoulder_lift", "shoulder_pan", "wrist_1", "wrist_2", "wrist_3"]
TRACKED = "command tracking error 0.0"  # of the motion


def motion(rows: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,) s, measured and commanded angles (N, 6) rad of a motion out and back."""
    k = np.arange(rows)
    share = (1 - np.cos(np.pi * np.clip(np.minimum(k - 60, 340 - k) / 90, 0, 1))) / 2
    target = HOME + share[:, None] * (AWAY - HOME)
    actual = np.vstack([target[:1], target[:-1]])
    return (
        k / RATE,
        actual + np.random.default_rng(3).normal(0, 1e-5, actual.shape),
        target,
    )


def cell_of(value: object) -> str:
    """A number with nine digits, an empty cell for NaN, or a word."""
    return (
        str(value)
        if isinstance(value, str)
        else ""
        if value != value
        else f"{value:.9g}"
    )


def write(
    file: Path, labels: Sequence[str], *columns: np.ndarray | Sequence[str]
) -> None:
    """Write a table of ``columns``, numbers (N,) or (N, n) or words, below the ``labels``."""
    cells = []
    for column in columns:
        rows = column if isinstance(column, np.ndarray) else np.array(column, object)
        cells += rows.reshape(len(rows), -1).T.tolist()
    lines = (
        [labels, *zip(*cells, strict=True)]
        if len(labels)
        else [*zip(*cells, strict=True)]
    )
    text = (",".join(map(cell_of, line)) for line in lines)
    file.write_text("\n".join(text) + "\n")


def numbered(*words: str, first: int = 0, count: int = 6) -> list[str]:
    """Labels ``word_number`` of all joints, one word after the other."""
    return [f"{word}_{j}" for word in words for j in range(first, first + count)]


def target_moments(*others: str) -> Callable[[Path], None]:
    """Files of measured and commanded angles beside files ``others`` of other quantities."""

    def make(folder: Path) -> None:
        time, actual, target = motion()
        rng = np.random.default_rng(1)
        write(folder / "log_q_actual.csv", [], time, actual)
        write(folder / "log_q_target.csv", [], time, target)
        for name in others:
            write(folder / f"{name}.csv", [], time, rng.normal(5, 1, target.shape))
        (folder / "start_time.csv").write_text("1386165279.27\n" * 300)

    return make


def log(
    labels: Sequence[str] = (),
    change: Callable[..., Sequence[object]] | None = None,
    name: str = "log.csv",
) -> Callable[[Path], None]:
    """A table of time, measured and commanded angles below ``labels`` (default by numbers), its
    columns changed by ``change(time, actual, target)``.
    """

    def make(folder: Path) -> None:
        columns = motion()
        head = labels or ["time", *numbered("actual_q", "target_q")]
        write(folder / name, head, *(change(*columns) if change else columns))

    return make


def names(*forms: str, first: Sequence[str] = ("time",)) -> list[str]:
    """Labels with the names of UR's joints in alphabetical order."""
    return [*first, *(form.format(joint) for form in forms for joint in UR)]


def damaged(value: float, *cells: tuple[int, int]) -> Callable[..., Sequence[object]]:
    """A change that adds ``value`` in ``cells`` (row, joint) of the measured angles."""

    def change(time, actual, target):
        for row, joint in cells:
            actual[row, joint] += value
        return time, actual, target

    return change


def cells(*words: str) -> Callable[..., Sequence[object]]:
    """A change that puts columns of constant ``words`` behind the time."""
    return lambda time, actual, target: (
        time,
        *([word] * len(time) for word in words),
        actual,
        target,
    )


def dates(time: np.ndarray, form: str) -> list[str]:
    return [form.format(t) for t in time]


def in_turn(time, actual, target):
    """Columns of two topics whose rows alternate."""
    gaps = np.full_like(actual, np.nan)
    stamps = np.stack([time, time + 0.003], axis=1).ravel()
    rows = [
        np.stack(pair, axis=1).reshape(-1, 6)
        for pair in ((actual, gaps), (gaps, target))
    ]
    return stamps, *rows


def text(name: str, content: str) -> Callable[[Path], None]:
    """A file of ``content``."""
    return lambda folder: (folder / name).write_text(content)


def arrays(name: str, **others: object) -> Callable[[Path], None]:
    """Arrays of joints × samples beside the times, and ``others``."""

    def make(folder: Path) -> None:
        time, actual, target = motion()
        write_arrays = (
            savemat
            if name.endswith("mat")
            else lambda file, data: np.savez(file, **data)
        )
        write_arrays(
            folder / name, {"time": time, "q": actual.T, "q_target": target.T} | others
        )

    return make


def counts(turn: int, zero: int) -> Callable[..., Sequence[object]]:
    """A change to counts of an encoder, ``turn`` per turn and ``zero`` at 0 rad."""
    return lambda time, *angles: (
        time,
        *(np.rint(zero + q * turn / (2 * np.pi)) for q in angles),
    )


def counted(time, *angles):
    """Columns of row numbers from 0 in place of the times, and of the angles."""
    return np.arange(float(len(time))), *angles


def counted_beside(time, *angles):
    """Columns of row numbers from 1, of the times and of the angles."""
    return np.arange(1.0, len(time) + 1), time, *angles


def on_its_side(*labels: str) -> Callable[[Path], None]:
    """A table of one row per signal, behind its label if there are ``labels``."""

    def make(folder: Path) -> None:
        time, actual, target = motion()
        rows = [time, *actual.T, *target.T]
        names = [[label] for label in labels] or [[] for _ in rows]
        lines = [
            ",".join([*name, *map("{:.6f}".format, row)])
            for name, row in zip(names, rows, strict=False)
        ]
        (folder / "log.csv").write_text("\n".join(lines) + "\n")

    return make


def thousands(point: str, decimal: str) -> Callable[[Path], None]:
    """A table in ms with a mark for thousands, ``point``, in the times from 1 s on."""

    def make(folder: Path) -> None:
        time, actual, target = motion()
        signs = str.maketrans(",.", point + decimal)
        lines = ["t [ms];" + ";".join(numbered("q", "q_cmd"))]
        for t, *cells in zip(1000 * time, *actual.T, *target.T, strict=True):
            numbers = [f"{t:,.3f}", *map("{:.6f}".format, cells)]
            lines.append(";".join(number.translate(signs) for number in numbers))
        (folder / "log.csv").write_text("\n".join(lines) + "\n")

    return make


def lists_in_cells(folder: Path) -> None:
    """A table of the times and of lists of the measured and commanded angles."""
    time, *signals = motion()
    lists = [[str(angles) for angles in signal.tolist()] for signal in signals]
    rows = pd.DataFrame({"time": time, "q": lists[0], "q_target": lists[1]})
    rows.to_csv(folder / "log.csv", index=False)


def struct_array(folder: Path) -> None:
    """A MATLAB file of one struct of time and angles per row."""
    time, actual, target = motion()
    fields = [("t", float), ("q", float, (6,)), ("q_target", float, (6,))]
    rows = np.zeros(len(time), dtype=fields)
    rows["t"], rows["q"], rows["q_target"] = time, actual, target
    savemat(folder / "log.mat", {"log": rows})


JOINTS, FIELD = [f"{joint}_joint" for joint in UR], "field.joint_names"
NAMED = "joint names elbow, shoulder_lift, shoulder_pan, wrist_1 … (6)"
CELLS = "joint names elbow_joint, shoulder_lift_joint, shoulder_pan_joint, wrist_1_joint … (6)"
OFFERED = "suggested is {actual: [J"
WHOLE = "whole numbers from "
PAIRED = ("log_q_actual.csv: table of numbers", TRACKED)
DEGREES = (
    "suggested is rad",
    "suggested is 0.017453292519943295",
    "command tracking error 0.0",
)
NO_CLOCK, NULL = "no column is a clock", "suggested is null: dataset.joint_log.time"
RADIANS = "the greatest is 1.4; suggested is rad"
KINDS = [
    kind("19", log(names("actual_{}_joint", "target_{}_joint"), name="run_1.csv"), NAMED, TRACKED,
        at="run_1.csv"),
    kind("19", log(names("{}.pos", "{}.cmd")), NAMED, TRACKED),
    kind("19", log([*names("q_act_{}"), *(f"q_des_{j}" for j in UR[::-1])], lambda time, actual,
        target: (time, actual, target[:, ::-1])), NAMED, TRACKED),
    kind("20", log(["%time", *(f"{FIELD}{j}" for j in range(6)),
        *numbered("field.actual.positions", "field.desired.positions")], cells(*JOINTS),
        name="run_1.csv"), CELLS, TRACKED, at="run_1.csv"),
    kind("20", log(["t", "name", *numbered("position", "goal_position")],
        cells(f"[{' '.join(JOINTS)}]")), CELLS, TRACKED),
    kind("20", log(["t", *(f"name[{j}]" for j in range(6)), *numbered("pos", "pos_cmd")], lambda t,
        *q: (t, *[[w] * 200 + [v] * 200 for w, v in zip(JOINTS, JOINTS[::-1], strict=True)], *q)),
        "names differ from the first row", "[line 202]", stops=True),
    kind("21", log([*names("/joint_states/{}_joint/position", first=("__time",)),
        *(f"/controller/state/desired/positions[{j}]" for j in range(6))], name="run_1.csv"),
        NAMED, TRACKED, at="run_1.csv"),
    kind("21", log(names("actual_{}") + numbered("command")), NAMED, TRACKED),
    kind("21", log(["time", *numbered("actual_q"), *numbered("target_q", count=5)], lambda time,
        actual, target: (time, actual, target[:, :5])),
        "the content of the columns is not stated"),
    kind("30", log(["timestamp", "cmd_num", *(f"J{j}" for j in range(1, 7))], lambda time, actual,
        target: (time, np.floor(9 * time), actual)), OFFERED, at="log.csv", never=("target",)),
    kind("30", log(["timestamp", "setpointIndex", *(f"J{j}" for j in range(1, 7))], lambda time,
        actual, target: (time, np.floor(9 * time), actual)), OFFERED, never=("target",)),
    kind("30", log(["t", "target_count", *numbered("q", "q_cmd")], lambda time, actual,
        target: (time, np.floor(9 * time), actual, target)), "target (q_cmd_0", TRACKED),
    kind("30", log(["timestamp", *(f"joint{j}" for j in range(1, 7))], lambda time, actual,
        target: (time, actual)), "suggested is {actual: [joint1, joint2"),
    kind("31", log([], lambda t, *q: (dates(t, "2023-05-06 07:08:{:09.6f}"), *q)), NO_CLOCK,
        "time holds dates or times", NULL, RADIANS, at="log.csv"),
    kind("31", log([], lambda t, *q: (dates(t, "07:08:{:06.3f}"), *q)), NO_CLOCK, NULL, RADIANS),
    kind("31", log([], lambda t, *q: (np.floor(9 * t), *q)), "the time does not increase",
        "[line 3]", stops=True),
    kind("31", log(["seq", *numbered("actual_q", "target_q")], lambda t, *q: (np.arange(400.0),
        *q)), NO_CLOCK, NULL, RADIANS),
    kind("31", log(numbered("actual_q", "target_q"), lambda t, *q: q), NO_CLOCK, NULL, RADIANS),
    kind("32", log(["time", *numbered("present_position", "goal_position", first=1)], counts(4096,
        2048)), WHOLE, "2π/4096 = 0.00153398 rad", TRACKED, at="log.csv",
        never=("suggested is deg",)),
    kind("32", log([], counts(1024, 512)), WHOLE, "2π/1024", TRACKED, never=("suggested is deg",)),
    kind("32", log([], counts(2**19, 2**18)), WHOLE, "2π/524288", TRACKED,
        never=("suggested is deg",)),
    kind("33", log([], damaged(-8.5e8, (350, 1))), "actual_q_1", "beyond four turns",
        "[line 352]", RADIANS, at="log.csv", stops=True),
    kind("33", log([], lambda t, q, target: (t, q, target + 1e10 * (t == t[200])[:, None])),
        "target_q_0 (target) is 1e+10 rad", "[line 202]", RADIANS, stops=True),
    kind("31", log(["date", "epoch_ms", *numbered("actual_q", "target_q")], lambda t, *q:
        (dates(t, "2023-05-06T07:08:{:09.6f}Z"), 1e5 + 1e3 * t, *q)), "125 Hz; unit ms",
        TRACKED, RADIANS, never=(NO_CLOCK, "they step by")),
    kind("31", log(["frame", *numbered("actual_q", "target_q")], lambda t, *q: (np.arange(400.0),
        *q)), "table of numbers", NO_CLOCK, NULL, RADIANS),
    kind("33", log([], damaged(2 * np.pi + 0.3, (150, 2))), "actual_q_2", "jumps by 6.583 rad",
        "[line 152]", RADIANS, stops=True),
    kind("33", log([], damaged(-2 * np.pi, (120, 0), (121, 0))), "actual_q_0", "jumps by -6.2",
        "[line 122]", RADIANS, stops=True),
    kind("33", log([], damaged(1e14, (0, 4))), "beyond four turns", "[line 2]",
        RADIANS, stops=True),
    kind("33", log([], damaged(2 * np.pi, *((row, 5) for row in range(230, 400)))), TRACKED,
        "1 unwrapped jumps", "suggested is rad"),
    kind("34", log([], lambda time, actual, target: (time, actual, np.degrees(target))), *DEGREES,
        at="log.csv"),
    kind("34", log([], lambda time, actual, target: (time, np.degrees(actual), target)),
        "suggested is deg", "suggested is 57.29577951308232", TRACKED),
    kind("34", log(["t [s]", *(f"q_{j} [rad]" for j in range(6)), *(f"q_cmd_{j} [deg]"
        for j in range(6))], lambda time, actual, target: (time, actual, np.degrees(target))),
        TRACKED, never=("? ",)),
    *(kind("edge", log([], damaged(2.0, *cells)), "actual_q_2", "a lost sign", f"[line {line}]",
        stops=True) for line, *cells in ((2, (0, 2)), (3, (1, 2)), (400, (398, 2)), (401, (399, 2)),
        (202, *((row, 2) for row in range(200, 400))))),
    kind("edge", log([], lambda time, *q: (time, *(np.where(time[:, None] < 0.1, 0.0, each)
        for each in q))), "actual_q_0", "before the first measurement", "[line 15]", stops=True),
    *(kind("held", log([], lambda time, *q, n=n: (np.arange(len(time) * n) / RATE / n,
        *(np.repeat(each, n, axis=0) for each in q))), words, stops=n > 1) for n, words in
        ((1, TRACKED), (2, "50% of the rows in motion repeat"), (3, "change 125."))),
    *(kind("units", log(["t [s]", *(form.format(j) for form in forms for j in range(6))],
        lambda time, *q: (time, *map(np.degrees, q))), words, stops=words != TRACKED,
        never=("suggested",)) for forms, words in ((("q_act_deg_{}", "q_des_deg_{}"), TRACKED),
        (("q_act_{} [º]", "q_des_{} [º]"), TRACKED), (("q_act_{} [mrad]", "q_des_{} [mrad]"),
        "is in mrad by the header: convert it to rad or deg"))),
    kind("units", log(["t [s]", *(f"{word}_{j} [{'rad' if j % 2 else 'deg'}]" for word in ("q_act",
        "q_des") for j in range(6))], lambda time, *q: (time, *(each * ([np.degrees(1), 1] * 3)
        for each in q))), TRACKED, never=("? ",)),
    kind("commas", lambda folder: (folder / "log.csv").write_text("\n".join(",".join(f'"{cell}"'
        for cell in row) for row in (["t", *numbered("q", "q_cmd")], *(map("{:.6f}".format, row)
        for row in np.column_stack(motion())))).replace(".", ",") + "\n"), TRACKED, "decimal ','"),
    *(kind("clocks", log([label, *numbered("q_act", "q_des")], change), *words, stops=stops,
        never=("suggested is s:",)) for label, change, stops, *words in (
        ("time", lambda t, *q: (dates(45356.4 + t / 86400, "{:.10f}"), *q), False, "in none of"),
        ("time", lambda t, *q: (t / 60, *q), False, "at a rate from 5 to 5000 Hz in none"),
        ("elapsed_ms", lambda t, *q: (1e3 * t, *q), False, TRACKED),
        ("t [s]", lambda *all: (np.delete(each, range(200, 230), axis=0) for each in all), False,
        "30 missing samples"),
        ("t [s]", lambda t, q, target: (t, q + 0.3 * np.eye(6)[2], target), True, "_2 misses"),
        ("sec,nanosec", lambda t, *q: (t // 1, np.rint(t % 1 * 1e9), *q), False, "125 Hz", TRACKED),
        ("recv_time [s],stamp_time [s]", lambda t, *q: (t + 4.9e-3 * (np.arange(400) % 2), t, *q),
        False, "125 Hz", TRACKED, "lag 8 ms"),
        ("t [s]", lambda t, *q: (t + 3600 * (t > 2), *q), False, "450000 missing", "lag 8 ms"),
        ("timestamp", lambda t, *q: (dates(1e7 * t, "1334766{:011.0f}"), *q), False, "in none"))),
    *(kind("text", lambda folder, old=old, new=new: (log()(folder), (file := folder / "log.csv")
        .write_text(file.read_text().replace(old, new) + "\0" * 99 * (old == ""))), TRACKED, words)
        for old, new, words in (("", "", "1 cut rows"), (",", ",\u00a0", "rows 400"))),
    kind("vectors", lambda folder: savemat(folder / "log.mat", {"time_ms": 1e3 * motion()[0],
        **dict(zip(numbered("q", "q_des"), np.column_stack(motion()[1:]).T, strict=True))}),
        "joints 6", "signals actual, target", TRACKED, never=("unit of the times",)),
    kind("episode", lambda folder: pd.DataFrame({"timestamp": motion()[0], "action": [*motion()[2]],
        "observation.state": [*motion()[1]]}).to_parquet(folder / "episode.parquet"),
        "action … follow observation.state … by values",
        "suggested is {actual: [observation.state], target: [action]}"),
    kind("44", log(["", *numbered("q_act", "q_des")], counted), NO_CLOCK, "row numbers",
        at="log.csv", never=("they step by", "Hz")),
    *(kind("44", log([name, *numbered("q_act", "q_des")], counted), NO_CLOCK,
        f"row numbers {name}", never=("they step by", "Hz"))
        for name in ("step", "seqno", "k", "Zeile", "Unnamed: 0")),
    kind("44", log(["n", "Uhr", *numbered("q_act", "q_des")], counted_beside), "clock Uhr",
        "row numbers n", TRACKED, never=(NO_CLOCK,)),
    kind("44", log(["t [ms]", *numbered("q_act", "q_des")], counted), "1000 Hz", "clock t [ms]",
        never=(NO_CLOCK,)),
    kind("46", on_its_side(), "13 rows and 400 columns", "transpose it", at="log.csv", stops=True)
        ._replace(says=("rows and", "columns lies on its side", "transpose it")),
    kind("46", on_its_side("t", *numbered("q", "q_cmd")), "on its side", stops=True),
    kind("50", thousands(".", ","), "1.000,000", "a point for thousands", "[line 127]",
        at="log.csv", stops=True),
    kind("50", thousands(",", "."), "1,000.000", "a comma for thousands", stops=True),
    kind("50", thousands("'", "."), "1'000.000", "a mark for thousands", stops=True),
    kind("lists", lists_in_cells, "the cells of q, q_target are lists", stops=True),
    kind("structs", struct_array, "samples 400; joints 6; clock log.t", TRACKED),
    kind("40", target_moments("log_i_target", "log_m_target"), *PAIRED, at=""),
    kind("40", target_moments("log_f_target", "log_tcp_speed"), *PAIRED, never=("one column",)),
    kind("40", target_moments("log_v_target", "log_qdd_target"), *PAIRED),
    kind("43", log([], in_turn), " rows without measured angle", "lag 5 ms", at="log.csv",
        never=("without numbers",)),
    kind("43", log([], lambda t, *q: in_turn(t, *q[::-1])), "400 rows without measured angle",
        never=("without numbers",)),
    *(kind("across", arrays(name, **others), "joints 6", "signals actual, target", TRACKED, words,
        never=("transpose", "None ()")) for name, others, words in (("log.npz", {}, "samples 400"),
        ("log.mat", {"None": np.array(["x"])}, "samples 400"), ("names.npz",
        {"joint_names": np.array(UR)}, NAMED))),
    *(kind("episode", log(["timestamp", *(f"observation.state.{j}{end}" for j in each),
        *(f"action.{j}{end}" for j in each)]), "follow ", TRACKED,
        never=("not stated: a log of joints",)) for each, end in ((UR, ".pos"), (range(6), ""))),
    *(kind("empty", text("log.csv", content), "no samples", stops=stops) for content,
        stops in (("time,Fx,Fy,Fz,Tx,Ty,Tz\n", False), ("t,Fx,Fy\ns,N,N\n", False),
        ("time [s];Fx [N];Fy [N];Fz [N]\n", False),
        ('"Force X (N)","Force Y (N)","Force Z (N)","Frequency = 100"\n', True),
        ("RDT Sample Rate: 100\nStatus (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz\n", True))),
]  # fmt: skip
