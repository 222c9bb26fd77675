"""Units of force, torque and time that instruments print, in SI."""

from __future__ import annotations

import re

_LBF, _KGF, _INCH = 4.4482216152605, 9.80665, 0.0254
# N
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "lbf": _LBF, "klbf": 1e3 * _LBF, "kgf": _KGF, "gf": 1e-3 * _KGF}
# as ATI's programs name them
FORCE_UNITS |= {"lb": _LBF, "klb": 1e3 * _LBF, "kg": _KGF, "g": 1e-3 * _KGF}
TORQUE_UNITS = {
    "Nm": 1.0,
    "Nmm": 1e-3,
    "Ncm": 1e-2,
    "kNm": 1e3,
    "lbfin": _LBF * _INCH,
    "lbfft": _LBF * 12 * _INCH,
    "kgfcm": 1e-2 * _KGF,
}
TORQUE_UNITS |= {
    "lbin": _LBF * _INCH,
    "inlb": _LBF * _INCH,
    "inlbf": _LBF * _INCH,
    "lbft": _LBF * 12 * _INCH,
}
TORQUE_UNITS |= {"ftlb": _LBF * 12 * _INCH, "ftlbf": _LBF * 12 * _INCH, "kgcm": 1e-2 * _KGF}  # N·m
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": _INCH, "ft": 12 * _INCH}  # m
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}  # s


def plain_unit(unit: str) -> str:
    """``unit`` without what joins its factors: N·m, N-m and N m are Nm."""
    return re.sub(r"[-·⋅*.\s]", "", unit)
