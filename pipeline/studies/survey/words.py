"""The page of the study: of every survey that was run, how often each claim holds."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from pipeline.studies.survey import figure
from pipeline.studies.survey.conditions import BASE
from pipeline.studies.survey.options import read_survey
from pipeline.verdicts.wording import table

HERE = Path(__file__).parent
TITLE = "Where the claims hold, and where they turn"
# factors of the motion that no publication fixes → what they are
FREE = {
    "lasting": "How long a deviation lasts: factors on the lags of sway and rattling",
    "speed_exponent": "The power of the speed that sway and rattling grow with: factors on it",
    "trajectory": "The share of rest: the same motion, with shorter or longer rests",
}


def sections(folder: Path, left_out: str) -> list[str]:
    """The page's sections from the surveys in ``folder``, the largest first; ``left_out`` is what
    no condition has.
    """
    question = (
        "Do the verdicts hang on the very laboratory that the synthetic recordings come from? Its "
        "disturbances and how long they last, its instruments, trajectory and cable systems are "
        "varied, and every claim is decided again in each condition. No condition has "
        f"{left_out}. A survey is a run by hand, `python -m pipeline survey NAME`; conditions that "
        "were worked out before are not worked out again."
    )
    surveys = {
        file.parent.name: pd.read_csv(file, dtype={"level": str})
        for file in folder.glob("*/verdicts.csv")
    }
    names = sorted(surveys, key=lambda name: -surveys[name]["conditions"].sum())
    parts = [question]
    for name in names:
        parts += _survey(name, surveys[name], folder / name)
    return parts


def _survey(name: str, counts: pd.DataFrame, folder: Path) -> list[str]:
    cost = json.loads((folder / "cost.json").read_text(encoding="utf-8"))
    beside = pd.read_csv(folder / "base_condition.csv")
    title, _, caption = " ".join(figure.__doc__.split()).partition(". ")
    links = [f"[{file}](survey/{name}/{file})" for file in ("verdicts.csv", "base_condition.csv")]
    return [
        f"## {name}",
        f"{cost['conditions']} conditions in {cost['cpu_seconds']:.0f} s of processor time. "
        f"In the base condition {beside['agrees'].sum()} of {len(beside)} cases come out as in the "
        f"whole pipeline. {_turning(counts)}",
        f"![{title}](survey/{name}/survey.png)\n\n**{title}.** {caption}",
        f"All counts: {', '.join(links)}.",
        _table(counts),
        *_free(counts, name),
    ]


def _words(counts: pd.DataFrame) -> pd.DataFrame:
    """``counts`` with the word of each level, and that of the base condition."""
    words = [figure.word_of(*row) for row in counts[["holds", "fails"]].to_numpy()]
    counts = counts.assign(word=words)
    base = counts[counts["factor"] == BASE].set_index("claim")["word"]
    return counts.assign(base=counts["claim"].map(base))


def _turning(counts: pd.DataFrame) -> str:
    words = _words(counts)
    varied = words[words["factor"] != BASE]
    if varied.empty:
        return ""
    turning = set(varied.loc[varied["word"] != varied["base"], "claim"])
    claims = list(dict.fromkeys(varied["claim"]))
    steady = [claim for claim in claims if claim not in turning]
    return (
        f"Of {len(claims)} claims {len(steady)} come out alike in all conditions, and "
        f"{len(claims) - len(steady)} turn somewhere."
    )


def _table(counts: pd.DataFrame) -> str:
    words, rows = _words(counts), []
    for claim, levels in words.groupby("claim", sort=False):
        varied = levels[levels["factor"] != BASE]
        other = varied[varied["word"] != varied["base"]]
        named = [
            f"{factor.replace('_', ' ')} ({', '.join(each['level'].astype(str))})"
            for factor, each in other.groupby("factor", sort=False)
        ]
        rows.append([claim, levels["base"].iloc[0], "; ".join(named) or "–"])
    return table(["claim", "holds in the base condition", "otherwise with"], rows)


def _free(counts: pd.DataFrame, name: str) -> list[str]:
    """Which claims turn, and where, along each of the factors FREE that the survey ``name``
    varies.
    """
    ways = read_survey(HERE / f"{name}.yaml").trajectories
    rests = [way for way, options in ways.items() if options.rest is not None]
    words = _words(counts)
    words, parts = words[words["study"] == "motion"], []
    for factor, what in FREE.items():
        rows = words[words["factor"] == factor]
        rows = rows[rows["level"].isin(rests)] if factor == "trajectory" else rows
        if rows.empty:
            continue
        cells = rows.set_index(["claim", "level"])["word"].to_dict()
        claims = rows.drop_duplicates("claim").set_index("claim")
        levels = list(rows["level"].unique())
        turning = [
            [claim if each["about"] == "method" else f"{claim} *", each["base"]]
            + [cells.get((claim, level), "–") for level in levels]
            for claim, each in claims.iterrows()
            if set(rows.loc[rows["claim"] == claim, "word"]) != {each["base"]}
        ]
        parts.append(f"**{what}.** {len(turning)} of {len(claims)} claims turn.")
        if turning:
            parts.append(table(["claim", "holds in the base condition", *levels], turning))
    if not parts:
        return []
    opening = (
        "None of the following is published, and a laboratory has to choose it. Each cell says in "
        "which of the conditions with that level the claim holds. Claims that do not turn are left "
        "out. Those with an asterisk are about robots: that they turn shows that the laboratory "
        "decides them."
    )
    return [f"### What nobody published: {name}", opening, *parts]
