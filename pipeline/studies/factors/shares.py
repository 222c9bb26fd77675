"""On which share of the paths each of the paper's statements holds, reading by reading.

The published σ̂_B, α̂, û and Σ̂_ω belong together, so that on the paper's path, with the reading
that it used, these statements hold at once:

- alike: the two matrix models differ little in the joints that both capture, all but the last;
- wider: the Wishart model is wider than the Gaussian one, on average over the joints ("more
  conservative");
- short: of the last joint's recorded spread the Wishart model captures less than all;
- size: in the joints that it captures its spread is about the recorded one.

"Alike" and "about" mean within a factor. At one speed a spread is proportional to the speed, and in
the mean over all steps, of which a share rests, to the root of the share that moves. So the first
two statements hang on the path alone. For the others the speed is taken in two ways: ``limit``, the
fastest joint at its limit; and ``matched``, at which the Gaussian model has the recorded trace,
which its fit to the recordings asks of it, on those paths on which no joint has to be faster than
the limit and what a servo may overshoot.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.studies.published import Published

SPEEDS = ("limit", "matched")
ALL = "all"
TOGETHER = ("but_wider", "but_size", "all")  # statements at once
QUANTILES = {"least": 0.0, "low": 0.05, "median": 0.5, "high": 0.95, "greatest": 1.0}
OF_A_PATH = ("tool", "norm", "travel", "gaussian")  # whatever the reading
NORMAL = 1.959964  # quantile of the normal law, of an interval of 95 %


@dataclass(frozen=True)
class Spreads:
    """Both models on P paths with the fastest joint at its limit at every step."""

    tool: np.ndarray  # (P,) m
    norm: np.ndarray  # (P,) greatest ‖J⁻¹‖_F on the path
    travel: np.ndarray  # (P,) rad, of the joint that moves farthest
    gaussian: np.ndarray  # (P,) rad, of every joint alike
    wishart: np.ndarray  # (R, P, n) rad; NaN where the reading meets a small pivot

    @property
    def ratio(self) -> np.ndarray:
        """(R, P) spread of the Wishart model, averaged over the joints, over that of the Gaussian
        one.
        """
        return self.wishart.mean(axis=2) / self.gaussian

    def subset(self, chosen: np.ndarray) -> Spreads:
        """The paths of the mask ``chosen`` (P,)."""
        paths = [getattr(self, name)[chosen] for name in OF_A_PATH]
        return Spreads(*paths, self.wishart[:, chosen])


def joined(parts: list[Spreads]) -> Spreads:
    """The paths of all ``parts``."""
    paths = [np.concatenate([getattr(part, name) for part in parts]) for name in OF_A_PATH]
    return Spreads(*paths, np.concatenate([part.wishart for part in parts], axis=1))


def needed_speed(spreads: Spreads, published: Published, rest: float) -> np.ndarray:
    """(P,) speed in shares of the limit at which the Gaussian model has the trace of Σ̂_ω."""
    n = len(published.covariance)
    return np.sqrt(np.trace(published.covariance) / (n * (1 - rest))) / spreads.gaussian


def interval(hits: int, trials: int) -> tuple[float, float]:
    """95 % interval of a probability by ``hits`` of ``trials`` (Wilson, J. Am. Stat. Assoc. 22,
    1927); from 0 to 1 without a trial.
    """
    if trials == 0:
        return 0.0, 1.0
    share, z = hits / trials, NORMAL**2 / trials
    middle = (share + z / 2) / (1 + z)
    half = np.sqrt(z * share * (1 - share) + z**2 / 4) / (1 + z)
    return max(0.0, middle - half), min(1.0, middle + half)


def statements(
    spreads: Spreads, speed: np.ndarray, published: Published, factor: float
) -> dict[str, np.ndarray]:
    """Which statements hold, (R, P) each; none where a reading meets a small pivot.

    ``speed`` (P,) is the root of the mean square speed of all steps in shares of the limit.
    """
    most = np.log(factor)
    wishart, recorded = spreads.wishart * speed[:, None], published.spread
    captured = slice(0, len(recorded) - 1)
    gaussian = (spreads.gaussian * speed)[:, None]
    alike = np.all(np.abs(np.log(wishart / gaussian))[..., captured] <= most, axis=2)
    size = np.all(np.abs(np.log(wishart / recorded))[..., captured] <= most, axis=2)
    result = {
        "alike": alike,
        "wider": spreads.ratio > 1,
        "short": wishart[..., -1] < recorded[-1],
        "size": size,
    }
    result["but_wider"] = alike & result["short"] & size
    result["but_size"] = alike & result["short"] & result["wider"]
    result["all"] = result["but_wider"] & result["wider"]
    return result


def share_table(
    spreads: Spreads,
    names: Mapping[str, list],
    published: Published,
    factor: float,
    rests: Sequence[float],
    overspeed: float,
    subsets: Mapping[str, np.ndarray],
) -> pd.DataFrame:
    """The table ``factors``.

    Args:
        spreads: of all paths.
        names: columns that name the R readings.
        published: what the statements are held against.
        factor: within which spreads pass for alike.
        rests: shares of the steps at rest; the subsets are counted at the first.
        overspeed: greatest speed in shares of the limit.
        subsets: masks (P,) of paths that are counted apart, by name.
    """
    whole = np.ones(len(spreads.tool), dtype=bool)
    cuts = [(ALL, whole, rest) for rest in rests]
    cuts += [(name, chosen, rests[0]) for name, chosen in subsets.items()]
    tables = []
    for subset, chosen, rest in cuts:
        part = spreads.subset(chosen)
        need = needed_speed(part, published, rest)
        for speed, possible, share in (
            (SPEEDS[0], np.ones(len(need), dtype=bool), np.ones(len(need))),
            (SPEEDS[1], need <= overspeed, need),
        ):
            mean_speed = (share * np.sqrt(1 - rest))[possible]
            rows = list(_rows(part.subset(possible), mean_speed, published, factor))
            labels = {"subset": subset, "rest": rest, "speed": speed}
            tables.append(pd.DataFrame(rows).assign(**names, **labels))
    return pd.concat(tables, ignore_index=True)


def _rows(
    spreads: Spreads, speed: np.ndarray, published: Published, factor: float
) -> Iterator[dict[str, float]]:
    """A row a reading."""
    held, paths = statements(spreads, speed, published, factor), len(speed)
    for reading, ratio in enumerate(spreads.ratio):
        regular = ratio[np.isfinite(ratio)]
        row = {"paths": paths, "small_pivot": paths - len(regular)}
        for name, holds in held.items():
            hits = np.count_nonzero(holds[reading])
            row[name] = hits / paths if paths else np.nan
            if name in TOGETHER:
                row[f"{name}_low"], row[f"{name}_high"] = interval(hits, paths)
        for name, level in QUANTILES.items():
            row[f"ratio_{name}"] = np.quantile(regular, level) if len(regular) else np.nan
        yield row


def path_table(
    spreads: Spreads, published: Published, rests: Sequence[float], overspeed: float, drawn: int
) -> pd.DataFrame:
    """The table ``factor_paths``: how fast the paths have to be driven for the published numbers to
    go together; ``drawn`` paths were drawn for those of ``spreads``.
    """
    rows = []
    for rest in rests:
        need = needed_speed(spreads, published, rest)
        row = {"rest": rest, "drawn": drawn, "paths": len(need)}
        row["within_speed"] = np.count_nonzero(need <= overspeed)
        rows.append(row | {"speed_least": need.min(), "speed_median": np.median(need)})
    return pd.DataFrame(rows)
