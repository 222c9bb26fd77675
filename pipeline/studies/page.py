"""What the page of every study is made of: its figures with their captions, its tables, and where
they lie.

The page of the study NAME is ``reports/studies/NAME.md``; beside it, in ``reports/studies/NAME``,
lie its figures and, as CSV, what is too long for a page.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core import contracts
from pipeline.core.options.analysis import Compute
from pipeline.figures.drawing import draw_all

ROUNDING = 1e-12
DATA, REPORTS = Path("data/studies"), Path("reports/studies")


def draw_figures(study: str, options: dict[str, object], compute: Compute) -> None:
    """Draw the figures of ``study`` whose tables there are; ``options`` are those that figures may
    name.
    """
    out = REPORTS / study / "figures"
    draw_all(f"pipeline.studies.{study}.figures", out, options, compute, f"{study}: figures")


def figure(study: str, name: str) -> str:
    """A figure of ``study`` with its caption, or why it is not there."""
    captions = json.loads((REPORTS / study / "figures/captions.json").read_text(encoding="utf-8"))
    if name not in captions:
        return "There is no figure: the dataset lacks what it would show."
    caption = captions[name]
    image = f"![{caption['title']}]({study}/figures/{name}.png)"
    return f"{image}\n\n**{caption['title']}.** {caption['caption']}"


def write_csv(rows: pd.DataFrame, study: str, name: str) -> str:
    """Write ``rows`` beside the page of ``study``; the link to them."""
    file = REPORTS / study / f"{name}.csv"
    contracts.write_text(rows.to_csv(index=False), file)
    return f"[{study}/{name}.csv]({study}/{name}.csv)"


def write_page(study: str, title: str, sections: Iterable[str]) -> None:
    """Write the page of ``study``: ``title`` and ``sections``, Markdown each."""
    text = "\n\n".join([f"# {title}", *sections]) + "\n"
    contracts.write_text(text, REPORTS / f"{study}.md")


def number(value: float) -> str:
    """Three significant digits; counts as they are; a dash for what does not exist."""
    if pd.isna(value):
        return "–"
    if np.isinf(value):
        return "∞" if value > 0 else "−∞"
    whole = float(value).is_integer() and abs(value) < 1e9
    return f"{value:,.0f}" if whole else f"{value:.3g}"


def interval(middle: float, low: float, high: float) -> str:
    """A difference with its sign and, in brackets, the ends of its interval where there is one."""
    if pd.isna(middle):
        return "–"
    # what rounding leaves of an exact zero is none
    middle, low, high = (0.0 if abs(x) < ROUNDING else x for x in (middle, low, high))
    return f"{middle:+.3g}" + ("" if pd.isna(low) else f" [{low:+.3g}, {high:+.3g}]")


def listed(names: Sequence[str]) -> str:
    """``names`` as a phrase: a, b and c."""
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
