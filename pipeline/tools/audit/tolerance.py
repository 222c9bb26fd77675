"""How far the outputs of two runs may be apart, stated here once for every kind of file, each with
its reason.
"""

from __future__ import annotations

RELATIVE = 1e-5
ROUNDING = 1e-15
PRINTED = 1e-2
LEVELS = 1

# kind of file → the difference that is no real one, and why
TOLERANCES = {
    "tables and numbers (Parquet, CSV, JSON)": f"{RELATIVE:g} of a number, or in a column "
    f"{ROUNDING:g} of its greatest; another processor "
    "may round the last bit otherwise, which fits and filters make more of, but not so much that "
    "four printed digits show it; whole "
    "numbers are equal",
    "texts": f"{RELATIVE:g} of a decimal number, or one unit of its last printed digit where "
    f"that is below {PRINTED:g} of it; what lies "
    "between two roundings may be printed as either; hashes are passed over, as what they are of "
    "is compared itself; all else is equal",
    "images": f"{LEVELS} level of a pixel; a shade or a depth between two levels may be rounded "
    "to either",
    "all others": "none, for what they hold is not known here",
}
