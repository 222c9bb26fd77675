"""The example of each format runs as its README has it, and says what stands there."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

from pipeline import formats

FOLDER = Path(formats.__file__).parent
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = {
    folder: (FOLDER / folder / "README.md").read_text()
    for folder in ("joints", "motion", "force", "depth")
}
SECTIONS = [
    (folder, section.partition("\n")[0], section)
    for folder, page in PAGES.items()
    for section in page.split("\n## ")[1:]
]


@pytest.mark.parametrize(
    ("folder", "title", "section"), SECTIONS, ids=[f"{f}-{t}" for f, t, _ in SECTIONS]
)
def test_an_example_says_what_stands_there(folder, title, section, tmp_path, monkeypatch):
    *files, (language, place, code), (_, _, printed) = BLOCK.findall(section)
    assert (language, place) == ("python", "") and printed
    monkeypatch.chdir(tmp_path)
    for _, name, text in files:
        Path(name).write_text(text)
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(compile(code, f"{folder}: {title}", "exec"), {})
    assert said.getvalue().split() == printed.split()
