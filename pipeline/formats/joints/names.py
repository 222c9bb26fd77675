"""What the names of arrays and columns say of joint logs: which holds the time, which the measured
and which the commanded angles.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from pipeline.formats.labels import bare

# what is meant without an option, written without case and signs
NAMES = {
    "time": ("t", "time", "times", "timestamp", "timestamps", "stamp", "stamps"),
    "actual": (
        *("q", "qactual", "actualq", "qmeasured", "measuredq", "position", "positions"),
        *("actualpositions", "measuredpositions", "jointpositions", "angles", "jointangles"),
        *("actual", "measured", "jointstate", "jointstates"),
    ),
    "target": (
        *("qtarget", "targetq", "qdesired", "desiredq", "qd", "qcommanded", "commandedq", "qcmd"),
        *("targetpositions", "desiredpositions", "commandedpositions", "targetangles"),
        *("target", "commanded", "desired", "jointcommand", "jointcommands"),
        *("desiredjointstates", "commandedjointstates", "targetjointstates"),
    ),
}


def named_like(quantity: str, names: Iterable[str]) -> list[str]:
    """Those of the ``names`` that say they are the ``quantity``, one of NAMES."""
    return [name for name in names if re.sub(r"[^a-z0-9]", "", name.lower()) in NAMES[quantity]]


def columns_by_name(labels: Sequence[str]) -> dict[str, list[str]]:
    """The ``labels`` of columns by the name that they share before their number, each list in the
    order of the numbers, as ``q_0, q_1``; or before their first underscore where that says what
    they are, as ``actual_elbow, actual_wrist``.
    """
    numbered: dict[str, dict[int, str]] = {}
    worded: dict[str, list[str]] = {}
    for label in labels:
        parts = re.fullmatch(r"(.*?)[\s_.\[(]*(\d+)[\])]?", bare(label))
        word = label.partition("_")[0]
        if parts and parts[1]:
            numbered.setdefault(parts[1], {})[int(parts[2])] = label
        elif word != label and any(named_like(quantity, [word]) for quantity in NAMES):
            worded.setdefault(word, []).append(label)
    return {name: [held[n] for n in sorted(held)] for name, held in numbered.items()} | worded


def signals_of(labels: Sequence[str]) -> dict[str, list[str]]:
    """Signal → columns of the joints, of the signals that exactly one name among the ``labels``
    says it is.
    """
    columns = columns_by_name(labels)
    named = {signal: named_like(signal, columns) for signal in ("actual", "target")}
    return {signal: columns[names[0]] for signal, names in named.items() if len(names) == 1}
