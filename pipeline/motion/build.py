"""A fitted motion model from the parameters that the stage fit wrote."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pipeline.errors import ContractError
from pipeline.motion.additive import AdditiveModel
from pipeline.motion.decomposition import chosen
from pipeline.motion.gaussian import GaussianModel
from pipeline.motion.gaussian_forward import GaussianForwardModel
from pipeline.motion.model import MotionModel
from pipeline.motion.scaled import ScaledModel
from pipeline.motion.student import StudentModel
from pipeline.motion.wishart import WishartModel


def build_model(parameters: dict) -> MotionModel:
    """The model with these ``parameters``: its kind and, in plain values, the fields of its class.

    Raises ContractError where they are none of a motion model, ModelDomainError where they are outside the model's range.
    """
    try:
        match parameters:
            case {"kind": "additive", "noise_covariance": covariance}:
                return AdditiveModel(np.array(covariance))
            case {"kind": "wishart", "sigma_b": sigma_b, "decomposition": decomposition, **given}:
                return WishartModel(sigma_b, chosen(decomposition, given.get("left")))
            case {"kind": "gaussian", "form": "forward", "alpha": alpha, "u": u}:
                return GaussianForwardModel(alpha, u)
            case {"kind": "gaussian", "alpha": alpha, "u": u}:
                return GaussianModel(alpha, u)
            case {"kind": "scaled", "floor": floor, "gain": gain}:
                return ScaledModel(np.array(floor), np.array(gain))
            case {"kind": "student", "nu": nu, "scale": scale}:
                return StudentModel(nu, np.array(scale))
    except (TypeError, ValueError) as error:
        raise ContractError(f"not the parameters of a motion model ({error}); run the stage fit again") from None
    raise ContractError("not the parameters of a motion model; run the stage fit again")


def fitted_model(folder: Path) -> MotionModel:
    """The model whose parameters stand in ``folder/parameters.json``; raises what :func:`build_model` does, with the file."""
    file = Path(folder) / "parameters.json"
    try:
        parameters = json.loads(file.read_text())
    except (OSError, ValueError) as error:
        raise ContractError(f"the fitted parameters cannot be read ({error}); run the stage fit", file=file) from None
    try:
        return build_model(parameters)
    except ContractError as error:
        raise ContractError(error.message, file=file) from None
