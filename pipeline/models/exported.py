"""Reader of exported models by NumPy alone, which the tool export copies beside a model."""

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import PlanarChain
from pipeline.arm.interface import Chain
from pipeline.arm.serial import SerialChain
from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.models.joint_steps import KIND, JointStepModel, build_joint_steps
from pipeline.models.kinds import build_model
from pipeline.models.model import MotionModel

FORMAT = "motion model 1"
ARMS = {"planar": PlanarChain, "serial": SerialChain}
UNLIMITED = {"lower": -np.inf, "upper": np.inf, "max_speed": np.inf}  # null in the file
# of a range's width, and beside it in its own unit, that a pose or a command may be beyond it
# before it is warned of
MARGIN, SLACK = 0.05, 1e-3


class OutsideRanges(UserWarning):
    """A pose or a command beyond those that the model was fitted to."""


@dataclass(frozen=True)
class ExportedModel:
    """p(q_{k+1} | q_k) for the command v of a step of 1/rate s, as it was fitted.

    ``q`` (..., n) are joint angles in rad, ``v`` (m,) or (..., m) steps of the task in m and rad,
    (m + n) of an arm with more joints than task rows. Beyond the ranges of the fit each method
    warns :class:`OutsideRanges`, of each joint and row once. All raise SingularJacobianError, and
    ModelDomainError for another number of joints or rows and where the moments do not exist or the
    recordings cannot tell them.
    """

    law: MotionModel | JointStepModel
    chain: Chain
    record: Mapping[str, Any]  # contents of the file
    _warned: set[str] = field(default_factory=set, compare=False)

    def __repr__(self) -> str:
        joints, rate = self.record.get("joints", []), self.record["rate_per_s"]
        named = f" of {self.record['dataset']}" if "dataset" in self.record else ""
        return f"<motion model {self.record['model']}{named}: {', '.join(joints)} at {rate:g}/s>"

    def covariance_of_joint_step(self, dq: ndarray) -> ndarray:
        """(..., n, n) covariance in rad² of the step of the joints for commanded steps ``dq``
        (..., n) in rad, of models whose noise depends on the joint step alone (ModelDomainError).
        """
        dq = self._shaped("dq", dq, (len(self.chain.lower),), "rad a step")
        of_step = getattr(self.law, "covariance_of_joint_step", None)
        if of_step is None:
            raise ModelDomainError(
                f"the noise of {self.record['model']} depends on the pose; use covariance(q, v)"
            )
        self._warn("joint speed", self.record["rate_per_s"] * dq)
        return of_step(dq)

    def mean(self, q: ndarray, v: ndarray) -> ndarray:
        """(..., n) E[q_{k+1}] in rad."""
        return self.law.mean(self.chain, *self._checked(q, v))

    def covariance(self, q: ndarray, v: ndarray) -> ndarray:
        """(..., n, n) Cov(q_{k+1}) in rad²."""
        return self.law.covariance(self.chain, *self._checked(q, v))

    def step(self, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        """(..., n) a random next pose in rad for each of ``q``, as a particle filter needs it."""
        return self.law.sample(self.chain, *self._checked(q, v), rng)

    def sample(self, q: ndarray, v: ndarray, size: int, rng: Generator) -> ndarray:
        """(size, ..., n) independent next poses in rad from the same ``q``."""
        q, v = self._checked(q, v)
        return self.law.sample(self.chain, np.broadcast_to(q, (size, *q.shape)), v, rng)

    def log_density(self, q: ndarray, v: ndarray, q_next: ndarray, measurement=None) -> ndarray:
        """(...,) ln p(q_next | q) in rad⁻ⁿ; with ``measurement`` (n, n) in rad² of the next pose as
        it is measured (for a Wishart model by a quadrature that needs the project's compiler).
        Raises ModelDomainError where the step has no density, as a matrix model's at rest.
        """
        q, v = self._checked(q, v)
        return self.law.log_density(self.chain, q, v, np.asarray(q_next, float), measurement)

    def command(self, q: ndarray, v: ndarray, target: ndarray) -> ndarray:
        """``v`` and the closed loop's correction at ``q``, a share of the way to ``target``, the
        pose of the tip that it is held to; ``v`` itself for an open loop.
        """
        off = self.chain.displacement(self.chain.pose(np.asarray(q, float)), target)
        command = np.array(np.broadcast_to(v, (*off.shape[:-1], np.shape(v)[-1])), float)
        command[..., : len(self.chain.task)] += self.record["closed_loop_share"] * off
        return command

    def _checked(self, q: ndarray, v: ndarray) -> tuple[ndarray, ndarray]:
        """Both as arrays of the arm's sizes, after a warning beyond the ranges of the fit."""
        n, m = len(self.chain.lower), len(self.chain.task)
        q = self._shaped("q", q, (n,), "rad")
        v = self._shaped("v", v, (m, m + n) if n > m else (m,), f"steps of {self.chain.task}")
        self._warn("pose", q)
        self._warn("speed", self.record["rate_per_s"] * v)
        return q, v

    def _shaped(self, name: str, values: Any, sizes: tuple[int, ...], unit: str) -> ndarray:
        array = np.asarray(values, dtype=float)
        if array.ndim == 0 or array.shape[-1] not in sizes:
            raise ModelDomainError(
                f"{name} must have {' or '.join(map(str, sizes))} numbers in its last axis "
                f"({unit}), got shape {array.shape}"
            )
        return array

    def _warn(self, what: str, values: ndarray) -> None:
        """Warn once of each joint or row of ``values`` beyond the ranges of ``what``."""
        ranges = self.record["ranges"].get(what, {})
        for (name, ends), each in zip(ranges.items(), np.moveaxis(values, -1, 0), strict=False):
            low, high = ends["least"], ends["greatest"]
            slack = SLACK + MARGIN * (high - low)
            beyond = each[(each < low - slack) | (each > high + slack)]
            if beyond.size and f"{what} {name}" not in self._warned:
                self._warned.add(f"{what} {name}")
                found = f"{what} of {name}: {beyond.flat[0]:.4g} {ends['unit']}"
                where = f"{low:.4g} to {high:.4g}, where the model {self.record['model']}"
                warnings.warn(f"{found} is outside {where} was fitted", OutsideRanges, stacklevel=4)


def chain_record(chain: Chain) -> dict[str, Any]:
    """The numbers of ``chain`` in plain values, without any robot's description."""
    plain = {each.name: getattr(chain, each.name) for each in fields(chain)}
    for name, value in plain.items():
        plain[name] = value.tolist() if isinstance(value, ndarray) else value
    for name in UNLIMITED:
        plain[name] = [limit if np.isfinite(limit) else None for limit in plain[name]]
    return {"kind": "planar" if isinstance(chain, PlanarChain) else "serial"} | plain


def _chain(record: Mapping[str, Any]) -> Chain:
    values = dict(record)
    for name, limit in UNLIMITED.items():
        values[name] = [limit if each is None else each for each in record[name]]
    for name, value in values.items():
        if isinstance(value, list):
            values[name] = tuple(value) if name == "task" else np.array(value)
    return ARMS[values.pop("kind")](**values)


def read_exported(file: Path) -> ExportedModel:
    """The model that the tool export wrote to ``file``; raises ContractError for any other file."""
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        if record["format"] != FORMAT:
            raise ValueError(f"format {record['format']!r}, not {FORMAT!r}")
        parameters = record["parameters"]
        build = build_joint_steps if parameters["kind"] == KIND else build_model
        return ExportedModel(build(parameters), _chain(record["arm"]), record)
    except (ContractError, OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(
            f"no exported model ({error!r}); write one by python -m pipeline export MODEL",
            file=file,
        ) from None
