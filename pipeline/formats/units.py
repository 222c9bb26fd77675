"""Units of force, torque, length, angle and time that instruments print, in SI."""

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
_WORDS = {
    "rad": "radian radians",
    "deg": "degree degrees °",
    "s": "sec secs second seconds [s]",
    "ms": "millisecond milliseconds msec",
    "us": "µs μs usec microsecond microseconds",
    "ns": "nsec nanosecond nanoseconds",
    "m": "meter meters metre metres",
    "cm": "centimeter centimeters centimetre centimetres",
    "mm": "millimeter millimeters millimetre millimetres",
}
SPELLINGS = {word: unit for unit, words in _WORDS.items() for word in words.split()}
UNIT = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")  # a label and, in brackets, its unit
KNOWN = {*FORCE_UNITS, *TORQUE_UNITS, *LENGTH_UNITS, *TIME_UNITS, *ANGLE_UNITS, "A", "V", "Hz", "-"}


def plain_unit(unit: str) -> str:
    """Return ``unit`` without what joins its factors: N·m, N-m and N m are Nm."""
    return re.sub(r"[-·⋅*.\s]", "", unit)


def spelled(unit: str) -> str:
    """Return a unit of time, angle or length in this project's spelling, of a speed its angle's."""
    plain = unit.strip().lower().removesuffix("/s")
    return SPELLINGS.get(plain, plain)


def is_unit(word: str) -> bool:
    """Return whether a cell is a unit, bare or in brackets."""
    plain = word.strip("()[] ")
    return plain in KNOWN or plain_unit(plain) in KNOWN or spelled(plain) in KNOWN


def bare(label: str) -> str:
    """Return the label without a unit in brackets behind it."""
    return UNIT.fullmatch(label)[1] if unit_of(label) else label


def unit_of(label: str) -> str | None:
    """Return the unit in brackets behind a label, None where there is none; an index, as in
    ``q[0]`` or ``q(1)``, is no unit.
    """
    match = UNIT.fullmatch(label)
    return match[2] if match and not re.fullmatch(r"\s*\d*\s*", match[2]) else None
