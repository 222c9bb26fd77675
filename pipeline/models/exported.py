"""Reader of exported models with NumPy alone; the tool export copies it beside the model."""

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
UNLIMITED = {"lower": -np.inf, "upper": np.inf, "max_speed": np.inf}  # null in the file
# a value beyond its range by more than MARGIN·width + SLACK (range's unit) causes a warning
MARGIN, SLACK = 0.05, 1e-3


class OutsideRanges(UserWarning):
    """Warns of a pose or a command outside the ranges that the model was fitted to."""


@dataclass(frozen=True)
class ExportedModel:
    """Fitted law p(q_{k+1} | q_k) for the command v of a step of 1/rate s.

    ``q`` (..., n) are joint angles in rad, ``v`` (m,) or (..., m) task steps in m and rad, (m + n)
    for an arm with more joints than task rows. Each method warns :class:`OutsideRanges` once for
    each joint and row outside the ranges of the fit. All raise SingularJacobianError. They raise
    ModelDomainError for a wrong number of joints or rows, and for moments that do not exist or that
    the recordings do not determine.
    """

    law: MotionModel | JointStepModel
    chain: Chain
    record: Mapping[str, Any]  # contents of the file
    _warned: set[str] = field(default_factory=set, compare=False)

    def __repr__(self) -> str:
        joints, rate = ", ".join(self.record.get("joints", [])), self.record["rate_per_s"]
        return f"<motion model {self.record['model']}: {joints} at {rate:g}/s>"

    def covariance_of_joint_step(self, dq: ndarray) -> ndarray:
        """Covariance (..., n, n) in rad² for commanded joint steps ``dq`` (..., n) in rad. Raises
        ModelDomainError for a model whose noise depends on more than the joint step.
        """
        dq = self._array("dq", dq, (len(self.chain.lower),), "rad a step")
        of_step = getattr(self.law, "covariance_of_joint_step", None)
        if of_step is None:
            message = f"the noise of {self.record['model']} depends on the pose"
            raise ModelDomainError(f"{message}; use covariance(q, v)")
        self._warn("joint speed", self.record["rate_per_s"] * dq)
        return of_step(dq)

    def mean(self, q: ndarray, v: ndarray) -> ndarray:
        """(..., n) E[q_{k+1}] in rad."""
        return self.law.mean(self.chain, *self._arrays(q, v))

    def covariance(self, q: ndarray, v: ndarray) -> ndarray:
        """(..., n, n) Cov(q_{k+1}) in rad²."""
        return self.law.covariance(self.chain, *self._arrays(q, v))

    def step(self, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        """(..., n) one random next pose in rad for each of ``q``, as in a particle filter."""
        return self.law.sample(self.chain, *self._arrays(q, v), rng)

    def sample(self, q: ndarray, v: ndarray, size: int, rng: Generator) -> ndarray:
        """(size, ..., n) independent next poses in rad from the same ``q``."""
        q, v = self._arrays(q, v)
        return self.law.sample(self.chain, np.broadcast_to(q, (size, *q.shape)), v, rng)

    def log_density(self, q: ndarray, v: ndarray, q_next: ndarray, measurement=None) -> ndarray:
        """(...,) ln p(q_next | q) in rad⁻ⁿ. With a covariance ``measurement`` (n, n) in rad²,
        ``q_next`` includes normal measurement noise (a Wishart model then needs numba). Raises
        ModelDomainError for a step without a density, e.g. of a matrix model at rest.
        """
        q, v = self._arrays(q, v)
        return self.law.log_density(self.chain, q, v, np.asarray(q_next, float), measurement)

    def command(self, q: ndarray, v: ndarray, target: ndarray) -> ndarray:
        """Command (..., m) or (..., m + n): ``v`` plus κ times the displacement from the tip's pose
        at ``q`` to its ``target`` pose. κ = 0 for an open loop.
        """
        off = self.chain.displacement(self.chain.pose(np.asarray(q, float)), target)
        command = np.array(np.broadcast_to(v, (*off.shape[:-1], np.shape(v)[-1])), float)
        command[..., : len(self.chain.task)] += self.record["closed_loop_share"] * off
        return command

    def _arrays(self, q: ndarray, v: ndarray) -> tuple[ndarray, ndarray]:
        """Return ``q`` and ``v`` as arrays; warn of values outside the ranges of the fit."""
        n, m = len(self.chain.lower), len(self.chain.task)
        q = self._array("q", q, (n,), "rad")
        v = self._array("v", v, (m, m + n) if n > m else (m,), f"steps of {self.chain.task}")
        self._warn("pose", q)
        self._warn("speed", self.record["rate_per_s"] * v)
        return q, v

    def _array(self, name: str, values: Any, sizes: tuple[int, ...], unit: str) -> ndarray:
        array = np.asarray(values, dtype=float)
        if array.ndim == 0 or array.shape[-1] not in sizes:
            raise ModelDomainError(
                f"{name} must have {' or '.join(map(str, sizes))} numbers in its last axis "
                f"({unit}), got shape {array.shape}"
            )
        return array

    def _warn(self, what: str, values: ndarray) -> None:
        """Warn once for each joint or row of ``values`` outside the fitted ranges of ``what``."""
        ranges = self.record["ranges"].get(what, {})
        for (name, ends), each in zip(ranges.items(), np.moveaxis(values, -1, 0), strict=False):
            low, high = ends["least"], ends["greatest"]
            slack = SLACK + MARGIN * (high - low)
            beyond = each[(each < low - slack) | (each > high + slack)]
            if beyond.size and f"{what} {name}" not in self._warned:
                self._warned.add(f"{what} {name}")
                found = f"{what} of {name}: {beyond.flat[0]:.4g} {ends['unit']}"
                where = f"{low:.4g} to {high:.4g} of the fit of the model {self.record['model']}"
                warnings.warn(f"{found} is outside the range {where}", OutsideRanges, stacklevel=4)


def chain_record(chain: Chain) -> dict[str, Any]:
    """Parameters of ``chain`` as plain values, enough to rebuild it without a URDF file."""
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
    return {"planar": PlanarChain, "serial": SerialChain}[values.pop("kind")](**values)


def read_exported(file: Path) -> ExportedModel:
    """Read the model that the tool export wrote to ``file``, or raise ContractError."""
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        if record["format"] != FORMAT:
            raise ValueError(f"format {record['format']!r}, not {FORMAT!r}")
        parameters = record["parameters"]
        build = build_joint_steps if parameters["kind"] == KIND else build_model
        return ExportedModel(build(parameters), _chain(record["arm"]), record)
    except (ContractError, OSError, ValueError, KeyError, TypeError) as error:
        message = f"not an exported model ({error!r}); write one by python -m pipeline export MODEL"
        raise ContractError(message, file=file) from None
