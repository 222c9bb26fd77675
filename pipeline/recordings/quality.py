"""What was counted or measured of a recording: the rows of the table ``quality``."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import RecordingError


def quality_row(take: str, part: str, instrument: str, quantity: str, value: float, unit: str = "1") -> dict[str, object]:
    """One row: ``quantity`` of ``instrument`` in ``take`` is ``value`` in ``unit``."""
    return {"take": take, "part": part, "instrument": instrument, "quantity": quantity, "value": float(value), "unit": unit}


def require_text(path: Path) -> None:
    """RecordingError where the name of a take's file or folder is no text (not UTF-8): no table could name the take."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        shown = Path(repr(str(path))[1:-1])
        raise RecordingError("the name holds letters that are no UTF-8; rename it", file=shown) from None
