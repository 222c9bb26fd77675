"""Units of force, torque, angle and time that instruments print, in SI."""

from __future__ import annotations

import re

import numpy as np

_LBF, _KGF, _INCH = 4.4482216152605, 9.80665, 0.0254
# N; lb, klb, kg and g as ATI's programs name forces
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "lbf": _LBF, "klbf": 1e3 * _LBF, "kgf": _KGF, "gf": 1e-3 * _KGF}
FORCE_UNITS |= {"lb": _LBF, "klb": 1e3 * _LBF, "kg": _KGF, "g": 1e-3 * _KGF}
# N·m
TORQUE_UNITS = {"Nm": 1.0, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}
TORQUE_UNITS |= dict.fromkeys(("lbfin", "lbin", "inlb", "inlbf"), _LBF * _INCH)
TORQUE_UNITS |= dict.fromkeys(("lbfft", "lbft", "ftlb", "ftlbf"), _LBF * 12 * _INCH)
TORQUE_UNITS |= dict.fromkeys(("kgfcm", "kgcm"), 1e-2 * _KGF)
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": _INCH, "ft": 12 * _INCH}  # m
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}  # s
ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180}
SPELLINGS = {"radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "°": "deg"}
SPELLINGS |= {"sec": "s", "second": "s", "seconds": "s", "µs": "us", "μs": "us", "nsec": "ns"}
SPELLINGS |= {"millisecond": "ms", "milliseconds": "ms", "msec": "ms", "[s]": "s"}
KNOWN = {*FORCE_UNITS, *TORQUE_UNITS, *LENGTH_UNITS, *TIME_UNITS, *ANGLE_UNITS, "A", "V", "Hz", "-"}


def plain_unit(unit: str) -> str:
    """``unit`` without what joins its factors: N·m, N-m and N m are Nm."""
    return re.sub(r"[-·⋅*.\s]", "", unit)


def spelled(unit: str) -> str:
    """Return a unit of time or angle as this project spells it, a speed as that of its angle."""
    plain = unit.strip().lower()
    plain = plain.removesuffix("/s")
    return SPELLINGS.get(plain, plain)


def is_unit(word: str) -> bool:
    """Whether a cell is a unit, bare or in brackets."""
    plain = word.strip("()[] ")
    return plain in KNOWN or plain_unit(plain) in KNOWN or spelled(plain) in KNOWN
