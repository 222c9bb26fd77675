"""A folder of one recording of every format, and what is said of each."""

from __future__ import annotations

from pathlib import Path

import pytest
from zoo import write_zoo

from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.finding import Finding


@pytest.fixture(scope="session")
def zoo(tmp_path_factory) -> Path:
    """The folder; read only."""
    folder = tmp_path_factory.mktemp("zoo")
    write_zoo(folder)
    return folder


@pytest.fixture(scope="session")
def findings(zoo) -> dict[str, Finding]:
    """What is said of each recording, by its place in the folder."""
    return {finding.file.relative_to(zoo).as_posix(): finding for finding in inspect(zoo)}
