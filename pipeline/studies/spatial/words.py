"""The page of the study: which reading is free of units, and what length and order do to others."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from pipeline.models.wishart.decomposition import LU
from pipeline.studies import page
from pipeline.studies.spatial.spreads import GAUSSIAN, UNITS_FREE
from pipeline.verdicts.wording import table

ROUNDING = 1e-9
TITLE = "What the closed forms say about a spatial arm"
NAMES = {
    "lu": "LU, not pivoted",
    "pivoted_lu": "LU, pivoted",
    "qr": "QR of J",
    "qr_transposed": "QR of Jᵀ",
    "gaussian": "Gaussian",
}
ASKED = """The task of an arm in space has rows in metres and rows in radians. A characteristic
length makes them one unit, and the paper names none. Here the exact covariance of a step, without
any recording, says what that length and the order of the rows do to each reading of "LU or QR" and
to the Gaussian model: on one motion of each arm, straight in its joints, with the pose of the
flange as the task and the σ_B that the paper prints. All noise is a share of the step ‖J⁺v‖ of the
joints."""
MEANING = """With QR of Jᵀ the noise is J⁺v disturbed alike in all directions that the task feels,
in proportion to ‖J⁺v‖ and to nothing else: at every pose the same share of the step. So the one
reading that is free of units knows nothing of dexterity beyond the speed of the joints; it is an
isotropic noise scaled by speed. A noise that depends on the pose beyond that speed needs a reading
with units, and then the length is a parameter of the model like σ_B, to be stated or fitted."""
LIMITS = """The Gaussian model is scaled to QR of Jᵀ at 1 m: its course over the length is shown and
not its size. Its bound u goes with the greatest norm of J⁺ on the motion. What a robot does in the
null space of its task is commanded and has no noise in either model. LU and pivoted LU of an arm
with more joints than rows eliminate the joints from the base on; another order of the joints is
another law too."""


def sections(spatial: pd.DataFrame, spatial_joints: pd.DataFrame) -> list[str]:
    """The page's sections from the study's tables."""
    links = [
        page.write_csv(rows, "spatial", name)
        for name, rows in {"spatial": spatial, "spatial_joints": spatial_joints}.items()
    ]
    return [
        ASKED,
        "## Answer",
        answer(spatial),
        page.figure("spatial", "spatial"),
        "## Joint by joint",
        "Standard deviation of each joint over the step, root mean square over the motion, at a "
        "characteristic length of 1 m; and how many times greater the share of the step that is "
        "noise is where it is greatest on the motion than where it is least.",
        *joints_tables(spatial, spatial_joints),
        MEANING,
        "## Limits",
        LIMITS,
        f"All numbers: {', '.join(links)}.",
    ]


def answer(spatial: pd.DataFrame) -> str:
    """What each reading makes of length and order, in bullets."""
    low, high = (page.number(end) for end in (spatial["length"].min(), spatial["length"].max()))
    lines = [f"With characteristic lengths from {low} to {high} m:\n"]
    for reading in (UNITS_FREE, "qr", "pivoted_lu", GAUSSIAN):
        texts = []
        for arm, rows in spatial[spatial["reading"] == reading].groupby("arm", sort=False):
            least, most = rows["spread"].min(), rows["spread"].max()
            best = page.number(rows.loc[rows["spread"].idxmin(), "length"])
            flat = most < (1 + ROUNDING) * least
            change = f"least at {best} m, and up to {page.number(most / least)} times as much"
            texts.append(
                f"{page.number(least)} of the step at any ({arm})" if flat else f"{change} ({arm})"
            )
        lines.append(f"- **{NAMES[reading]}**: {'; '.join(texts)}.")
    return "\n".join([*lines, *_orders(spatial)])


def _orders(spatial: pd.DataFrame) -> list[str]:
    rows = spatial[(spatial["reading"] == LU.name) & (spatial["length"] == 1.0)]
    texts = []
    for row in rows.itertuples():
        text = f"{row.small_pivot} of {row.orders} ({row.arm})"
        if row.small_pivot < row.orders:
            text += (
                f", the others {page.number(row.least)} to {page.number(row.greatest)} of the step"
            )
        texts.append(text)
    return [
        "- **The order of the rows** changes nothing but under LU without pivoting. Of its orders "
        f"a pivot is small somewhere on the motion, at any length, in {'; '.join(texts)}."
    ]


def joints_tables(spatial: pd.DataFrame, spatial_joints: pd.DataFrame) -> Iterator[str]:
    """A table an arm, with a row for each reading: its joints, and its course along the motion."""
    course = spatial[spatial["length"] == 1.0].set_index(["arm", "reading"])["course"]
    for arm, rows in spatial_joints.groupby("arm", sort=False):
        lines = [
            [NAMES[reading], *map(page.number, [*own["spread"], course[arm, reading]])]
            for reading, own in rows.groupby("reading", sort=False)
        ]
        yield table([arm, *rows["joint"].unique(), "greatest over least"], lines)
