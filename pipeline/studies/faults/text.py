"""What happens to any log that is text: it is cut, rows are lost, doubled and swapped, a PC of
another culture writes it, a disk fails.
"""

from __future__ import annotations

import re

import numpy as np

ROW = re.compile(rb'[ \t"]*[-+]?[\d.]')  # how a row of numbers starts, and no header
CELL = re.compile(rb'[^,;\s"]+')
# what programs write for a number, or read as one
WORDS = (b"#N/A", b"1e999", b"0x1F", b"1_000", b"--", b"inf", b"1.2.3", b"1e", b"\xbd")


def lines_of(content: bytes) -> tuple[list[bytes], list[int]]:
    """The lines of ``content`` with their ends, and which of them are rows of numbers."""
    lines = content.splitlines(keepends=True)
    return lines, [i for i, line in enumerate(lines) if ROW.match(line)]


def truncated(content: bytes, share: float, rng: np.random.Generator) -> bytes:
    """Without the last ``share`` of its bytes: a copy that stopped, a full disk."""
    return content[: len(content) - int(np.ceil(share * len(content)))]


def dropped_rows(content: bytes, number: float, rng: np.random.Generator) -> bytes:
    """Without ``number`` of its rows, none of them the first or the last."""
    lines, rows = lines_of(content)
    lost = set(_some(rows[1:-1], number, rng))
    return b"".join(line for i, line in enumerate(lines) if i not in lost)


def doubled_rows(content: bytes, number: float, rng: np.random.Generator) -> bytes:
    """``number`` of its rows written twice in succession."""
    lines, rows = lines_of(content)
    again = set(_some(rows, number, rng))
    return b"".join(line * (1 + (i in again)) for i, line in enumerate(lines))


def swapped_rows(content: bytes, number: float, rng: np.random.Generator) -> bytes:
    """``number`` rows exchanged with the next one."""
    lines, rows = lines_of(content)
    for i in _some(rows[:-1:2], number, rng):
        lines[i], lines[i + 1] = lines[i + 1], lines[i]
    return b"".join(lines)


def decimal_commas(content: bytes, severity: float, rng: np.random.Generator) -> bytes:
    """Every decimal point of the rows a comma, the cells still separated as before."""
    lines, rows = lines_of(content)
    for i in rows:
        lines[i] = lines[i].replace(b".", b",")
    return b"".join(lines)


def words_for_numbers(content: bytes, number: float, rng: np.random.Generator) -> bytes:
    """``number`` cells of rows, none of them the first, hold a word that is no number but looks
    like one to some library.
    """
    for _ in range(int(number)):
        content = _with_cell(content, WORDS[rng.integers(len(WORDS))], rng)
    return content


def endless_number(content: bytes, digits: float, rng: np.random.Generator) -> bytes:
    """A cell of a row holds that many digits: a format that takes numbers of any length takes as
    much memory and time.
    """
    return _with_cell(content, b"7" * int(digits), rng)


def zeroed_block(content: bytes, number: float, rng: np.random.Generator) -> bytes:
    """``number`` bytes in a row are zero, as a file system leaves what it announced and never
    wrote.
    """
    start = int(rng.integers(max(1, len(content) - int(number))))
    return (
        content[:start]
        + bytes(min(int(number), len(content) - start))
        + content[start + int(number) :]
    )


def foreign_bytes(content: bytes, number: float, rng: np.random.Generator) -> bytes:
    """``number`` bytes that are no UTF-8 inserted among the letters of the header, as a name from a
    PC with another code page has them.
    """
    lines, rows = lines_of(content)
    size = sum(map(len, lines[: rows[0]]))
    letters = [match.end() for match in re.finditer(rb"[A-Za-z]", content[:size])]
    for place in sorted(_some(letters, number, rng), reverse=True):
        content = content[:place] + b"\xe9" + content[place:]
    return content


def header_number(key: bytes, content: bytes, factor: float, rng: np.random.Generator) -> bytes:
    """The number behind ``key`` in the header times ``factor``: a header that lies."""
    match = re.search(re.escape(key) + rb"[\s,=:]*([\d.]+)", content)
    stated = float(match[1]) * factor
    text = b"%d" % round(stated) if match[1].isdigit() else b"%.6f" % stated
    return content[: match.start(1)] + text + content[match.end(1) :]


def header_word(
    key: bytes, word: bytes, content: bytes, severity: float, rng: np.random.Generator
) -> bytes:
    """Every ``key`` in the lines above the rows replaced by ``word``."""
    lines, rows = lines_of(content)
    return b"".join(
        line.replace(key, word) if i < rows[0] else line for i, line in enumerate(lines)
    )


def _with_cell(content: bytes, word: bytes, rng: np.random.Generator) -> bytes:
    lines, rows = lines_of(content)
    i = rows[rng.integers(len(rows))]
    cells = list(CELL.finditer(lines[i]))
    cell = cells[rng.integers(1, len(cells))]
    lines[i] = lines[i][: cell.start()] + word + lines[i][cell.end() :]
    return b"".join(lines)


def _some(among: list[int], number: float, rng: np.random.Generator) -> list[int]:
    return [among[i] for i in rng.choice(len(among), min(int(number), len(among)), replace=False)]
