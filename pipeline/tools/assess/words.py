"""What is said of a take that was judged."""

from __future__ import annotations

import numpy as np

from pipeline.tools.assess.judge import Verdict


def said(take: str, model: str, fitted: int, verdict: Verdict) -> str:
    """The verdict in a sentence, then a line of numbers for each joint; ``fitted`` of the takes it
    is held against are those the ``model`` was fitted to.
    """
    count = int(verdict.others.sum())
    known = f", {fitted} of them those the model was fitted to" if fitted else ""
    head = "behaves as" if verdict.behaves else "does NOT behave as"
    lines = [f"assess: {take} {head} the {count} takes it is held against{known} ({model})."]
    joint, span = np.unravel_index(np.argmax(np.abs(verdict.span_t)), verdict.span_t.shape)
    t = verdict.span_t[joint, span]
    begins, ends = verdict.ends[span], verdict.ends[span + 1]
    lines += [
        f"  furthest from them: {verdict.names[1 + joint]} from {begins:.3g} to {ends:.3g} s, "
        f"{'less' if t < 0 else 'more'} likely by {abs(t):.3g} of their standard deviations "
        f"(p = {verdict.p_spans:.2g} for the furthest of all parts)",
        f"  as a whole: p = {verdict.p_whole:.2g}; unlike them is what has a p of "
        f"{verdict.limit:.2g} or less in either, by chance up to {2 * verdict.limit:.2g} of takes",
        "  log evidence, nats a step; theirs; share of theirs that is as far from the rest",
    ]
    for name, own, (mean, std), p in zip(
        verdict.names, verdict.evidence, verdict.theirs, verdict.p, strict=True
    ):
        lines.append(f"  {name}: {own:.4g}; {mean:.4g} ± {std:.2g}; p = {p:.2g}")
    return "\n".join(lines)
