"""A project with recordings drawn from a known model, for the stages that fit and score."""

from __future__ import annotations

import pytest
from known_law import write_project


@pytest.fixture
def project(tmp_path, monkeypatch):
    """The chain, joint angles and commanded steps of the recordings in the current directory."""
    monkeypatch.chdir(tmp_path)
    return write_project(tmp_path)
