"""Files of exported models of the planar chain of planar_poses.py, of known parameters."""

import json
from pathlib import Path

import numpy as np

from pipeline.arm.chain import Chain
from pipeline.models.exported.reader import FORMAT
from pipeline.models.exported.writer import chain_record

ROOT_OF_NOISE = np.array([[3.0, 0.0, 0.0], [-2.0, 4.0, 0.0], [1.0, 1.0, 5.0]]) * 1e-3
PARAMETERS = {
    "additive": {"noise_covariance": (ROOT_OF_NOISE @ ROOT_OF_NOISE.T).tolist()},
    "gaussian": {"alpha": 0.05, "u": 30.0},
    "wishart": {"sigma_b": 0.25, "decomposition": "qr_transposed"},
}


def write_model(
    file: Path,
    kind: str,
    chain: Chain,
    *,
    share: float = 0.0,
    width: float = 3.5,
    speed: float = 1.0,
) -> Path:
    """``file`` with the model of ``kind``, fitted at poses up to ``width`` rad from the elbow's
    right angle and at task speeds up to ``speed`` times 0.5 m/s and 4 rad/s.
    """

    def ends(middle: float, width: float, unit: str) -> dict:
        return {"least": middle - width, "greatest": middle + width, "unit": unit}

    poses = {"a": 0.3, "b": np.pi / 2, "c": -0.4}
    speeds = dict.fromkeys(chain.task, (0.5, "m/s")) | {"phi": (4.0, "rad/s")}
    record = {
        "format": FORMAT,
        "model": kind,
        "rate_per_s": 100.0,
        "parameters": {"kind": kind} | PARAMETERS[kind],
        "closed_loop_share": share,
        "ranges": {
            "pose": {name: ends(at, width, "rad") for name, at in poses.items()},
            "speed": {
                name: ends(0.0, most * speed, unit)
                for name, (most, unit) in speeds.items()
            },
        },
        "arm": chain_record(chain),
    }
    file.write_text(json.dumps(record))
    return file
