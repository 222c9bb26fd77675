"""What is committed: no place on one machine, no registry, no file too long to be read."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def project_files() -> list[Path]:
    """What git has or would take."""
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git repository")
    return [file for file in map(ROOT.joinpath, listed.stdout.splitlines()) if file.is_file()]


def test_no_file_names_a_place_on_one_machine():
    # the brackets keep this file from finding itself
    places = re.compile(rb"(?<![\w.])/(hom[e]|roo[t]|User[s]|wor[k]|tm[p]|op[t]|mn[t])/\w|[A-Z]:\\\\?User[s]")
    found = {str(file.relative_to(ROOT)): places.findall(file.read_bytes()) for file in project_files()}
    assert {file: hits for file, hits in found.items() if hits} == {}


def test_no_file_names_a_package_registry():
    hosts = re.compile(rb"pyp[i]\.org|pythonhoste[d]\.|anacond[a]\.org|artifactor[y]|index-ur[l]\s*=|extra-index-ur[l]")
    found = {str(file.relative_to(ROOT)): hosts.findall(file.read_bytes()) for file in project_files()}
    assert {file: hits for file, hits in found.items() if hits} == {}


def test_no_test_module_is_too_long_to_be_read():
    lengths = {str(file.relative_to(ROOT)): len(file.read_text().splitlines()) for file in project_files() if file.suffix == ".py"}
    assert {file: length for file, length in lengths.items() if length > 300} == {}
