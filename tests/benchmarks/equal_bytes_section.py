"""The report's table of whether results have the same bytes on other processors and threads."""

from __future__ import annotations

import json
from pathlib import Path

from equal_bytes import CONTROL, SETTINGS
from writing import table

TITLE = "Equal bytes"


def section(folder: Path) -> str:
    """Of equal_bytes.json and, for the settings that its machine lacks, of emulated.json."""
    measured = json.loads((folder / "equal_bytes.json").read_text())
    emulated = json.loads((folder / "emulated.json").read_text())
    hashes, skipped = measured["hashes"], measured["skipped"]
    hashes |= {name: emulated["hashes"][name] for name in skipped}
    reference, *others = [one.name for one in SETTINGS]
    rows = [
        [piece]
        + ["equal" if hashes[name].get(piece) == value else "**other**" for name in others]
        + ["equal" if hashes[CONTROL.name][piece] == value else "other"]
        for piece, value in hashes[reference].items()
    ]
    arithmetic = ", ".join(f"`{key}={value}`" for key, value in CONTROL.environment.items())
    return (
        f"Whether the bytes of results are those under the setting `{reference}`, on "
        f"{measured['machine']}. A level is that for which Numba compiles, each in a copy of the "
        "project where nothing is compiled before; takes are filtered on one or two threads, "
        "trials run by one or two processes. The control has an arithmetic that the project does "
        f"not allow itself ({arithmetic}): where it touches a piece, the bytes are other ones. "
        f"{elsewhere(skipped, emulated['machine'])}\n\n"
        f"{table(['piece', *others, 'control'], rows)}"
    )


def elsewhere(skipped: list[str], machine: str) -> str:
    """Where that ran which the machine cannot run."""
    if not skipped:
        return "All ran on this processor."
    return (
        f"This processor lacks the instructions of {'; '.join(skipped)}: they ran in the emulator "
        f"Bochs, by `make bench-emulated`, as {machine}."
    )
