"""What is suggested for a value that no file states: what the recordings, the robot and the other
values make likely.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.core.options.instruments import TimeUnit
from pipeline.formats.format import Kind
from pipeline.formats.units import TIME_UNITS
from pipeline.recordings.movement import MOST_TURNS
from pipeline.tools.check.values import get_filled
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.layout import Layout
from pipeline.tools.inspect.robot import urdf
from pipeline.tools.new_dataset.motion_choice import KEYS
from pipeline.tools.new_dataset.yaml_text import several, text_of

RATES = 5.0, 5000.0  # 1/s, between which controllers log


@dataclass(frozen=True)
class Suggestions:
    """What is suggested beside the recordings of ``layout`` in ``folder``."""

    layout: Layout
    folder: Path

    def of(self, key: str, values: Mapping[str, Any]) -> str | None:
        """The suggestion, as YAML has it, for ``key`` beside the other ``values`` of the dataset;
        None where nothing is known.
        """
        if key == "about.licence":
            return self._licence()
        if key in ("robot.joints", "robot.tool", "joint_log.joints"):
            return self._arm(key, values)
        if key == "motion.rate":
            return self._rate(values)
        if key == "motion.pose_noise":
            return self._noise()
        if key.startswith("joint_log.") and key not in KEYS:
            return self._log(key.removeprefix("joint_log."))
        return None

    def remark(self, key: str, values: Mapping[str, Any]) -> str | None:
        """What is known for the ``key``, in words: what is suggested, or what there is to choose
        from.
        """
        if suggested := self.of(key, values):
            return f"suggested is {suggested}"
        tips = [text_of(arm["tip"]) for arm in self._arms(values)] if key == "robot.tool" else []
        return f"one of {', '.join(tips)}" if tips else None

    def _licence(self) -> str | None:
        """The first line of a file of the name."""
        names = ("licence", "license", "copying")
        for file in sorted(self.folder.iterdir()):
            if file.is_file() and file.name.lower().startswith(names):
                lines = file.read_text(errors="replace").split("\n")[:20]
                stated = [" ".join(line.split()) for line in lines if line.strip()]
                return text_of(", ".join(stated[:2])) if stated else None
        return None

    def _arms(self, values: Mapping[str, Any]) -> list[dict[str, Any]]:
        """The arms in space of the URDF; none for a planar one."""
        file = get_filled(values, "robot.urdf")
        if not file or get_filled(values, "robot.plane"):
            return []
        try:
            return urdf(Path(file)).facts["arms"]
        except PipelineError:
            return []

    def _arm(self, key: str, values: Mapping[str, Any]) -> str | None:
        """The joints, or the last link, where the URDF leaves no choice."""
        arms = self._arms(values)
        joints = {tuple(arm["joints"]) for arm in arms}
        if key == "robot.tool" or len(joints) != 1:
            return text_of(arms[0]["tip"]) if key == "robot.tool" and len(arms) == 1 else None
        (names,) = joints
        logged = {
            finding.facts["joints"] for finding in self._movements() if "joints" in finding.facts
        }
        one = [finding.facts["signals"] for finding in self._tables() if "signals" in finding.facts]
        logged |= {len(columns) for signals in one for columns in signals.values()}
        tables = [finding for finding in self._tables() if "signals" not in finding.facts]
        logged |= {finding.facts["columns"] - 1 for finding in tables}
        fits = key == "robot.joints" or logged <= {len(names)}
        return f"[{several(list(names))}]" if fits else None

    def _rate(self, values: Mapping[str, Any]) -> str | None:
        """As it was meant, of the logs of the movements."""
        rates = {finding.rate for finding in self._movements() if finding.rate}
        unit = get_filled(values, "joint_log.time_unit")
        if unit:
            rates |= {1 / (step * TIME_UNITS[unit]) for step in self._steps()}
        meant = {f"{rate:.4g}" for rate in rates}
        return meant.pop() if len(meant) == 1 else None

    def _noise(self) -> str | None:
        """The greatest of what high differences of the measured angles show, in rad."""
        noise = [log.facts["noise"] for log in self._movements() if "noise" in log.facts]
        return f"{max(noise):.1e}" if noise else None

    def _log(self, key: str) -> str | None:
        if key == "movements":
            return self._pattern()
        if key == "time_unit":
            if asked := agreement(self._named(), key):
                return asked
            fitting = [
                unit
                for unit in TimeUnit
                if all(
                    RATES[0] <= 1 / (step * TIME_UNITS[unit]) <= RATES[1] for step in self._steps()
                )
            ]
            return str(fitting[0]) if len(fitting) == 1 and self._steps() else None
        if key == "angle_unit" and not agreement(self._named(), key):
            greatest = [table.facts.get("greatest") for table in self._tables()]
            beyond = [value for value in greatest if value and value > MOST_TURNS * 2 * np.pi]
            return ("deg" if beyond else "rad") if any(greatest) else None
        return agreement(self._named(), key)

    def _pattern(self) -> str | None:
        """One pattern of all groups of movements that matches nothing else of their sort."""
        paths = [path for group in self.layout.movements for path in group.takes]
        pattern = shared_pattern([path.relative_to(self.folder).as_posix() for path in paths])
        folders = paths[0].is_dir()
        matched = {path for path in self.folder.glob(pattern) if path.is_dir() == folders}
        return text_of(pattern) if matched == {*paths} else None

    def _named(self) -> dict[str, Finding]:
        """The logs by their movements."""
        named: dict[str, Finding] = {}
        for group in self.layout.movements:
            for name, finding in group.named.items():
                tables = finding.facts.get("tables")
                for one in tables.values() if tables else [finding]:
                    if not tables or "settings" in one.facts:
                        named[name] = one
        return named

    def _movements(self) -> list[Finding]:
        return [one for group in self.layout.movements for one in group.takes.values()]

    def _tables(self) -> list[Finding]:
        return [
            table
            for movement in self._movements()
            for table in movement.facts.get("tables", {"": movement}).values()
            if table.kind == Kind.TABLE
        ]

    def _steps(self) -> set[float]:
        steps = [table.facts.get("step_of_column_0") for table in self._tables()]
        return {step for step in steps if step}


def shared_pattern(names: Sequence[str]) -> str:
    """The names as one pattern: of the parts between underscores those that all have, and a star
    for what differs; all that follows where nothing of a part is shared.
    """
    parts = []
    for alike in zip(*(name.split("_") for name in names), strict=False):
        beginning = "".join(letters[0] for letters in takewhile(_same, zip(*alike, strict=False)))
        parts.append(beginning if len({*alike}) == 1 else f"{beginning}*")
        if not beginning:
            return "_".join(parts)
    longer = len({name.count("_") for name in names}) > 1
    return "_".join(parts) + ("*" if longer else "")


def _same(letters: tuple[str, ...]) -> bool:
    return len({*letters}) == 1


def agreement(movements: Mapping[str, Finding], key: str) -> str | None:
    """The setting ``key`` that the angles of the ``movements`` suggest, or that of each movement
    where they differ.
    """
    suggested = {
        name: finding.facts["settings"][key]
        for name, finding in movements.items()
        if key in finding.facts.get("settings", {})
    }
    if len(set(suggested.values())) > 1:
        return f"{{{', '.join(f'{text_of(name)}: {value}' for name, value in suggested.items())}}}"
    return next(iter(suggested.values()), None)
