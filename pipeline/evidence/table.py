"""The table of evidence: one number in each row, with its interval, by the columns KEYS."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core.contracts import read_declarations
from pipeline.core.filters import MEMORY, NONE, SPEED, closed
from pipeline.statistics.curves import NO_NOISE
from pipeline.statistics.takes import Difference

# what the number is of, and where a quantity needs it: the model or filter, the estimator or form,
# what it is the difference to (a model, a filter or a joint), the joint, the entry or component,
# the configuration of the robots or the number of cables, the steps
DECLARED = read_declarations()["evidence"]
KEYS = tuple(name for name, column in DECLARED.items() if column.kind == "text")
QUANTITIES = DECLARED["quantity"].among
NUMBERS = ("value", "low", "high", "standard_error", "degrees")
OPTION_FILES = Path(__file__).parents[1] / "conf/model"
RECORDED = "recorded"  # in place of a model
Row = dict[str, object]  # a value of each column


def known_values() -> dict[str, list[str]]:
    """Return the values that a row can have in the keys whose values are known beforehand: names of
    option files and filters, estimators and forms, entries of at most seven joints, and steps.
    """
    models = sorted(file.stem for file in OPTION_FILES.glob("*.yaml"))
    without_file = [RECORDED, NONE, MEMORY, SPEED, NO_NOISE]
    entries = [f"{row}{column}" for row in range(1, 8) for column in range(row, 8)]
    return {
        "model": [*without_file, *models, *map(closed, models)],
        "estimator": ["paper", "diagonal", "full", "none"],
        "entry": ["fx", "fy", "fz", "mx", "my", "mz", *entries],
        "steps": ["all", "moving", "constant_speed"],
    }


def evidence_row(
    quantity: str,
    value: float,
    low: float = np.nan,
    high: float = np.nan,
    standard_error: float = np.nan,
    degrees: float = np.nan,
    **keys: object,
) -> Row:
    """Return one row; a key that is not given is empty."""
    row: Row = {KEYS[0]: quantity}
    for name in KEYS[1:]:
        row[name] = str(keys.pop(name, ""))
    if keys:
        raise TypeError(f"the table of evidence has no column {', '.join(keys)}")
    numbers = (value, low, high, standard_error, degrees)
    for name, number in zip(NUMBERS, numbers, strict=True):
        row[name] = float(number)
    return row


def difference_row(quantity: str, difference: NamedTuple, **keys: object) -> Row:
    """Return the row of a ``difference`` with its interval, a tuple with the fields of
    ``Difference``.
    """
    numbers = [getattr(difference, name) for name in Difference._fields]
    return evidence_row(quantity, *numbers, **keys)


def following_rows(
    tests: pd.DataFrame,
    correlation: str,
    prefix: str,
    model: str,
) -> Iterator[Row]:
    """Yield the quantity ``correlation``, and with the ``prefix`` the limit and the powers against
    constant noise and the speed law, of :func:`pipeline.statistics.curves.following_tests`.
    """
    for test in tests.itertuples():
        keys = {"model": model, "joint": test.joint, "steps": test.steps}
        yield evidence_row(correlation, test.correlation, **keys)
        yield evidence_row(f"{prefix}_limit", test.limit, **keys)
        yield evidence_row(f"{prefix}_power", test.power, **keys)
        yield evidence_row(f"{prefix}_speed_power", test.rival_power, **keys)


def evidence_table(rows: Iterable[Row]) -> pd.DataFrame:
    """Return the table of ``rows`` without infinite numbers and rows without a value."""
    table = pd.DataFrame(rows, columns=[*KEYS, *NUMBERS])
    table = table.astype(dict.fromkeys(NUMBERS, float))
    table = table.replace([np.inf, -np.inf], np.nan)
    return table[table["value"].notna()].reset_index(drop=True)


def depends_on(evidence: pd.DataFrame, model: str) -> pd.Series:
    """Return the mask of the rows of ``model``, in an open or a closed loop, and of differences to
    it.
    """
    names = [model, closed(model)]
    return evidence["model"].isin(names) | evidence["rival"].isin(names)
