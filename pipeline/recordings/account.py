"""What was found in the recordings, what was kept of it, and what was left out and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import pandas as pd

from pipeline.recordings.limits import reasons
from pipeline.recordings.quality import LEFT_OUT, REPETITIONS

SHOWN = 8  # folders whose files no part reads


def account(
    files: Iterable[pd.DataFrame], quality: pd.DataFrame, takes: pd.DataFrame
) -> pd.DataFrame:
    """A row per step and recording: step, recording, ``found``, ``kept``, ``left_out`` in words.

    Args:
        files: The files that each part reads, as
            :func:`pipeline.recordings.inventory.by_part` has them.
        quality: The table ``quality`` of the motion.
        takes: The table ``takes``.
    """
    rows = [("files", "all", *_named(files))]
    counts = quality[quality["quantity"].str.startswith((REPETITIONS, LEFT_OUT))]
    for movement, held in counts.groupby("take"):
        number = held.set_index("quantity")["value"].astype(int)
        lost = number.drop(REPETITIONS)
        words = [
            f"{name.removeprefix(LEFT_OUT).replace('_', ' ')} {count}"
            for name, count in lost[lost > 0].items()
        ]
        rows.append(
            ("motions", movement, number.sum(), number[REPETITIONS], ", ".join(words)),
        )
    for part, of_part in takes.groupby("part", sort=False):
        present = of_part["take"].nunique()
        gone = of_part.loc[of_part["left_out"], "take"].nunique()
        rows.append(("takes", part, present, present - gone, "; ".join(reasons(of_part))))
    return pd.DataFrame(rows, columns=["step", "recording", "found", "kept", "left_out"])


def _named(files: Iterable[pd.DataFrame]) -> tuple[int, int, str]:
    """How many files there are, how many a pattern names, and where the others lie."""
    names = [set(table["file"]) for table in files]
    present, other = set().union(*names), set.intersection(*names)  # what none names is any part's
    places = Counter(name.partition("/")[0] for name in other)
    words = [
        place if number == 1 else f"{place} ({number})" for place, number in sorted(places.items())
    ]
    more = [f"and in {len(words) - SHOWN} more places"] if len(words) > SHOWN else []
    return len(present), len(present - other), ", ".join([*words[:SHOWN], *more])
