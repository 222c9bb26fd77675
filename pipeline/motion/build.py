"""A fitted motion model from the parameters that the stage fit wrote."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pipeline.errors import ContractError
from pipeline.motion.additive import AdditiveModel
from pipeline.motion.gaussian import GaussianModel
from pipeline.motion.model import MotionModel
from pipeline.motion.scaled import ScaledModel
from pipeline.motion.student import StudentModel
from pipeline.motion.wishart import WishartModel


def fitted_model(folder: Path) -> MotionModel:
    """The model whose parameters stand in ``folder/parameters.json``; raises ContractError where they do not, ModelDomainError where
    they are outside the model's range."""
    file = Path(folder) / "parameters.json"
    try:
        match json.loads(file.read_text()):
            case {"kind": "additive", "noise_covariance": covariance}:
                return AdditiveModel(np.array(covariance))
            case {"kind": "wishart", "sigma_b": sigma_b, "decomposition": decomposition}:
                return WishartModel(sigma_b, decomposition)
            case {"kind": "gaussian", "alpha": alpha, "u": u}:
                return GaussianModel(alpha, u)
            case {"kind": "scaled", "floor": floor, "gain": gain}:
                return ScaledModel(np.array(floor), np.array(gain))
            case {"kind": "student", "nu": nu, "scale": scale}:
                return StudentModel(nu, np.array(scale))
    except (OSError, TypeError, ValueError) as error:
        raise ContractError(f"the fitted parameters cannot be read ({error}); run the stage fit", file=file) from None
    raise ContractError("not the parameters of a motion model; run the stage fit again", file=file)
