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


def known_values() -> dict[str, list[str]]:
    """Return the values that a row can have in the keys whose values are known beforehand: names of
    option files and filters, estimators and forms, entries of at most seven joints, and steps.
    """
    models = sorted(file.stem for file in OPTION_FILES.glob("*.yaml"))
    entries = [f"{row}{column}" for row in range(1, 8) for column in range(row, 8)]
    return {
        "model": [
            RECORDED,
            NONE,
            MEMORY,
            SPEED,
            NO_NOISE,
            *models,
            *map(closed, models),
        ],
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
) -> dict[str, object]:
    """Return one row; a key that is not given is empty."""
    values = map(float, (value, low, high, standard_error, degrees))
    numbers = zip(NUMBERS, values, strict=True)
    named = {name: str(keys.pop(name, "")) for name in KEYS[1:]}
    if keys:
        raise TypeError(f"the table of evidence has no column {', '.join(keys)}")
    return {KEYS[0]: quantity} | named | dict(numbers)


def difference_row(quantity: str, own: NamedTuple, **keys: object) -> dict[str, object]:
    """Return the row of a difference with its interval: the fields of ``Difference`` in ``own``."""
    numbers = (getattr(own, name) for name in Difference._fields)
    return evidence_row(quantity, *numbers, **keys)


def following_rows(
    tests: pd.DataFrame, correlation: str, prefix: str, model: str
) -> Iterator[dict[str, object]]:
    """Yield the quantity ``correlation``, and with the ``prefix`` the limit and the powers against
    constant noise and the speed law, of :func:`pipeline.statistics.curves.following_tests`.
    """
    for own in tests.itertuples():
        keys = {"model": model, "joint": own.joint, "steps": own.steps}
        yield evidence_row(correlation, own.correlation, **keys)
        yield evidence_row(f"{prefix}_limit", own.limit, **keys)
        yield evidence_row(f"{prefix}_power", own.power, **keys)
        yield evidence_row(f"{prefix}_speed_power", own.rival_power, **keys)


def evidence_table(rows: Iterable[dict]) -> pd.DataFrame:
    """Return the table of ``rows`` without infinite numbers and rows without a value."""
    table = pd.DataFrame(rows, columns=[*KEYS, *NUMBERS])
    table = table.astype(dict.fromkeys(NUMBERS, float)).replace(
        [np.inf, -np.inf], np.nan
    )
    return table[table["value"].notna()].reset_index(drop=True)


def depends_on(evidence: pd.DataFrame, model: str) -> pd.Series:
    """Return the mask of the rows of ``model``, in an open or a closed loop, and of differences to
    it.
    """
    names = [model, closed(model)]
    return evidence["model"].isin(names) | evidence["rival"].isin(names)
