"""What was found out about one recording: facts alone, and beside them what is open and what would
stop the analysis.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pipeline.core.errors import PipelineError
from pipeline.formats.format import Format

UNKNOWN, ROBOT, DATASHEET = "unknown", "robot", "datasheet"


@dataclass
class Finding:
    """A file, or a folder that is one recording (a sequence of frames, a bag); None and empty where
    it does not say.
    """

    file: Path
    format: str
    # what it holds: one of pipeline.formats.format.Kind, or of the three above
    kind: str = UNKNOWN
    option: str | None = None  # the name by which an option of the dataset chooses its reader
    version: str | None = None
    rate: float | None = None  # Hz
    duration: float | None = None  # s, from the first sample to the last
    units: dict[str, str] = field(default_factory=dict)  # quantity → unit as the file states it
    bodies: list[str] = field(default_factory=list)
    markers: list[str] = field(default_factory=list)
    gaps: dict[str, int] = field(default_factory=dict)  # what is missing, repeated or cut, counted
    facts: dict[str, object] = field(default_factory=dict)  # what else is known, by name
    files: list[Path] = field(default_factory=list)  # the frames of a sequence
    # question that the file does not settle, option that does
    open: list[tuple[str, str]] = field(default_factory=list)
    stops: list[str] = field(default_factory=list)  # why the analysis would refuse it

    @classmethod
    def read_by(cls, form: Format, file: Path) -> Finding:
        """A recording of the format ``form``, of which nothing else is known yet."""
        return cls(file, form.name, form.kind, form.option)

    def refused(self, error: PipelineError) -> Finding:
        """With what a reader refused: a question where it names the option that settles it, else
        what stops the analysis.
        """
        option = str(error.evidence.get("key", ""))
        if option.startswith("dataset."):
            self.open.append((error.message, option))
        else:
            where = ", ".join(
                f"{name} {value}"
                for name, value in error.evidence.items()
                if name not in ("file", "key")
            )
            self.stops.append(f"{error.message} [{where}]" if where else error.message)
        return self

    def plain(self) -> dict[str, object]:
        """As keys and values for a program."""
        values = asdict(self) | {"file": shown(self.file)}
        del values["files"]  # thousands of frames
        return values | {
            "open": [{"question": question, "option": option} for question, option in self.open]
        }


def shown(path: Path) -> str:
    """``path`` as text that can be printed, also where its name is no UTF-8."""
    return os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace")


def counted(counts: dict[str, int], *names: str) -> dict[str, int]:
    """Those of the ``counts`` that have one of the ``names`` and are not zero."""
    return {name: counts[name] for name in names if counts.get(name)}
