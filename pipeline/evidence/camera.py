"""Evidence on the noise of the joint angles from the depth camera."""

import numpy as np
import pandas as pd

from pipeline.core.columns import matrices, members, values
from pipeline.evidence.table import evidence_row, evidence_table
from pipeline.statistics.curves import root_mean_square, variation


def camera_evidence(noise: pd.DataFrame, slopes: pd.DataFrame | None = None) -> pd.DataFrame:
    """Return size and variation over time of the noise in the table ``kinect_noise``, and the
    ``slopes`` of :func:`pipeline.perception.depth_noise.error_slopes` near a sample.

    The bias is in standard errors: a zero bias has a size of about 1, a constant one a variation of
    about 1.
    """
    of_all, takes = noise[noise["take"] == "none"], noise["take"].nunique() - 1
    joints, rows = members(of_all, "b"), []
    variances = np.diagonal(matrices(of_all, "r", joints), axis1=1, axis2=2)
    for joint, bias, variance in zip(joints, values(of_all, "b").T, variances.T, strict=True):
        error = np.sqrt(variance.mean() / takes)
        rows += [
            evidence_row("camera_bias", root_mean_square(bias) / error, joint=joint),
            evidence_row("camera_bias_variation", bias.std() / error, joint=joint),
            evidence_row("camera_std_variation", variation(np.sqrt(variance)), joint=joint),
        ]
    for own in () if slopes is None else slopes.itertuples():
        error = {"standard_error": own.standard_error, "joint": own.joint}
        rows.append(evidence_row("depth_error_slope", own.slope, **error))
    return evidence_table(rows)
