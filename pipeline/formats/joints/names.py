"""Recognition of the time, the measured and the commanded angles of a joint log, by words in the
names of its arrays and columns, and by their values where the words are ambiguous.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.delimited import UNITS, bare
from pipeline.formats.joints.values import follows, is_derivative, is_quaternion

_STATED = read_yaml(Path(__file__).with_suffix(".yaml"))
SHORT: dict[str, str] = _STATED.pop("short")  # word → the words that it joins
WORDS = {kind: frozenset(words.split()) for kind, words in _STATED.items()}
TIME, COUNTERS, JOINT = (WORDS[kind] for kind in ("time", "counters", "joint"))
_QUANTITIES = WORDS["position"] | WORDS["velocity"] | COUNTERS
for _mark in (word for word in WORDS["measured"] | WORDS["commanded"] if len(word) > 2):
    for _quantity in _QUANTITIES:
        _joined = _mark + _quantity, _quantity + _mark
        SHORT |= dict.fromkeys(_joined, f"{_mark} {_quantity}")


class Meaning(NamedTuple):
    """Role and quantity in the name of an array or a column."""

    role: str  # actual, target, or empty
    quantity: str  # position, velocity, other, or empty
    number: int | None  # number of the joint
    rest: tuple[str, ...]  # words that are neither a role nor a quantity

    @property
    def is_angle(self) -> bool:
        """True if the name can be the name of a joint angle."""
        placed = len(self.rest) == 1 and self.rest[0] in WORDS["places"]
        return self.quantity in ("position", "") and not placed


PLAIN = Meaning("", "", None, ())  # of joint, axis and the like


@cache
def meaning(name: str) -> Meaning:
    """Return the meaning of ``name``. Signs, capitals and numbers separate words; the last number
    is the joint's number; ``qd`` is a speed, ``q_d`` a command.
    """
    path, _, last = bare(name).rpartition(".")
    # samples.q is a q: a struct may have the name of its rows
    words = [word for word in words_of(path) if word not in COUNTERS] + words_of(last)
    places = [place for place, word in enumerate(words) if word.isdigit()]
    number = int(words.pop(places[-1])) if places else None
    if len(words) > 1:  # tq as the only word is a commanded q
        words = ["torque" if word == "tq" else word for word in words]
    role, quantity, rest = "", "", []
    for word in " ".join(SHORT.get(word, word) for word in words).split():
        if word in WORDS["measured"] or word in WORDS["state"]:
            role = role or ("actual" if word in WORDS["measured"] else "state")
        elif word in WORDS["commanded"] or (word == "d" and quantity):
            role = "target"
        elif word in WORDS["other"] or word in COUNTERS or quantity == "other":
            quantity = "other"
        elif word == "qd" or word in WORDS["velocity"]:
            quantity = "velocity"
        elif word in WORDS["position"]:
            quantity = quantity or "position"
        elif word not in JOINT:
            rest.append(word)
    return Meaning("actual" if role == "state" else role, quantity, number, tuple(rest))


def named_like(quantity: str, names: Iterable[str]) -> list[str]:
    """Return those ``names`` that mean the ``quantity``: time, actual or target (joint angles)."""
    if quantity == "time":
        plain = {n: re.split(r"[./]", bare(n).lower()) for n in names}
        alone = [
            n
            for n, parts in plain.items()
            if re.sub("[^a-z]", "", "".join(parts)) in TIME
        ]
        return alone or [n for n, parts in plain.items() if parts[-1] in TIME]
    angles = {name: parsed for name in names if (parsed := meaning(name)).is_angle}
    fits = [name for name, parsed in angles.items() if parsed.role == quantity]
    # a name of angles before a name of an unknown quantity: q_target before m_target
    fits = [name for name in fits if angles[name].quantity] or fits
    if quantity == "actual":  # position names without a role are measured angles
        fits += [
            name
            for name, parsed in angles.items()
            if not parsed.role and parsed.quantity
        ]
    # the angle of a joint before the angle of its motor, which the gear divides
    fits = [name for name in fits if WORDS["motor"].isdisjoint(words_of(name))] or fits
    return [name for name in fits if not angles[name].rest] or fits


def words_of(name: str) -> list[str]:
    """Return the words and numbers in a ``name``, in lower case and without its unit."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", bare(name))
    return [word.lower() for word in re.findall(r"[A-Za-z]+|\d+", text)]


def clocks_of(columns: Mapping[str, np.ndarray]) -> list[str]:
    """Return the names of the ``columns`` (N,) of times: with a name of a time, else with a word of
    time in the name and values that increase. Columns that count the rows are last choice. Equal
    times have one name; others are in the order of their evenness, since times of reception are
    less even.
    """
    named = named_like("time", columns)
    clocks = [name for name in named if not counts_rows(columns[name])]
    clocks = clocks or _worded_clocks(columns) or named
    times = [columns[name] for name in clocks]
    alike = [
        len(time) == len(times[0]) and np.allclose(time, times[0]) for time in times
    ]
    if all(alike):
        return clocks[:1]
    return sorted(clocks, key=lambda name: _unevenness(columns[name]))


def counts_rows(values: np.ndarray) -> bool:
    """Return whether ``values`` (N,) are whole numbers that grow by one a row."""
    steps = np.diff(values.astype(float))
    return bool(len(steps)) and bool((steps == 1).all()) and not float(values[0]) % 1


def _worded_clocks(columns: Mapping[str, np.ndarray]) -> list[str]:
    """Return the names of ``columns`` with a word of time that increase and count no rows."""
    clocks = []
    for name, values in columns.items():
        words = {*words_of(name.rpartition(".")[2])}
        if not TIME & words or COUNTERS & words or counts_rows(values):
            continue
        if (np.diff(values.astype(float)) > 0).all():
            clocks.append(name)
    return clocks


def _unevenness(time: np.ndarray) -> float:
    """Return the standard deviation of the steps of ``time`` (N,) over their mean."""
    steps = np.diff(time.astype(float))
    if not len(steps) or not steps.mean():
        return np.inf
    return float(np.std(steps) / abs(steps.mean()))


def is_names(name: str) -> bool:
    """Return whether an array or column of this ``name`` holds joints' names: joint_names0."""
    return not {"name", "names"}.isdisjoint(words_of(name)[-2:])


def joint_parts(names: Sequence[str]) -> list[str]:
    """Return the part of each of ``names`` that the others lack: a joint's name, or its number."""
    words = [*map(words_of, names)]
    shared = set.intersection(*map(set, words)) if len(words) > 1 else set()
    return ["_".join(word for word in each if word not in shared) for each in words]


def states_joints(names: Sequence[str]) -> bool:
    """Return whether ``names`` differ in words, as elbow and wrist_1, not only in numbers."""
    return len(names) > 1 and any(
        re.search("[a-z]", part) for part in joint_parts(names)
    )


def match_joints(names: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Return the one of ``joints`` that each of ``names`` (labels or joints' names) means, and the
    distinguishing part of a name that means none; empty if two names mean one joint.
    """
    own = {
        p.replace("_", ""): j for p, j in zip(joint_parts(joints), joints, strict=True)
    }
    matched = []
    for name, part in zip(names, joint_parts(names), strict=True):
        text = f"_{'_'.join(words_of(name))}_"
        cores = {
            joint: [w for w in words_of(joint) if w not in JOINT] for joint in joints
        }
        inside = {
            j: len(core) for j, core in cores.items() if f"_{'_'.join(core)}_" in text
        }
        longest = [
            joint for joint, size in inside.items() if size == max(inside.values())
        ]
        plain = part.replace("_", "")
        exact = (
            [own[plain]] if plain in own else longest if len(longest) == 1 else [part]
        )
        matched += [name] if name in joints else exact
    return matched if len({*matched}) == len(matched) else []


def columns_by_name(labels: Sequence[str]) -> dict[str, list[str]]:
    """Return group name → column labels: ``q_0, q_1`` form the group ``q`` in the order of the
    numbers; labels with a joint's name, such as ``actual_elbow``, form ``actual`` and ``target``,
    with the joints in one order.
    """
    numbered: dict[str, dict[int, str]] = {}
    worded: dict[str, list[str]] = {}
    for label in labels:
        parsed = meaning(label)
        parts = re.fullmatch(r"(.*?)[\s_./\[(]*(\d+)[\])]?(\D*)", bare(label))
        if parts and parsed.number is not None and parts[1] + parts[3]:
            numbered.setdefault(parts[1] + parts[3], {})[int(parts[2])] = label
        role = parsed.role or ("actual" if parsed.quantity == "position" else "")
        if (
            role
            and parsed.rest
            and parsed.is_angle
            and parsed.rest[-1] not in {*"xyzw"}
        ):
            worded.setdefault(role, []).append(label)
    groups = {
        name: [group[n] for n in sorted(group)] for name, group in numbered.items()
    }
    plain = [each for each in map(meaning, groups) if each.is_angle and not each.rest]
    plain = {each.role or "actual" for each in plain if each.role or each.quantity}
    named = {
        role: dict(zip(joint_parts(group), group, strict=True))
        for role, group in worded.items()
        if role not in plain
        and len({meaning(label).rest for label in group}) > 1
        and any(meaning(label).number is None for label in group)
    }
    if len({frozenset(parts) for parts in named.values()}) == 1:
        used = {label for parts in named.values() for label in parts.values()}
        groups = {name: group for name, group in groups.items() if not used & {*group}}
        order = [*named.get("actual", named.get("target", {}))]
        groups |= {
            role: [parts[part] for part in order] for role, parts in named.items()
        }
        others: dict[
            str, dict[str, str]
        ] = {}  # labels of the same joints without a role
        for label in (label for label in labels if label not in used):
            text = f"_{'_'.join(words_of(label))}_"
            for part in (part for part in order if f"_{part}_" in text):
                others.setdefault(text.replace(f"_{part}_", "_*_"), {})[part] = label
        for name, parts in others.items():
            groups |= (
                {name: [parts[part] for part in order]} if {*parts} == {*order} else {}
            )
    return groups


def other_content(labels: Sequence[str], units: Sequence[str | None]) -> str | None:
    """Return the content of a table without joints, by the ``labels`` and ``units`` of its columns:
    poses of a body, an inertial sensor or positions of a point; None for unknown content.
    """
    axes: dict[
        str, dict[str, int]
    ] = {}  # label without its axis letter → axis letter → column
    for column, label in enumerate(labels):
        plain = re.sub(r"\s*[\[(].*", "", label.lower())
        stem = re.sub(r"[wxyz]$", "", plain)
        axes.setdefault(stem, {})[plain[len(stem) :]] = column
    vectors = {
        stem: columns for stem, columns in axes.items() if {*"xyz"} <= {*columns}
    }
    if any("w" in columns for columns in vectors.values()):
        return "poses of a body (position and quaternion)"
    stated = {
        re.sub(r"[\s^*/·]", "", units[columns["x"]] or "")
        for columns in vectors.values()
    }
    words = {word for stem in vectors for word in re.findall(r"[a-z]+", stem)}
    inertial = {"rads-1", "ms-2"} <= stated or {"rads", "ms2"} <= stated
    if inertial or (words & WORDS["turns"] and words & WORDS["accelerations"]):
        return "an inertial sensor (angular velocity and acceleration)"
    return (
        "positions of a point"
        if len(vectors) == 1 and stated & {*UNITS["length"]}
        else None
    )


def signals_of(
    labels: Sequence[str],
    time: np.ndarray | None = None,
    load: Callable[[str], np.ndarray] | None = None,
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return signal → column labels of the joints, and signal → reason of a guess, by column names.
    Without a name for the command, the command is the only group whose values follow the measured
    angles, except derivatives and quaternions; ``load(label)`` returns (N,) at ``time`` (N,).
    """
    groups = columns_by_name(labels)
    groups = {
        n: group for n, group in groups.items() if len(group) > 1 or len(groups) < 4
    }
    values = (
        {n: np.column_stack([*map(load, g)]) for n, g in groups.items()} if load else {}
    )
    return signals_of_groups(groups, values, time)


def signals_of_groups(
    groups: Mapping[str, list[str]],
    values: Mapping[str, np.ndarray],
    time: np.ndarray | None,
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return :func:`signals_of` groups of columns, and ``values`` (N, joints) per group."""
    turns = {name for name, rows in values.items() if is_quaternion(rows)}
    fits = {*groups} - turns  # quaternions are no angles
    actual = [name for name in named_like("actual", groups) if name in fits]
    target = [
        name
        for name in named_like("target", groups)
        if name in fits and name not in actual
    ]
    if len(target) == 1:
        alike = [
            n
            for n in actual or fits - {*target}
            if len(groups[n]) == len(groups[target[0]])
        ]
        if (
            not actual
        ):  # measured angles may have the command's name without cmd: J1 and J1_cmd
            own = meaning(groups[target[0]][0]).rest
            meanings = {name: meaning(groups[name][0]) for name in alike}
            alike = [
                n
                for n, m in meanings.items()
                if m.is_angle and not m.role and m.rest == own
            ]
        actual = alike if len(alike) == 1 else actual
    guessed: dict[str, str] = {}
    if not actual:
        joints = [
            n
            for n in fits
            if {*words_of(n)} & WORDS["numbered"] and meaning(n) == PLAIN
        ]
        if len(joints) == 1 and len(groups[joints[0]]) > 1:
            actual = joints
            guessed["actual"] = (
                f"{groups[joints[0]][0]} … are joints by their names alone"
            )
    if len(actual) == len(target) == 1 and len(groups[actual[0]]) != len(
        groups[target[0]]
    ):
        actual, target = (actual if len(groups[target[0]]) == 1 else []), []
    signals = {"actual": groups[actual[0]]} if len(actual) == 1 else {}
    if len(actual) != 1 or actual[0] not in values:
        return signals | (
            {"target": groups[target[0]]} if len(target) == 1 else {}
        ), guessed
    moved = values[actual[0]]
    if time is None or len(time) != len(moved):
        time = np.arange(len(moved), dtype=float)
    alike = [n for n in groups if n != actual[0] and values[n].shape == moved.shape]
    following = [name for name in alike if follows(values[name], moved)]
    speeds = [
        name
        for name in alike
        if name not in following and is_derivative(values[name], moved, time)
    ]
    clear = [name for name in target if name not in speeds]
    if len(clear) == 1:
        signals["target"] = groups[clear[0]]
    elif (
        not target
        and len(weak := [n for n in possibly_speed(alike) if n not in speeds]) == 1
    ):
        # a group named qd that is not the derivative of the angles
        signals["target"] = groups[weak[0]]
        if weak[0] not in following:
            guessed["target"] = f"{weak[0]} is no speed of {actual[0]} by its values"
    elif not target and len(following) == 1:
        signals["target"] = groups[following[0]]
        guessed["target"] = (
            f"{groups[following[0]][0]} … follow {groups[actual[0]][0]} … by values"
        )
    return signals, guessed


def possibly_speed(names: Iterable[str]) -> list[str]:
    """Return the names ``qd``, which mean a speed in most logs and a command in some."""
    return [name for name in names if re.sub(r"[^a-z]", "", bare(name).lower()) == "qd"]
