"""One row of a row-typed Motive take, and samples that are as sparse as its rows."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, nan
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import MISSING, NUMBER
from pipeline.formats.motion.take import WHOLE


class Row:
    """The cells of one row, taken from left to right; RecordingError with its line where they are
    not what should come.
    """

    def __init__(self, cells: list[str], file: Path, line: int) -> None:
        self.cells, self.file, self.line, self.place = cells, file, line, 1

    def take(self, count: int) -> list[str]:
        if self.place + count > len(self.cells):
            raise self.refusal(
                f"the row has {len(self.cells)} cells where its counts ask for "
                f"{self.place + count} or more: cut or damaged"
            )
        self.place += count
        return self.cells[self.place - count : self.place]

    def text(self) -> str:
        return self.take(1)[0]

    def count(self) -> int:
        cell = self.text()
        if not WHOLE.fullmatch(cell):
            raise self.refusal(
                f"cell {self.place} holds {cell!r} where a count or an ID should stand"
            )
        return int(cell)

    def numbers(self, count: int) -> list[float]:
        cells = self.take(count)
        for cell in cells:
            if cell not in MISSING and not NUMBER.fullmatch(cell):
                raise self.refusal(
                    f"there is {cell!r} before cell {self.place + 1}, not a finite number"
                )
        values = [nan if cell in MISSING else float(cell) for cell in cells]
        if inf in values or -inf in values:
            raise self.refusal(f"a number before cell {self.place + 1} is too large")
        return values

    def end(self) -> None:
        if any(self.cells[self.place :]):
            raise self.refusal(
                f"the row goes on after cell {self.place}, where its counts let it end"
            )

    def refusal(self, message: str) -> RecordingError:
        return RecordingError(message, file=self.file, line=self.line)


@dataclass
class Samples:
    """Samples by name: at which frames (counted from 0), and what; as sparse as the file, however
    many names come and go.
    """

    width: int
    rows: dict[str, tuple[list[int], list[list[float]]]] = field(default_factory=dict)

    def add(self, name: str, k: int, sample: list[float]) -> None:
        frames, samples = self.rows.setdefault(name, ([], []))
        frames.append(k)
        samples.append(sample)

    def has(self, name: str, k: int) -> bool:
        return name in self.rows and k in self.rows[name][0][-1:]

    def dense(self, frames: int) -> dict[str, np.ndarray]:
        """name → (frames, width), NaN where there is no sample."""
        return {name: self._filled(*rows, frames) for name, rows in self.rows.items()}

    def _filled(self, at: list[int], samples: list[list[float]], frames: int) -> np.ndarray:
        table = np.full((frames, self.width), nan)
        if at:
            table[at] = samples
        return table
