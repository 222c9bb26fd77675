"""Which repetitions in a controller's logs were disturbed, by the dataset's options, and what the
rule can find.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.core.options.logs import JointLog
from pipeline.recordings.disturbances import beside_others, disturbances, smallest_push
from pipeline.recordings.logged_movement import RESIDUALS, Take
from pipeline.recordings.quality import quality_row


def disturbed_takes(
    takes: Mapping[str, Take],
    signals: Mapping[str, np.ndarray],
    options: JointLog,
    rate: float,
    raw: Path,
) -> tuple[set[str], list[dict]]:
    """Names of the disturbed takes, how far each take is from the others, and what the rule finds;
    RecordingError where the option refuses disturbed ones. ``signals`` are those of
    :meth:`Take.logged`, each (takes, K, joints), at ``rate`` rows a second.
    """
    residuals = signals[RESIDUALS]
    others = [values for name, values in signals.items() if name != RESIDUALS]
    limit = np.inf if options.residual_limit is None else options.residual_limit
    result, quality = set(), []
    scores = disturbances(residuals, others, rate)
    for (name, take), residual, distance, score in zip(
        takes.items(), residuals, beside_others(residuals), scores, strict=True
    ):
        largest = np.abs(residual).max()
        quality.append(
            quality_row(name, "training", "joint log", "residual_beside_others", distance, "rad")
        )
        quality.append(
            quality_row(
                name, "training", "joint log", "disturbance", score, "robust standard deviations"
            )
        )
        quality.append(
            quality_row(name, "training", "joint log", "greatest_residual", largest, "rad")
        )
        if score <= options.disturbed_beyond and largest <= limit:
            continue
        if options.disturbed == "refuse":
            raise RecordingError(
                f"the repetition from row {take.first} was disturbed: its residual, or another "
                f"signal, is {score:.3g} robust standard deviations from the median over the "
                f"repetitions; the residual is at most {largest:.3g} rad",
                file=raw,
                take=name,
                key="dataset.joint_log.disturbed",
            )
        result.add(name)
        quality.append(
            quality_row(take.name, "training", "joint log", "disturbed_from_row", take.first, "row")
        )
    sound = [name not in result for name in takes]
    push = smallest_push(residuals[sound], options.disturbed_beyond, rate)
    if np.isfinite(push):
        quality += [
            quality_row(name, "training", "joint log", "smallest_push_found", push, "rad")
            for name in dict.fromkeys(take.name for take in takes.values())
        ]
    return result, quality
