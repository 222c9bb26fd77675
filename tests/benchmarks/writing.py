"""How the report writes tables, durations and verdicts."""

from __future__ import annotations


def table(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(
        "| " + " | ".join(cells) + " |" for cells in [header, ["---"] * len(header), *rows]
    )


def verdict(met: bool) -> str:
    """What the report says of a limit."""
    return "met" if met else "**missed**"


def significant(value: float) -> str:
    """Two significant digits, all digits before the point kept."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def duration(seconds: float) -> str:
    """Three significant digits in the unit that suits."""
    scale, unit = next(
        pair
        for pair in ((1, "s"), (1e3, "ms"), (1e6, "µs"), (1e9, "ns"))
        if seconds * pair[0] >= 1 or pair[1] == "ns"
    )
    return f"{seconds * scale:.3g} {unit}"
