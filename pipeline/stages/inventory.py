"""inventory: what lies in a folder of recordings that are read in place, so that a change of them reruns what follows."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import pandas as pd

from pipeline.errors import RecordingError


def run(recordings: str) -> None:
    """Write the files below the folder ``recordings`` to standard output, as CSV: path, bytes, SHA-256."""
    folder = Path(recordings)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    if not files:
        raise RecordingError("there are no recordings in this folder, or it does not exist", file=folder)
    content = [path.read_bytes() for path in files]
    table = pd.DataFrame({"file": [path.relative_to(folder).as_posix() for path in files], "bytes": [len(data) for data in content]})
    table.assign(sha256=[hashlib.sha256(data).hexdigest() for data in content]).to_csv(sys.stdout, index=False, lineterminator="\n")
