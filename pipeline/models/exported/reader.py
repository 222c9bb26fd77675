"""Reader of exported models; its copy beside a model, by the tool export, needs only NumPy."""

import json
import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import ROWS, Chain, PlanarChain, SerialChain
from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.models.joint_error.outlook import Outlook
from pipeline.models.kinds import build_model
from pipeline.models.model import corrected_command

FORMAT = "motion model 2"
UNLIMITED = {"lower": -np.inf, "upper": np.inf, "max_speed": np.inf}  # null in the file
# a value beyond its range by more than MARGIN·width + SLACK (range's unit) causes a warning
MARGIN, SLACK = 0.05, 1e-3
SCORED = 0.5  # s, longest horizon at which a joint error law is fitted and scored
MOST = (
    1e12  # greatest magnitude of a number in a file, far above any parameter of an arm
)
# errors of a file that is not an exported model
INVALID = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    RecursionError,
    ModelDomainError,
)
SAME_PERIOD = 1e-6  # greatest relative difference of two periods


class UnconfirmedBands(UserWarning):
    """Warns of predicted standard deviations that held-out motions did not confirm."""


class OutsideRanges(UserWarning):
    """Warns of a pose, a command or a horizon outside the ranges that the model was fitted to."""


@dataclass(frozen=True)
class Exported:
    """A fitted law for steps of 1/rate s, and the ``record`` of its file. Methods warn
    :class:`OutsideRanges` once for each joint and row outside the ranges of the fit.
    """

    law: Any
    record: Mapping[str, Any]  # contents of the file
    chain: Chain | None = None
    _warned: set[str] = field(default_factory=set, compare=False)

    def __repr__(self) -> str:
        joints, rate = (
            ", ".join(self.record.get("joints", [])),
            self.record["rate_per_s"],
        )
        return f"<motion model {self.record['model']}: {joints} at {rate:g}/s>"

    def require_period(self, period: float | None) -> None:
        """Raise ModelDomainError where ``period`` in s is not the period of the fit."""
        own = 1 / self.record["rate_per_s"]
        if period is not None and not abs(period / own - 1) <= SAME_PERIOD:
            message = f"the model {self.record['model']} is of steps of {own:.9g} s, not {period:g}"
            raise ModelDomainError(
                f"{message}: resample the commands, or fit a model at this rate"
            )

    def _array(
        self, name: str, values: Any, sizes: tuple[int, ...], unit: str
    ) -> ndarray:
        """Return ``values`` as an array; ModelDomainError for another last axis than ``sizes``."""
        array = np.asarray(values, dtype=float)
        if array.ndim == 0 or array.shape[-1] not in sizes:
            message = f"{name} must have {' or '.join(map(str, sizes))} numbers in its last axis"
            raise ModelDomainError(f"{message} ({unit}), got shape {array.shape}")
        return array

    def _warn(self, what: str, values: ndarray) -> None:
        """Warn once for each joint or row of ``values`` outside the fitted ranges of ``what``."""
        ranges = self.record["ranges"].get(what, {})
        for (name, ends), each in zip(
            ranges.items(), np.moveaxis(values, -1, 0), strict=False
        ):
            low, high = ends["least"], ends["greatest"]
            slack = SLACK + MARGIN * (high - low)
            beyond = each[(each < low - slack) | (each > high + slack)]
            if beyond.size and f"{what} {name}" not in self._warned:
                self._warned.add(f"{what} {name}")
                found = f"{what} of {name}: {beyond.flat[0]:.4g} {ends['unit']}"
                where = f"{low:.4g} to {high:.4g} of the fit of the model {self.record['model']}"
                warnings.warn(
                    f"{found} is outside the range {where}", OutsideRanges, stacklevel=4
                )


class ExportedModel(Exported):
    """Fitted law p(q_{k+1} | q_k) for the command v of a step of 1/rate s.

    ``q`` (..., n) are joint angles in rad. ``task_step`` v (m,) or (..., m) are task steps in m and
    rad, (m + n) for an arm with more joints than task rows; it is an argument by name, so that a
    step of the joints cannot be taken for it. All methods raise SingularJacobianError. They raise
    ModelDomainError for a wrong number of joints or rows, and for moments that do not exist or that
    the recordings do not determine.
    """

    def mean(self, q: ndarray, *, task_step: ndarray) -> ndarray:
        """(..., n) E[q_{k+1}] in rad."""
        return self.law.mean(self.chain, *self._arrays(q, task_step))

    def covariance(self, q: ndarray, *, task_step: ndarray) -> ndarray:
        """(..., n, n) Cov(q_{k+1}) in rad²."""
        return self.law.covariance(self.chain, *self._arrays(q, task_step))

    def step(self, q: ndarray, *, task_step: ndarray, rng: Generator) -> ndarray:
        """(..., n) one random next pose in rad for each of ``q``, as in a particle filter."""
        return self.law.sample(self.chain, *self._arrays(q, task_step), rng)

    def sample(
        self, q: ndarray, *, task_step: ndarray, size: int, rng: Generator
    ) -> ndarray:
        """(size, ..., n) independent next poses in rad from the same ``q``."""
        q, v = self._arrays(q, task_step)
        return self.law.sample(self.chain, np.broadcast_to(q, (size, *q.shape)), v, rng)

    def log_density(
        self, q: ndarray, q_next: ndarray, *, task_step: ndarray, measurement=None
    ) -> ndarray:
        """(...,) ln p(q_next | q) in rad⁻ⁿ. With a covariance ``measurement`` (n, n) in rad²,
        ``q_next`` includes normal measurement noise (a Wishart model then needs numba). Raises
        ModelDomainError for a step without a density, e.g. of a matrix model at rest.
        """
        q, v = self._arrays(q, task_step)
        return self.law.log_density(
            self.chain, q, v, np.asarray(q_next, float), measurement
        )

    def command(self, q: ndarray, target: ndarray, *, task_step: ndarray) -> ndarray:
        """Command (..., m) or (..., m + n): ``task_step`` plus κ times the displacement from the
        tip's pose at ``q`` to its ``target`` pose. κ = 0 for an open loop.
        """
        share = self.record["closed_loop_share"]
        return corrected_command(
            self.chain, np.asarray(q, float), task_step, target, share
        )

    def _arrays(self, q: ndarray, v: ndarray) -> tuple[ndarray, ndarray]:
        """Return ``q`` and ``v`` as arrays; warn of values outside the ranges of the fit."""
        n, m = len(self.chain.lower), len(self.chain.task)
        q = self._array("q", q, (n,), "rad")
        v = self._array(
            "v", v, (m, m + n) if n > m else (m,), f"steps of {self.chain.task}"
        )
        self._warn("pose", q)
        self._warn("speed", self.record["rate_per_s"] * v)
        return q, v


class ExportedErrors(Exported):
    """Fitted law of the errors e_k = q_k − c_k of n joints about their commanded angles c, as sent.
    It remembers the last errors and commands. ``lag`` in s is the delay of the run's measured
    angles behind the command, a number or (n,), if it is known; else the mean lag of the fit holds,
    and covariances include its spread. Joint steps c_{k+1} − c_k are arguments by name, in rad.
    """

    def predict(
        self, errors: ndarray, commands: ndarray, steps: int, lag: Any = None
    ) -> tuple[ndarray, ndarray]:
        """Return mean (n,) in rad and covariance (n, n) in rad² of the recorded error, its rounding
        included, ``steps`` samples after the last of the known ``errors`` (K, n), or after a rest
        without errors (0, n). ``commands`` are the commanded angles in rad at these samples and at
        least the ``steps`` next ones. The arm rests at the first command before it; behind the last
        command its speed continues, which an arm that leads its command needs.
        """
        errors, commands = self._histories(errors, commands, lag)
        self._warn_of_horizon(steps)
        return self.law.predict(errors, commands, steps, lag)

    def log_density(
        self, errors: ndarray, commands: ndarray, next_error: ndarray, lag: Any = None
    ) -> ndarray:
        """(...,) ln p in rad⁻ⁿ of ``next_error`` (..., n), as many samples after the last of
        ``errors`` (K, n) as ``commands`` has more rows than ``errors``.
        """
        errors, commands = self._histories(errors, commands, lag)
        next_error = self._array("next_error", next_error, (commands.shape[1],), "rad")
        steps = len(commands) - len(errors)
        self._warn_of_horizon(steps)
        mean, covariance = self.law.predict(errors, commands, steps, lag)
        outlook = Outlook(mean, np.diag(covariance), self.law.degrees)
        return outlook.log_probability(next_error, np.zeros(len(mean))).sum(axis=-1)

    def start(self, q: ndarray, commanded: ndarray, rng: Generator) -> ndarray:
        """(P, s) memory of first poses ``q`` (P, n) where ``commanded`` (n,) is the command."""
        n = len(self.law.joints)
        q, commanded = (self._array("q", each, (n,), "rad") for each in (q, commanded))
        self._warn("pose", q)
        return self.law.first_memory(q, commanded, rng)

    def step(
        self, q: ndarray, memory: ndarray, *, joint_step: ndarray, rng: Generator
    ) -> tuple[ndarray, ndarray]:
        """Return one random next pose (P, n) in rad and its memory (P, s) for each of ``q``, after
        the commanded ``joint_step`` (n,) or (P, n) in rad.
        """
        joint_step = self._array(
            "joint_step", joint_step, (len(self.law.joints),), "rad a step"
        )
        self._warn("joint speed", self.record["rate_per_s"] * joint_step)
        return self.law.follow(q, joint_step, memory, rng)

    def sample(
        self,
        q: ndarray,
        commanded: ndarray,
        *,
        joint_steps: ndarray,
        size: int,
        rng: Generator,
    ) -> ndarray:
        """(size, M + 1, n) poses in rad from ``q`` (n,) on, of arms that are commanded
        ``joint_steps`` (M, n) from the ``commanded`` angles (n,).
        """
        poses = [np.tile(np.asarray(q, float), (size, 1))]
        memory = self.start(poses[0], commanded, rng)
        for step in np.asarray(joint_steps, float):
            pose, memory = self.step(poses[-1], memory, joint_step=step, rng=rng)
            poses.append(pose)
        return np.stack(poses, axis=1)

    def warn_of_unconfirmed(self) -> None:
        """Warn of the standard deviations in ``not_known`` of the record."""
        for each in self.record["not_known"][:1]:
            first = "{parameter} is {found} (required: {required})".format(**each)
            message = (
                f"{first}; {len(self.record['not_known'])} such in record['not_known']"
            )
            warnings.warn(
                f"bands not confirmed: {message}", UnconfirmedBands, stacklevel=4
            )

    def _histories(
        self, errors: ndarray, commands: ndarray, lag: Any
    ) -> tuple[ndarray, ndarray]:
        """Return ``errors`` and ``commands`` as arrays; ModelDomainError for other shapes, and for
        values that are not numbers. Warn of errors and speeds outside the ranges of the fit.
        """
        n, arrays = len(self.law.joints), {}
        for name, values in {"errors": errors, "commands": commands}.items():
            array = self._array(name, values, (n,), "rad")
            if not np.isfinite(array).all():
                row = int(np.argmax(~np.isfinite(array).reshape(-1, n).all(axis=1)))
                message = f"{name} must be finite, got {array.reshape(-1, n)[row]} in row {row}"
                raise ModelDomainError(
                    f"{message}; leave out the rows before it, or fill it"
                )
            arrays[name] = array
        errors, commands = arrays.values()
        if errors.ndim != 2 or commands.ndim != 2 or len(commands) <= len(errors):
            message = (
                f"errors and commands must be (K, {n}) and (K + steps, {n}), got shapes"
            )
            raise ModelDomainError(f"{message} {errors.shape} and {commands.shape}")
        speed = self.record["rate_per_s"] * np.diff(commands, axis=0)
        late = self.law.lag if lag is None else lag
        self._warn("joint speed", speed)
        if len(errors):
            moved = np.concatenate([speed[:1], speed])[: len(errors)]
            self._warn("error", errors + late * moved)
        return errors, commands

    def _warn_of_horizon(self, steps: int) -> None:
        """Warn once of a prediction beyond the longest horizon of the fit."""
        ahead = steps / self.record["rate_per_s"]
        if ahead <= SCORED + 1 / self.record["rate_per_s"] or "ahead" in self._warned:
            return
        self._warned.add("ahead")
        message = f"{ahead:.3g} s ahead is beyond {SCORED:g} s, the longest horizon of the fit"
        warnings.warn(message, OutsideRanges, stacklevel=3)


def _chain(record: Mapping[str, Any]) -> Chain:
    """Return the arm of a file; ContractError for a value of another type or shape."""
    kind, n = (
        {"planar": PlanarChain, "serial": SerialChain}[record["kind"]],
        len(record["lower"]),
    )
    values = {name: each for name, each in record.items() if name != "kind"}
    sizes = {"origin": (2,), "links": (n, 2), "placements": (n + 1, 12)}
    for name in [each for each in values if each not in ("task", "length")]:
        limit, size = UNLIMITED.get(name), sizes.get(name, (n,))
        full = [limit if each is None and limit else each for each in values[name]]
        values[name] = np.array(full)
        sound = values[name].shape == size and values[name].dtype.kind in "bif"
        _require(sound, f"arm.{name}", f"numbers of shape {size}", repr(record[name]))
    sound = bool(np.all(values["lower"] <= values["upper"]))
    _require(sound, "arm.lower", "≤ arm.upper", repr(record["lower"]))
    if kind is PlanarChain:
        _require(
            set(values["signs"]) <= {-1, 1},
            "arm.signs",
            "1 or -1",
            repr(record["signs"]),
        )
    else:
        values["task"], length = tuple(values["task"]), values["length"]
        _require(
            {*values["task"]} <= {*ROWS},
            "arm.task",
            f"of {', '.join(ROWS)}",
            record["task"],
        )
        _require(
            _is_number(length) and length > 0,
            "arm.length",
            "a number > 0",
            repr(length),
        )
    return kind(**values)


def read_exported(file: Path, period: float | None = None) -> Exported:
    """Read the model that the tool export wrote to ``file``. Raises ContractError for another file,
    with the key and value of what is not valid, and ModelDomainError for another ``period`` in s.
    """
    try:
        hooks = {
            "parse_float": _number,
            "parse_constant": _number,
            "object_pairs_hook": _distinct,
        }
        record = _require_valid(json.loads(file.read_text("utf-8"), **hooks))
        law = build_model(record["parameters"])
        if law.traits.memory:
            model: Exported = ExportedErrors(law, record)
            model.warn_of_unconfirmed()
        else:
            model = ExportedModel(law, record, _chain(record["arm"]))
    except ContractError as error:
        raise ContractError(error.message, file=file) from None
    except INVALID as error:
        found = f"no key {error}" if isinstance(error, KeyError) else f"{error}"
        message = f"not an exported model ({found}); write one by python -m pipeline export MODEL"
        raise ContractError(message, file=file) from None
    model.require_period(period)
    return model


def _require_valid(record: Any) -> dict[str, Any]:
    """Return the contents of a file; ContractError with key and value for an invalid one."""
    found = record.get("format") if isinstance(record, dict) else type(record).__name__
    _require(found == FORMAT, "format", repr(FORMAT), repr(found))
    rate, share = record["rate_per_s"], record["closed_loop_share"]
    _require(_is_number(rate) and rate > 0, "rate_per_s", "a number > 0", repr(rate))
    sound = _is_number(share) and 0 <= share <= 1
    _require(sound, "closed_loop_share", "a number from 0 to 1", repr(share))
    for key, own in (
        ("rate", "rate_per_s"),
        ("joints", "joints"),
    ):  # a law may state them too
        law = record["parameters"].get(key, record.get(own))
        _require(
            law == record.get(own),
            own,
            f"{law!r} as parameters.{key}",
            repr(record.get(own)),
        )
    for quantity, ranges in record["ranges"].items():
        for name, ends in ranges.items():
            key, rule = f"ranges.{quantity}.{name}", "least ≤ greatest"
            _require(ends["least"] <= ends["greatest"], key, rule, repr(ends))
    return record


def _number(text: str) -> float:
    value = float(text)
    _require(abs(value) <= MOST, "numbers", f"finite and at most {MOST:g}", text)
    return value


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        count = Counter(name for name, _ in pairs)
        name, times = count.most_common(1)[0]
        _require(False, name, "stated once", f"{times} values")
    return values


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _require(sound: bool, key: str, rule: str, found: str) -> None:
    if not sound:
        raise ContractError(
            f"{key} must be {rule}, got {found}; export the model again"
        )
