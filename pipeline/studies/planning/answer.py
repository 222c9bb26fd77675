"""What the page answers: which motion is the least uncertain, how surely, and whose order holds."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from pipeline.studies import page
from pipeline.studies.planning.motions import BEST, GIVEN, MINIMUM, RECORDED
from pipeline.studies.survey.conditions import BASE

MODELS = {
    "additive": "additive",
    "wishart_qr_transposed": "Wishart, QR of Jᵀ",
    GIVEN: "Wishart, J₁ given",
    "gaussian": "Gaussian",
}
WITHOUT_MODEL = {
    RECORDED: "recorded motion",
    MINIMUM: "minimum-norm motion",
    BEST: "best-conditioned motion",
}
MOTIONS = WITHOUT_MODEL | {name: f"plan of {model}" for name, model in MODELS.items()}
MOST = 0.5  # share of arm and physics above which something holds in most
SURE = 0.975  # of the resamplings, in which a motion is the least where it surely is
YARDSTICK = ("joints", "step")


def rows_of(rows: pd.DataFrame, key: tuple[str, str]) -> pd.DataFrame:
    """Those of a part and kind."""
    return rows[(rows["part"] == key[0]) & (rows["kind"] == key[1])]


def winners(spreads: pd.DataFrame, key: tuple[str, str]) -> pd.DataFrame:
    """The row of the motion of the least sum, of each arm in each physics."""
    rows = rows_of(spreads, key).dropna(subset="sum")
    return rows.loc[rows.groupby(["arm", "physics"], sort=False)["sum"].idxmin()]


def answer(spreads: pd.DataFrame, orders: pd.DataFrame) -> Iterator[str]:
    """Bullets: the least motion of each arm, in how many physics each is, and whose order holds."""
    lines, best = [], winners(spreads, YARDSTICK)
    for arm, rows in best.groupby("arm", sort=False):
        own = rows[rows["physics"] == BASE].iloc[0]
        lines.append(
            f"- **{arm}**, base condition: the least uncertain is the {MOTIONS[own['motion']]}"
            f"{_over_minimum(own)}, {_share(own['least'])}. "
            f"{_best_plan(spreads, arm)}"
        )
    for arm, rows in best.groupby("arm", sort=False):
        counts = rows.groupby("motion", sort=False).agg(
            least=("least", "size"), sure=("least", lambda shares: (shares >= SURE).sum())
        )
        texts = [
            f"the {MOTIONS[motion]} in {row.least} ({row.sure} surely)"
            for motion, row in counts.sort_values("least", ascending=False).iterrows()
        ]
        lines.append(
            f"- **Of {len(rows)} physics, {arm}**: the least is {page.listed(texts)}. Of the plans "
            f"alone it is {_least_plans(spreads, arm)}."
        )
    lines += [
        _orders(rows, model)
        for model, rows in rows_of(orders, YARDSTICK).groupby("model", sort=False)
    ]
    yield "\n".join(lines)
    yield _turning(best)


def _least_plans(spreads: pd.DataFrame, arm: str) -> str:
    """In how many physics each model's plan is the least of the plans."""
    plans = spreads[(spreads["arm"] == arm) & spreads["motion"].isin(MODELS)]
    counts = winners(plans, YARDSTICK)["motion"].value_counts(sort=True)
    return page.listed([f"that of {MODELS[model]} in {n}" for model, n in counts.items()]) or "none"


def _share(share: float) -> str:
    return "surely" if share >= SURE else f"in {share:.0%} of the resamplings"


def _over_minimum(row: pd.Series) -> str:
    if row["motion"] == MINIMUM:
        return ""
    return f", {ratio_of(row)} of the minimum-norm motion"


def ratio_of(row: pd.Series) -> str:
    """Over the minimum-norm motion, with the interval where there is one."""
    middle, low, high = (page.number(row[f"ratio{end}"]) for end in ("", "_low", "_high"))
    return middle if middle == low == high else f"{middle} [{low}, {high}]"


def _best_plan(spreads: pd.DataFrame, arm: str) -> str:
    """Which model's plan is the least of the plans, and whether it is less than every motion that
    needs no model.
    """
    rows = rows_of(spreads, YARDSTICK)
    rows = rows[(rows["arm"] == arm) & (rows["physics"] == BASE)].dropna(subset="sum")
    plans, others = (
        rows[rows["motion"].isin(MODELS) == is_plan].sort_values("sum") for is_plan in (True, False)
    )
    if plans.empty:
        return "No model has a plan."
    plan, other = plans.iloc[0], others.iloc[0]
    order = "below" if plan["sum"] < other["sum"] else "above"
    worst = plans.iloc[-1]
    text = (
        f"Of the plans it is that of {MODELS[plan['motion']]}, {ratio_of(plan)}, {order} the best "
        f"motion without a model, the {WITHOUT_MODEL[other['motion']]}"
    )
    if len(plans) > 1:
        text += f"; the worst plan is that of {MODELS[worst['motion']]}, {ratio_of(worst)}"
    return f"{text}."


def _orders(rows: pd.DataFrame, model: str) -> str:
    known = rows.dropna(subset="tau")
    if known.empty:
        return f"- **{MODELS[model]}** predicts no order: the same of every motion."
    known = known.assign(agree=known["tau_low"] > 0, against=known["tau_high"] < 0)
    if known["agree"].mean() > MOST:
        verdict = "goes with the realised one in most physics"
    elif known["against"].mean() > MOST:
        verdict = "runs against the realised one in most physics"
    else:
        verdict = "goes with the realised one in some physics and not in others"
    texts = [
        f"{arm} τ {page.number(own['tau'].median())} in the median, surely positive in "
        f"{own['agree'].sum()} of {len(own)} and surely negative in {own['against'].sum()}"
        for arm, own in known.groupby("arm", sort=False)
    ]
    return f"- **{MODELS[model]}**: the order that it predicts {verdict}: {'; '.join(texts)}."


def _turning(best: pd.DataFrame) -> str:
    """Where another motion than in the base condition is surely the least."""
    texts = []
    for arm, rows in best.groupby("arm", sort=False):
        usual = rows.loc[rows["physics"] == BASE, "motion"].iloc[0]
        other = rows[(rows["motion"] != usual) & (rows["least"] >= SURE)]
        named = [
            f"the {MOTIONS[motion]} with {page.listed(list(each['physics']))}"
            for motion, each in other.groupby("motion", sort=False)
        ]
        said = "; ".join(named) or "nowhere"
        texts.append(f"{arm}: {said}")
    return (
        "Another motion than in the base condition is surely the least: "
        f"{'. '.join(texts)}. A physics is named by the disturbance and the factor on it."
    )
