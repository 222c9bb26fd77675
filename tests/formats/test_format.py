"""A format is one module: found by its place, read, inspected and proposed by what finds it; the
example of each runs as its README has it.
"""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
import sys
from pathlib import Path

import pytest
from motive_files import START, random_take

from pipeline import formats
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats import force, motion
from pipeline.formats.format import Head, Kind, formats_in, matching, recognised
from pipeline.formats.motion.motive import write_motive
from pipeline.recordings.motion_capture import read_take
from pipeline.tools.inspect.command import inspect
from pipeline.tools.inspect.kinds import DESCRIBE
from pipeline.tools.new_dataset.command import dataset_texts
from pipeline.tools.new_dataset.layout import layout

MODULE = '''"""Takes of one marker as a program of our own writes them: x, y, z in m at 10 Hz."""

import numpy as np

from pipeline.formats.format import Format, Kind, begins
from pipeline.formats.motion.take import TakeBuilder


def read_own(file, unit=None):
    positions = np.loadtxt(file, skiprows=1, ndmin=2)
    take = TakeBuilder("m", np.arange(len(positions)), 10.0, None, {})
    take.markers["M"] = positions
    return take.take(file.stem, "Own", {})


FORMAT = Format("Own", Kind.MOTION, read_own, begins(b"OWN"))
'''


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A take in a format whose module lies in a folder that was added to those of the package."""
    (tmp_path / "modules").mkdir()
    (tmp_path / "modules/own.py").write_text(MODULE)
    monkeypatch.setattr(motion, "__path__", [*motion.__path__, str(tmp_path / "modules")])
    formats_in.cache_clear()
    file = tmp_path / "takes/walk_1.own"
    file.parent.mkdir()
    file.write_text("OWN\n1 2 3\n4 5 6\n")
    yield file
    formats_in.cache_clear()
    sys.modules.pop("pipeline.formats.motion.own", None)


def test_a_module_that_is_added_is_read_by_the_stage_inspected_and_proposed(own):
    assert read_take(own, None).markers["M"].tolist() == [[1, 2, 3], [4, 5, 6]]
    (finding,) = inspect(own.parent)
    assert (finding.format, finding.kind, finding.rate) == ("Own", "motion", 10.0)
    sheet = dataset_texts("lab", layout([finding], own.parent), own.parent)[0]
    assert 'training: "walk_*.own"' in sheet or "training: walk_*.own" in sheet


def test_without_the_module_its_take_is_no_motion_and_refused_with_what_is_read(own, monkeypatch):
    monkeypatch.undo()
    formats_in.cache_clear()
    (finding,) = inspect(own)
    assert finding.format == "table of numbers"
    with pytest.raises(RecordingError, match="no take of motion capture in C3D or Motive CSV"):
        read_take(own, None)


def test_inspect_describes_every_kind_and_options_name_each_force_log_once():
    assert set(DESCRIBE) == set(Kind) == {form.kind for form in formats_in(formats)}
    options = [form.option for form in formats_in(force, Kind.FORCE)]
    assert sorted(options) == ["bag", "daqft", "netft", "table"]


def test_a_table_is_one_only_where_nothing_more_specific_begins_like_it(tmp_path):
    file = tmp_path / "take.csv"
    write_motive(file, random_take(50), start=START)
    (table,) = formats_in(formats, Kind.TABLE)
    assert table.recognises(Head.read(file)) and formats_in(formats)[-1] is table
    assert recognised(Head.read(file), formats_in(formats)).name == "Motive CSV"


@pytest.mark.parametrize("room", ["motion_capture", "force"])
def test_a_stage_of_one_instrument_loads_no_library_of_another(room):
    script = f"""
import sys
import pipeline.recordings.{room}
from pipeline import formats
from pipeline.formats.format import formats_in
from pipeline.formats import force, motion
formats_in({"force" if room == "force" else "motion"})
print([name for name in ("cv2", "PIL", "rosbags", "ezc3d") if name in sys.modules])
"""
    printed = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True)
    assert re.fullmatch(rb"\[\]\s*", printed.stdout)


def test_what_matches_comes_in_order(tmp_path):
    for name in ("b2.csv", "b10.csv", "a.csv", "c.txt"):
        (tmp_path / name).touch()
    found = [path.name for path in matching(tmp_path, "*.csv", key="k")]
    assert found == ["a.csv", "b10.csv", "b2.csv"]
    assert matching(tmp_path, "absent/*", key="k") == []


@pytest.mark.parametrize("pattern", ["/absolute/*.csv", ""])
def test_a_pattern_that_is_none_is_refused_with_its_key(tmp_path, pattern):
    with pytest.raises(ConfigError) as caught:
        matching(tmp_path, pattern, key="dataset.depth.frames")
    assert caught.value.evidence["key"] == "dataset.depth.frames"


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
