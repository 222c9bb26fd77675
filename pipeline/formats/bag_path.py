"""What a ROS bag is called; apart from what reads one, which takes long to import."""

from __future__ import annotations

import os
from pathlib import Path

SUFFIXES = (".bag", ".mcap", ".db3")


def is_bag(path: Path) -> bool:
    """Whether ``path`` is a bag: a file of a bag's suffix, or a folder with the metadata.yaml of
    ROS 2.
    """
    if os.path.isfile(path):  # False, as Path.is_file is not, where it may not be looked at
        return path.suffix in SUFFIXES
    return os.path.isfile(path / "metadata.yaml")
