"""Sentences on a take that was compared with others."""

from __future__ import annotations

import numpy as np

from pipeline.tools.assess.judge import Verdict

MOST_CHANCE = 0.25  # share of takes of the same kind called different, above which nothing is shown


def shows(verdict: Verdict) -> bool:
    """Return whether there are enough takes to compare with for a difference to be shown."""
    return bool(2 * verdict.limit <= MOST_CHANCE)


def said(take: str, model: str, fitted: int, verdict: Verdict) -> str:
    """Return the verdict in a sentence, then a line of numbers for each joint; the ``model`` was
    fitted to ``fitted`` of the takes it is compared with.
    """
    count = int(verdict.others.sum())
    known = f", {fitted} of them those the model was fitted to" if fitted else ""
    joint, span = np.unravel_index(np.argmax(np.abs(verdict.span_t)), verdict.span_t.shape)
    t = verdict.span_t[joint, span]
    begins, ends = verdict.ends[span], verdict.ends[span + 1]
    if not shows(verdict):
        head = (
            f"no difference of {take} can be shown with {count} takes to compare with: record "
            f"{round(2 / MOST_CHANCE) - 1} or more"
        )
    elif verdict.behaves:
        head = f"{take} behaves as the {count} takes it is compared with"
    else:
        head = f"{take} does NOT behave as the {count} takes it is compared with"
    lines = [
        f"assess: {head}{known} ({model}).",
        f"  largest difference: {verdict.names[1 + joint]} from {begins:.3g} to {ends:.3g} s, "
        f"{'less' if t < 0 else 'more'} likely by {abs(t):.3g} of their standard deviations; "
        f"{100 * verdict.p_spans:.0f} % of such takes differ as much somewhere",
        f"  as a whole: {100 * verdict.p_whole:.0f} % of such takes differ as much; by chance up "
        f"to {200 * verdict.limit:.0f} % of takes of the same kind are called different",
        "  joint: log evidence of this take; mean ± standard deviation of the others (nats a step)",
    ]
    for name, own, (mean, std), p in zip(
        verdict.names, verdict.evidence, verdict.theirs, verdict.p, strict=True
    ):
        lines.append(f"  {name}: {own:.4g}; {mean:.4g} ± {std:.2g}; {100 * p:.0f} % differ as much")
    return "\n".join(lines)
