"""Small tables in the shape of those that the studies write."""

from __future__ import annotations

import pandas as pd

GAP = float("nan")


def sensitivity() -> pd.DataFrame:
    """Two claims of two cases each in the base case and three variations."""
    claims = {
        ("first-claim", "method"): ("holds", "fails", "no evidence", "holds"),
        ("second-claim", "robots"): ("fails", "fails", "holds", "holds"),
    }
    variations = [("", ""), ("clock", "not aligned"), ("chance", "other draws")]
    variations.append(("chance", "other takes"))
    parts = [
        pd.DataFrame(
            {
                "setting": setting,
                "variation": variation,
                "claim": claim,
                "about": about,
                "case": ["shoulder", "elbow"],
                "value": 1.0,
                "than": GAP,
                "holds": word,
                "verdict": word,
                "changed": word != words[0],
            }
        )
        for (claim, about), words in claims.items()
        for (setting, variation), word in zip(variations, words, strict=True)
    ]
    return pd.concat(parts, ignore_index=True)
