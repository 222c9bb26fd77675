"""The truth that a synthetic dataset has beside its recordings; the stage score alone opens it."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.core import contracts
from pipeline.core.options.dataset import Dataset


def truth_of(dataset: Dataset) -> Path:
    """The folder where a synthetic dataset has the truth."""
    return Path(dataset.recordings).parent / "truth"


def held_against(joints: pd.DataFrame, dataset: Dataset) -> tuple[pd.DataFrame, bool]:
    """The joint angles that a filter is held against, and whether they are the true ones: the
    measured ``joints``, unless the cameras that measured them are what the filter weighs by, and
    the dataset has the truth.
    """
    if dataset.measurement == "tip" and contracts.exists("true_joints", truth_of(dataset)):
        return contracts.read("true_joints", truth_of(dataset)), True
    return joints, False
