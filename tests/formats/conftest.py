from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared() -> Path:
    """Recordings of real instruments that may be read but not kept with the project."""
    folder = Path(__file__).parents[2].parent / "shared"
    if not (folder / "samples").is_dir():
        pytest.skip(f"the sample recordings are not at {folder}")
    return folder
