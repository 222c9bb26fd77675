"""What was counted or measured of a recording: the rows of the table ``quality``."""

from __future__ import annotations


def quality_row(take: str, part: str, instrument: str, quantity: str, value: float, unit: str = "1") -> dict[str, object]:
    """One row: ``quantity`` of ``instrument`` in ``take`` is ``value`` in ``unit``."""
    return {"take": take, "part": part, "instrument": instrument, "quantity": quantity, "value": float(value), "unit": unit}
