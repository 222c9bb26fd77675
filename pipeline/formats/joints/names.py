"""Recognition of the time, the measured and the commanded angles of a joint log, by words in the
names of its arrays and columns, and by their values where the words are ambiguous.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
JOINED = {"feed back": "feedback", "set point": "setpoint"}
TIME, COUNTERS, JOINT = (WORDS[kind] for kind in ("time", "counters", "joint"))
RECORDING = WORDS["recording"]
_QUANTITIES = WORDS["position"] | WORDS["velocity"] | COUNTERS
for _role in WORDS["measured"] | WORDS["commanded"]:
    if len(_role) > 2:
        for _quantity in _QUANTITIES:
            SHORT[_role + _quantity] = f"{_role} {_quantity}"
            SHORT[_quantity + _role] = f"{_role} {_quantity}"


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
    role = ""
    quantity = ""
    rest = []
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
        return _named_like_time(names)
    angles = {name: meaning(name) for name in names if meaning(name).is_angle}
    fits = [name for name in angles if angles[name].role == quantity]
    # a name of angles before a name of an unknown quantity: q_target before m_target
    fits = [name for name in fits if angles[name].quantity] or fits
    if quantity == "actual":  # position names without a role are measured angles
        for name, parsed in angles.items():
            if parsed.quantity and not parsed.role:
                fits.append(name)
    # the angle of a joint before the angle of its motor, which the gear divides
    fits = [name for name in fits if WORDS["motor"].isdisjoint(words_of(name))] or fits
    return [name for name in fits if not angles[name].rest] or fits


def _named_like_time(names: Iterable[str]) -> list[str]:
    """Return the ``names`` that are a word of time, else those whose last part is one."""
    whole = []
    last = []
    for name in names:
        parts = re.split(r"[./]", bare(name).lower())
        if re.sub("[^a-z]", "", "".join(parts)) in TIME:
            whole.append(name)
        if parts[-1] in TIME:
            last.append(name)
    return whole or last


def words_of(name: str) -> list[str]:
    """Return the words and numbers in a ``name``, in lower case and without its unit."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", bare(name))
    words = " ".join(re.findall(r"[A-Za-z]+|\d+", text)).lower()
    for parts, word in JOINED.items():
        words = words.replace(parts, word)
    return words.split()


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
    words = [words_of(name) for name in names]
    shared = set.intersection(*map(set, words)) if len(words) > 1 else set()
    parts = []
    for name_words in words:
        distinct = [word for word in name_words if word not in shared]
        parts.append("_".join(distinct))
    return parts


def states_joints(names: Sequence[str]) -> bool:
    """Return whether ``names`` differ in words, as elbow and wrist_1, not only in numbers."""
    parts = joint_parts(names)
    return len(names) > 1 and any(re.search("[a-z]", part) for part in parts)


def match_joints(names: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Return the one of ``joints`` that each of ``names`` (labels or joints' names) means, and the
    distinguishing part of a name that means none; empty if two names mean one joint.
    """
    by_part = {}
    for joint_part, joint in zip(joint_parts(joints), joints, strict=True):
        by_part[joint_part.replace("_", "")] = joint
    matched = []
    for name, joint_part in zip(names, joint_parts(names), strict=True):
        if name in joints:
            matched.append(name)
        else:
            similar = by_part.get(joint_part.replace("_", ""))
            matched.append(similar or _joint_inside(name, joints) or joint_part)
    return matched if len({*matched}) == len(matched) else []


def _joint_inside(name: str, joints: Sequence[str]) -> str:
    """Return the joint with the longest name inside ``name``; "" for none, or two."""
    words = _joined(words_of(name))
    sizes: dict[int, list[str]] = {}
    for joint in joints:
        core = [word for word in words_of(joint) if word not in JOINT]
        if _joined(core) in words:
            sizes.setdefault(len(core), []).append(joint)
    longest = sizes[max(sizes)] if sizes else [""]
    return longest[0] if len(longest) == 1 else ""


def _joined(words: Sequence[str]) -> str:
    return f"_{'_'.join(words)}_"


def columns_by_name(labels: Sequence[str]) -> dict[str, list[str]]:
    """Return group name → column labels: ``q_0, q_1`` form the group ``q`` in the order of the
    numbers; labels with a joint's name, such as ``actual_elbow``, form ``actual`` and ``target``,
    with the joints in one order.
    """
    groups = _groups_by_number(labels)
    roles = _roles_by_joint(labels, groups)
    joints = [*roles.get("actual", roles.get("target", {}))]
    if not joints or any({*role} != {*joints} for role in roles.values()):
        return groups
    used = {label for role in roles.values() for label in role.values()}
    groups = {name: group for name, group in groups.items() if used.isdisjoint(group)}
    for role, labels_by_joint in roles.items():
        groups[role] = [labels_by_joint[joint] for joint in joints]

    unnamed: dict[str, dict[str, str]] = {}  # same joints without a role
    for label in labels:
        words = _joined(words_of(label))
        for joint in joints:
            if label not in used and f"_{joint}_" in words:
                stem = words.replace(f"_{joint}_", "_*_")
                unnamed.setdefault(stem, {})[joint] = label
    for stem, labels_by_joint in unnamed.items():
        if len(labels_by_joint) == len(joints):
            groups[stem] = [labels_by_joint[joint] for joint in joints]
    return groups


def _groups_by_number(labels: Sequence[str]) -> dict[str, list[str]]:
    """Return the text around a joint's number → labels in the order of the numbers."""
    numbered: dict[str, dict[int, str]] = {}
    for label in labels:
        parts = re.fullmatch(r"(.*?)[\s_./\[(]*(\d+)[\])]?(\D*)", bare(label))
        if parts and meaning(label).number is not None:
            name = parts[1] + parts[3]
            if name:
                numbered.setdefault(name, {})[int(parts[2])] = label
    return {
        name: [group[number] for number in sorted(group)]
        for name, group in numbered.items()
    }


def _roles_by_joint(
    labels: Sequence[str],
    groups: Iterable[str],
) -> dict[str, dict[str, str]]:
    """Return role → joint's name → label, for roles that none of the ``groups`` has."""
    plain = set()
    for parsed in map(meaning, groups):
        if parsed.is_angle and not parsed.rest and (parsed.role or parsed.quantity):
            plain.add(parsed.role or "actual")
    worded: dict[str, list[str]] = {}
    for label in labels:
        parsed = meaning(label)
        role = parsed.role or ("actual" if parsed.quantity == "position" else "")
        named = parsed.rest and parsed.rest[-1] not in {*"xyzw"}
        if role and role not in plain and named and parsed.is_angle:
            worded.setdefault(role, []).append(label)
    roles = {}
    for role, group in worded.items():
        different = len({meaning(label).rest for label in group}) > 1
        if different and any(meaning(label).number is None for label in group):
            roles[role] = dict(zip(joint_parts(group), group, strict=True))
    return roles


def other_content(labels: Sequence[str], units: Sequence[str | None]) -> str | None:
    """Return the content of a table without joints, by the ``labels`` and ``units`` of its columns:
    poses of a body, an inertial sensor or positions of a point; None for unknown content.
    """
    # label without its axis letter → axis letter → column
    axes: dict[str, dict[str, int]] = {}
    for column, label in enumerate(labels):
        plain = re.sub(r"\s*[\[(].*", "", label.lower())
        stem = re.sub(r"[wxyz]$", "", plain)
        axes.setdefault(stem, {})[plain[len(stem) :]] = column
    vectors = {
        stem: letters for stem, letters in axes.items() if {*"xyz"} <= {*letters}
    }
    if any("w" in columns for columns in vectors.values()):
        return "poses of a body (position and quaternion)"
    stated = set()
    words = set()
    for stem, columns in vectors.items():
        stated.add(re.sub(r"[\s^*/·]", "", units[columns["x"]] or ""))
        words |= {*re.findall(r"[a-z]+", stem)}
    inertial = {"rads-1", "ms-2"} <= stated or {"rads", "ms2"} <= stated
    if inertial or (words & WORDS["turns"] and words & WORDS["accelerations"]):
        return "an inertial sensor (angular velocity and acceleration)"
    if len(vectors) == 1 and stated & {*UNITS["length"]}:
        return "positions of a point"
    return None


def paired_columns(labels: Sequence[str]) -> Iterator[tuple[list[str], list[str]]]:
    """Yield measured and commanded columns of groups whose names differ only in the role, such as
    the joints of each of two arms.
    """
    groups = columns_by_name(labels)
    for target in named_like("target", groups):
        command = meaning(target)
        for name in groups:
            parsed = meaning(name)
            alike = parsed.is_angle and parsed.rest == command.rest
            if alike and parsed.role != "target" and parsed.quantity == "position":
                yield groups[name], groups[target]


def signals_of(
    labels: Sequence[str],
    time: np.ndarray | None = None,
    load: Callable[[str], np.ndarray] | None = None,
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return signal → column labels of the joints, and signal → reason of a guess, by column names.
    Without a name for the command, the command is the only group whose values follow the measured
    angles, except derivatives and quaternions; ``load(label)`` returns (N,) at ``time`` (N,).
    Columns without groups may be the signals of a single joint, if the names of both are certain.
    """
    groups = columns_by_name(labels)
    if not any(len(group) > 1 for group in groups.values()):
        columns = {label: [label] for label in labels if label not in TIME}
        signals, guessed = signals_of_groups(columns, {}, time)
        if len(signals) > 1 and not guessed:
            return signals, {}
    few = len(groups) < 4
    groups = {name: group for name, group in groups.items() if few or len(group) > 1}
    values = {}
    if load:
        for name, group in groups.items():
            values[name] = np.column_stack([load(label) for label in group])
    return signals_of_groups(groups, values, time)


def signals_of_groups(
    groups: Mapping[str, list[str]],
    values: Mapping[str, np.ndarray],
    time: np.ndarray | None,
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return :func:`signals_of` groups of columns, and ``values`` (N, joints) per group."""
    angles = {*groups}  # quaternions are no angles
    angles -= {name for name, rows in values.items() if is_quaternion(rows)}
    actual = [name for name in named_like("actual", groups) if name in angles]
    target = [name for name in named_like("target", groups) if name in angles]
    target = [name for name in target if name not in actual]
    if len(target) == 1:
        beside = _measured_beside(target[0], actual or angles, groups, bool(actual))
        actual = beside if len(beside) == 1 else actual
    guessed: dict[str, str] = {}
    if not actual:
        actual = _numbered_joints(angles, groups)
        for name in actual:
            first = groups[name][0]
            guessed["actual"] = f"{first} … are joints by their names alone"
    if len(actual) == len(target) == 1:
        joints = len(groups[actual[0]])
        commands = len(groups[target[0]])
        if joints != commands:
            actual = actual if commands == 1 else []
            target = []

    measured = actual[0] if len(actual) == 1 else ""
    commanded = target[0] if len(target) == 1 else ""
    if measured in values:
        commanded, reason = _commanded(measured, target, groups, values, time)
        if reason:
            guessed["target"] = reason
    named = {"actual": measured, "target": commanded}
    return {signal: groups[name] for signal, name in named.items() if name}, guessed


def _measured_beside(
    target: str,
    candidates: Iterable[str],
    groups: Mapping[str, list[str]],
    named: bool,
) -> list[str]:
    """Return the ``candidates`` for the angles that ``target`` commands: groups of as many columns;
    unless they are ``named`` as measured, with the command's name without cmd: J1 and J1_cmd.
    """
    command = meaning(groups[target][0])
    beside = []
    for name in candidates:
        if name == target or len(groups[name]) != len(groups[target]):
            continue
        parsed = meaning(groups[name][0])
        plain = parsed.is_angle and not parsed.role and parsed.rest == command.rest
        if named or plain:
            beside.append(name)
    return beside


def _numbered_joints(
    angles: Iterable[str],
    groups: Mapping[str, list[str]],
) -> list[str]:
    """Return the only group that is named joint, axis or the like, if it has several columns."""
    joints = []
    for name in angles:
        if meaning(name) == PLAIN and not WORDS["numbered"].isdisjoint(words_of(name)):
            joints.append(name)
    several = [name for name in joints if len(groups[name]) > 1]
    return several if len(joints) == 1 else []


def _commanded(
    measured: str,
    named: Sequence[str],
    groups: Mapping[str, list[str]],
    values: Mapping[str, np.ndarray],
    time: np.ndarray | None,
) -> tuple[str, str]:
    """Return the group of the commands of the ``measured`` group, and the reason of a guess: the
    group ``named`` so, else the one that follows the measured angles; "" for none or several.
    """
    moved = values[measured]
    if time is None or len(time) != len(moved):
        time = np.arange(len(moved), dtype=float)
    alike = [n for n in groups if n != measured and values[n].shape == moved.shape]
    following = [name for name in alike if follows(values[name], moved)]
    speeds = []
    for name in alike:
        if name not in following and is_derivative(values[name], moved, time):
            speeds.append(name)
    clear = [name for name in named if name not in speeds]
    if named:
        return (clear[0], "") if len(clear) == 1 else ("", "")
    unclear = [name for name in possibly_speed(alike) if name not in speeds]
    if len(unclear) == 1:  # a group named qd that is not the derivative of the angles
        name = unclear[0]
        reason = f"{name} is no speed of {measured} by its values"
        return name, "" if name in following else reason
    if len(following) == 1:
        name = following[0]
        first = groups[name][0]
        return name, f"{first} … follow {groups[measured][0]} … by values"
    return "", ""


def possibly_speed(names: Iterable[str]) -> list[str]:
    """Return the names ``qd``, which mean a speed in most logs and a command in some."""
    return [name for name in names if re.sub(r"[^a-z]", "", bare(name).lower()) == "qd"]
