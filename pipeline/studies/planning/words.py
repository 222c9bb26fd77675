"""The page of the study: which motion is really the least uncertain, and whose prediction knew."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import pandas as pd

from pipeline.studies import page
from pipeline.studies.planning.answer import (
    MODELS,
    MOTIONS,
    SURE,
    YARDSTICK,
    answer,
    ratio_of,
    rows_of,
    winners,
)
from pipeline.studies.planning.motions import MINIMUM, RECORDED
from pipeline.studies.planning.spread import KINDS, PARTS
from pipeline.studies.survey.conditions import BASE
from pipeline.verdicts.wording import table

TITLE = "Is the motion that is planned as the least uncertain really that?"
ASKED = """The paper sketches a use of its models: choose among the joint motions of one task path
the one of least uncertainty. Each model, fitted to training takes, plans the motion of least Σ tr
Cov of its steps. The laboratory performs these plans, the minimum-norm motion, the best-conditioned
one and the one that was recorded, {takes} takes of each, in every physics that
[the survey](survey.md) gives its arm. The youBot's three joints keep x and z of the tip, the
seven joints of the LWR4+ the whole pose of the flange."""
HOW = """Every motion of an arm has the same task path in the same time, and a first pose of its
own; the minimum-norm motion and the recorded one start alike. A plan keeps the joints' limits of
angle and speed and stays clear of singular poses; a small cost of steps in the null space, which no
model gives noise, keeps it from wandering there.

The yardstick is the one-step noise of the joints, Σ tr Cov(ω) over the motion, as the project
measures it of recordings: that is what a model of steps states and what a planner sums. The servo
undoes what a step does, so the spread of the poses is no sum of the steps'; it stands beside, and
so does the tip's, in the units of the task. Spreads are about the mean over the takes, of one
session: what is built wrong or read wrong all through a session moves the mean alone. A motion
capture without noise of its own looks, with the jitter of its exposures. Models are fitted by the
paper's estimators to as many takes of the recorded motion in the same physics; J₁ given makes
metres and radians one unit by the mean length of the arm's links. All motions draw the same random
numbers. Intervals and shares are of the bootstrap over takes, 95 %."""
MEANING = """What the models know decides what they plan. Under QR of Jᵀ the noise is a share of the
step ‖J⁺v‖: its plan is the minimum-norm motion from the best first pose. With J₁ given the noise is
one of the task, seen through J⁺: its plan seeks dexterity and pays nothing for what it moves in the
null space. The Gaussian model has less noise the nearer a pose is to a singular one, and none
beyond its bound u. No matrix model gives noise to a step in the null space, and each has a noise
that grows in proportion with the speed; the additive one has the same at any. Sway and play of the
laboratory grow with a power of the speed of all joints, the null space included: `speed_exponent`
is the factor on that power, at 0 they are the same at any speed. The other names are those of the
survey's disturbances."""
LIMITS = """The laboratory disturbs what it calls the tool's sway through the inverse Jacobian of
the arm's own task: of the youBot x, z and the turn of the tip, though x and z alone are planned. So
a plan that nears a pose where those three rows are singular is not warned of it by its own task.
The planner knows nothing of collisions. Physics is the synthetic laboratory's; no plan was
performed by a real robot."""


def sections(tables: dict[str, pd.DataFrame], takes: int) -> list[str]:
    """The page's sections from the study's ``tables`` by name."""
    spreads, orders = tables["planning_spreads"], tables["planning_orders"]
    predictions = tables["planning_predictions"]
    links = [
        page.write_csv(rows, "planning", name.removeprefix("planning_"))
        for name, rows in tables.items()
        if name != "planning_courses"
    ]
    return [
        ASKED.format(takes=takes),
        "## Answer",
        *answer(spreads, orders),
        page.figure("planning", "planning"),
        "## Predicted and realised, base condition",
        "Each over that of the minimum-norm motion; in brackets the interval.",
        *base_tables(spreads, predictions),
        "## In every physics",
        "The motion of the least yardstick, with the share of the resamplings in which it is that "
        "where it is not sure; how it relates to the minimum-norm motion; and Kendall's τ of the "
        "order that each model predicts with the realised one, 1 where they agree, −1 where they "
        "are opposite.",
        *physics_tables(spreads, orders),
        *refusals(tables["planning_refused"], spreads),
        "## What the models know",
        MEANING,
        "## How it is measured",
        HOW,
        "## Limits",
        LIMITS,
        f"All numbers: {', '.join(links)}.",
    ]


def base_tables(spreads: pd.DataFrame, predictions: pd.DataFrame) -> Iterator[str]:
    """A table an arm: a row for each motion, realised by part and kind and predicted by model."""
    for arm, rows in spreads[spreads["physics"] == BASE].groupby("arm", sort=False):
        said = predictions[(predictions["arm"] == arm) & (predictions["physics"] == BASE)]
        said = said.pivot(index="model", columns="motion", values="joints")
        known = [name for name in MODELS if name in said.index]
        lines = []
        for motion, own in rows.groupby("motion", sort=False):
            pairs = product(PARTS, KINDS)
            realised = [ratio_of(rows_of(own, pair).iloc[0]) for pair in pairs]
            modelled = [
                page.number(said.at[name, motion] / said.at[name, MINIMUM]) for name in known
            ]
            lines.append([MOTIONS[motion], *realised, *modelled])
        heads = [", ".join(pair) for pair in product(PARTS, KINDS)]
        size = rows_of(rows[rows["motion"] == RECORDED], YARDSTICK)["sum"].iloc[0]
        shares = [f"{MODELS[name]} {page.number(said.at[name, RECORDED] / size)}" for name in known]
        yield (
            f"Of the {page.number(size)} rad² that the takes of {arm}'s recorded motion have the "
            f"models, which were fitted to it, predict these shares: {', '.join(shares)}."
        )
        yield table([arm, *heads, *(f"predicted: {MODELS[name]}" for name in known)], lines)


def physics_tables(spreads: pd.DataFrame, orders: pd.DataFrame) -> Iterator[str]:
    """A table an arm: a row for each physics, its least motion and τ by model."""
    taus = rows_of(orders, YARDSTICK)
    for arm, rows in winners(spreads, YARDSTICK).groupby("arm", sort=False):
        own = taus[taus["arm"] == arm].pivot(index="physics", columns="model", values="tau")
        known = [name for name in MODELS if name in own and own[name].notna().any()]
        lines = [
            [
                row.physics.replace("_", " "),
                MOTIONS[row.motion] + ("" if row.least >= SURE else f" ({row.least:.0%})"),
                ratio_of(pd.Series(row._asdict())),
                *(page.number(own.at[row.physics, name]) for name in known),
            ]
            for row in rows.itertuples()
        ]
        yield table([arm, "least", "of minimum norm", *(f"τ: {MODELS[n]}" for n in known)], lines)


def refusals(refused: pd.DataFrame, spreads: pd.DataFrame) -> Iterator[str]:
    """What was not planned, and what the arm could not perform."""
    lost = rows_of(spreads, YARDSTICK)
    pairs = len(lost[["arm", "physics"]].drop_duplicates())
    lost = lost[lost["sum"].isna()]
    texts = [
        f"{MODELS[model]} has no plan in {len(rows)} of {pairs} pairs of arm and physics: {reason}."
        for (model, reason), rows in refused.groupby(["model", "reason"], sort=False)
    ]
    if len(lost):
        names = page.listed([MOTIONS[motion] for motion in lost["motion"].unique()])
        texts.append(
            f"{len(lost)} times the arm could not perform a motion ({names}): it comes to a pose "
            "at which the sway has no law."
        )
    if texts:
        yield " ".join([*texts, "Where a motion is missing, orders and shares are of the others."])
