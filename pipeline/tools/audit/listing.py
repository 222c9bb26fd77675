"""An audit for a reader and for a program."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict

from pipeline.tools.audit.tolerance import TOLERANCES
from pipeline.tools.audit.verdict import IDENTICAL, NOT_RUN, Audit, Output

SHOWN = 3  # differences of an output


def as_table(audit: Audit) -> str:
    """The lock files, every output that is not identical, the tolerances where there are any, and
    the verdict.
    """
    lines = [
        f"{file}: {'the same to the byte' if same else 'differs'}"
        for file, same in audit.locks.items()
    ]
    lines += [
        f"{name}: its lock is of other inputs than the commit's: {', '.join(inputs)}"
        for name, inputs in audit.outdated.items()
    ]
    rows = [
        row
        for output in audit.outputs
        if output.verdict not in (IDENTICAL, NOT_RUN)
        for row in _rows(output)
    ]
    if rows:
        rows = [("verdict", "stage", "output", "differences"), *rows]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines += [
            "",
            *(
                "  ".join(
                    cell.ljust(width) for cell, width in zip(row, widths, strict=True)
                ).rstrip()
                for row in rows
            ),
        ]
        lines += [
            "",
            "No real difference is:",
            *(f"- in {kind}: {tolerance}" for kind, tolerance in TOLERANCES.items()),
        ]
    counts = Counter(output.verdict for output in audit.outputs)
    return "\n".join(
        [*lines, "", f"audit: {audit.verdict}; of {len(audit.outputs)} outputs {_list(counts)}"]
    )


def as_json(audit: Audit) -> str:
    """All of it, every difference included."""
    return (
        json.dumps(
            {"verdict": audit.verdict, "tolerances": TOLERANCES} | asdict(audit),
            indent=1,
            ensure_ascii=False,
        )
        + "\n"
    )


def _rows(output: Output) -> list[tuple[str, str, str, str]]:
    words = [": ".join(filter(None, (part.where, part.how))) for part in output.differences]
    if len(words) > SHOWN:
        words = [*words[:SHOWN], f"and {len(words) - SHOWN} more"]
    first, *others = words or [""]
    return [
        (output.verdict, output.stage, output.path, first),
        *(("", "", "", other) for other in others),
    ]


def _list(counts: Counter) -> str:
    return ", ".join(f"{number} {verdict}" for verdict, number in counts.items())
