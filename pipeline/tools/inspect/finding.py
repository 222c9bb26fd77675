"""Account of one recording: facts that the file states, open questions with the option that
answers each, and reasons for which the stages would refuse the file.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pipeline.core.errors import PipelineError

UNKNOWN, ROBOT = "unknown", "robot"


@dataclass
class Finding:
    """A file, or a folder that is one recording (a sequence of frames, a bag); None and empty where
    the file does not say.
    """

    file: Path
    format: str = UNKNOWN
    kind: str = UNKNOWN  # one of pipeline.formats.format.Kind, or of the two above
    option: str | None = None  # the name by which an option of the dataset chooses its reader
    version: str | None = None
    rate: float | None = None  # Hz
    duration: float | None = None  # s, from the first sample to the last
    units: dict[str, str] = field(default_factory=dict)  # quantity → unit as the file states it
    bodies: list[str] = field(default_factory=list)
    markers: list[str] = field(default_factory=list)
    gaps: dict[str, int] = field(default_factory=dict)  # missing, repeated or repaired, counted
    facts: dict[str, object] = field(default_factory=dict)  # everything else, by name
    files: list[Path] = field(default_factory=list)  # frames of a sequence
    open: list[tuple[str, str]] = field(default_factory=list)  # question, option that answers it
    stops: list[str] = field(default_factory=list)  # reasons for which the stages would refuse it

    @property
    def suggested(self) -> dict[str, str]:
        """Suggested value by key of dataset.joint_log."""
        return self.facts.get("settings", {})

    @property
    def timed(self) -> bool:
        """True of a table whose first column increases."""
        return self.facts.get("increasing_columns", [])[:1] == [0]

    def count(self, counts: dict[str, int]) -> None:
        """Add the ``counts`` that are not zero."""
        self.gaps |= {name: number for name, number in counts.items() if number}

    def ask(self, question: str, option: str, value: str | None = None) -> None:
        """Add a ``question`` that ``option`` answers, with the ``value`` that is suggested."""
        if value is not None:
            self.facts.setdefault("settings", {})[option.rpartition(".")[2]] = value
            question += f"; suggested is {value}"
        self.open.append((question, option))

    def refused(self, error: PipelineError) -> Finding:
        """Add the refusal of a reader: a question where it names the option that settles it, else a
        stop.
        """
        option = str(error.evidence.get("key", ""))
        if option.startswith("dataset."):
            self.ask(error.message, option)
        else:
            left = {n: value for n, value in error.evidence.items() if n not in ("file", "key")}
            where = ", ".join(f"{name} {value}" for name, value in left.items())
            self.stops.append(f"{error.message} [{where}]" if where else error.message)
        return self

    def plain(self) -> dict[str, object]:
        """Return keys and values for a program, without the thousands of frames."""
        values = asdict(self) | {"file": shown(self.file)}
        del values["files"]
        return values | {"open": [{"question": q, "option": option} for q, option in self.open]}


def shown(path: Path) -> str:
    """Return ``path`` as text that can be printed, also where its name is not UTF-8."""
    return os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace")
