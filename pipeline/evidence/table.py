"""The table of evidence: one number in each row, with its interval, by the columns KEYS."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from pipeline.core.contracts import read_declarations
from pipeline.core.filters import closed

# what the number is of, and where a quantity needs it: the model or filter, the estimator or form,
# what it is the difference to (a model, a filter or a joint), the joint, the entry or component,
# the configuration of the robots or the number of cables, the steps
DECLARED = read_declarations()["evidence"]
KEYS = tuple(name for name, column in DECLARED.items() if column.kind == "text")
QUANTITIES = DECLARED["quantity"].among
NUMBERS = ("value", "low", "high", "standard_error")


def evidence_row(
    quantity: str,
    value: float,
    low: float = np.nan,
    high: float = np.nan,
    standard_error: float = np.nan,
    **keys: object,
) -> dict[str, object]:
    """Return one row; a key that is not given is empty."""
    numbers = zip(NUMBERS, map(float, (value, low, high, standard_error)), strict=True)
    named = {name: str(keys.pop(name, "")) for name in KEYS[1:]}
    if keys:
        raise TypeError(f"the table of evidence has no column {', '.join(keys)}")
    return {KEYS[0]: quantity} | named | dict(numbers)


def evidence_table(rows: Iterable[dict]) -> pd.DataFrame:
    """Return the table of ``rows`` without infinite numbers and rows without a value."""
    table = pd.DataFrame(rows, columns=[*KEYS, *NUMBERS])
    table = table.astype(dict.fromkeys(NUMBERS, float)).replace([np.inf, -np.inf], np.nan)
    return table[table["value"].notna()].reset_index(drop=True)


def depends_on(evidence: pd.DataFrame, model: str) -> pd.Series:
    """Return the mask of the rows of ``model``, in an open or a closed loop, and of differences to
    it.
    """
    names = [model, closed(model)]
    return evidence["model"].isin(names) | evidence["rival"].isin(names)
